// The kernels of four contacts at a time, one a lane: barrier, step and limits with everything of a
// contact's size fixed when compiled. What they add up to is in wrench_system.hpp.
//
// Lanes that are left over hold a contact without W and without limits, whose step is masked to
// zero. See barrier.hpp for the mathematics; the names are the same.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>

#include "graspforce/cone.hpp"
#include "graspforce/lane_ldl.hpp"
#include "graspforce/lanes.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/span.hpp"
#include "graspforce/structure.hpp"
#include "graspforce/wrench_system.hpp"

namespace graspforce {

// One row lo ≤ a·c ≤ hi of each of four contacts; lanes without one have a = 0 and room on both
// sides.
template <int Q, class V = Lanes>
struct LaneRow {
  V a[Q] = {};
  V lo = splat<V>(-1), hi = splat<V>(1);
  V mask[Q] = {};             // 1 where there is an entry
  int source[kLanes] = {};    // the joint, or the inequality
  int entry[Q][kLanes] = {};  // where its entries stand in J, or in A

  V at(const V* y) const {
    V t = a[0] * y[0];
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) t += a[i] * y[i];
    return t;
  }
};

// Up to four contacts of up to Q components. A contact of fewer components has columns of zeros in
// W and J for the rest: its barrier is that of the larger cone with nothing to move it sideways.
template <int Q, bool unrated, class V = Lanes>
struct LaneGroup {
  using Row = LaneRow<Q, V>;
  static constexpr int kLower = Q * (Q + 1) / 2;
  static constexpr int at(int i, int j) { return lane_ldl::at(i, j); }

  int members = 0;                // lanes in use
  int contact[kLanes] = {};       // in the problem; lanes left over repeat the last
  int component[Q][kLanes] = {};  // in c; components that a contact lacks repeat its normal
  V mask[Q] = {};                 // 1 where there is a component
  V padding = splat<V>(1);        // 1 in lanes left over
  // Whether these are four contacts of Q components that stand side by side in c, and whose joints
  // stand `stride` apart in J.
  bool contiguous = false;
  int stride = 0;
  V has_friction = {};  // 1 for contacts with friction
  V has_torsion = {};   // 1 for soft fingers
  V mu = splat<V>(1), torsion = splat<V>(1);
  V floor = splat<V>(-kInfinity), ceiling = splat<V>(kInfinity);
  V rate_lo[Q] = {}, rate_hi[Q] = {};  // with rate limits
  V W[kWrench][Q] = {};
  Span<Row> rows;
  int two_sided = 0;  // the joints' rows come first, then inequalities, which have no lower side

  V c[Q] = {splat<V>(1)}, d[Q] = {}, g[Q] = {};
  V H[kLower] = {};   // lower triangle, then the unit factor of H = L D Lᵀ below its diagonal
  V inverse[Q] = {};  // of D

  V weight(int i) const { return i == 3 ? torsion : splat<V>(1); }

  // Whether there are rate limits; compiled away from kernels of grasps without.
  static bool rates(const Layout& layout) { return !unrated && layout.rate_limits; }

  // ---- which contacts stand in the lanes -----------------------------------------------------

  void clear(int contacts, Span<Row> room, int of_joints) {
    rows = room;
    std::fill(rows.begin(), rows.end(), Row{});
    two_sided = of_joints;
    members = contacts;
    contiguous = contacts == kLanes;
  }

  // Puts the contact of a block into a lane, and once more into each lane left over.
  void place(int lane, const Block& block, const Layout& layout) {
    const bool used = lane < members;
    const int dim = static_cast<int>(block.components.size());
    contact[lane] = block.contacts[0];
    padding[lane] = used ? 0 : 1;
    has_friction[lane] = dim > 1 ? 1 : 0;
    has_torsion[lane] = dim > 3 ? 1 : 0;
    for (int i = 0; i < Q; ++i) {
      component[i][lane] = block.components[i < dim ? i : 0];
      mask[i][lane] = used && i < dim ? 1 : 0;
    }
    contiguous = contiguous && dim == Q && component[0][lane] == component[0][0] + Q * lane;
    const int m = layout.components();
    auto occupy = [&](int r, int source, int stride, int offset) {
      rows[r].source[lane] = source;
      for (int i = 0; i < Q; ++i) {
        rows[r].mask[i][lane] = mask[i][lane];
        rows[r].entry[i][lane] = component[i][lane] * stride + offset;
      }
    };
    for (int r = 0; r < block.joints.size(); ++r)
      occupy(r, block.joints[r], layout.joints, block.joints[r]);
    for (int r = 0; r < block.inequalities.size(); ++r)
      occupy(two_sided + r, block.inequalities[r], 1, block.inequalities[r] * m);
  }

  // Once every lane has its contact: looks for the even steps that make loading cheap.
  void settle() {
    stride = rows.size() == 0 ? 0 : rows[0].entry[0][1] - rows[0].entry[0][0];
    for (int r = 0; r < two_sided; ++r)
      for (int l = 0; l < kLanes; ++l)
        contiguous = contiguous && rows[r].mask[0][l] == 1 &&
                     rows[r].entry[0][l] == rows[r].entry[0][0] + l * stride;
  }

  // Height mu n and radius ‖w t‖ of y: inside the cone the height is the larger.
  GRASPFORCE_INLINE void cone(const V* y, V& height, V& radius) const {
    height = mu * y[0];
    V sum = {};
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) {
      const V t = i == 3 ? torsion * y[i] : y[i];
      sum += t * t;
    }
    radius = Q > 1 ? sqrt(sum) : sum;
  }

  // Least slack at the point.
  GRASPFORCE_INLINE V slack(const Layout& layout) const {
    V height, radius;
    cone(c, height, radius);
    V worst = min(height - radius, min(ceiling - c[0], c[0] - floor));
    for (const Row& row : rows) {
      const V t = row.at(c);
      worst = min(worst, min(row.hi - t, t - row.lo));
    }
    for (int i = 0; i < Q && rates(layout); ++i)
      worst = min(worst, min(rate_hi[i] - c[i], c[i] - rate_lo[i]));
    return worst;
  }

  // Gradient and, when wanted, Hessian; returns the least slack. The sums are kept in locals: what
  // stands in memory might overlap with the rows for all the compiler knows. The cone comes last:
  // its square root and division take longest. Weights, here, and multipliers, below, are one
  // double for all lanes, or of type V where each lane is a problem of its own.
  template <bool with_hessian, class Weight>
  GRASPFORCE_INLINE V evaluate(Weight cone_weight, Weight limit_weight, const Layout& layout) {
    V height, radius;
    cone(c, height, radius);
    V worst = height - radius, sum_g[Q] = {}, sum_H[kLower] = {};
    auto add_row = [&](const Row& row, V slope, V bend) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i) {
        sum_g[i] += slope * row.a[i];
        const V scaled = bend * row.a[i];
        GRASPFORCE_UNROLL
        for (int j = 0; j <= i && with_hessian; ++j) sum_H[at(i, j)] += scaled * row.a[j];
      }
    };
    const Row *row = rows.begin(), *one_sided = row + two_sided, *end = rows.end();
    for (; row != one_sided; ++row) {
      const V t = row->at(c), above = row->hi - t, below = t - row->lo;
      worst = min(worst, min(above, below));
      // 1/above and 1/below for one division
      const V inverse = 1 / (above * below), up = below * inverse, down = above * inverse;
      add_row(*row, limit_weight * (up - down), limit_weight * (up * up + down * down));
    }
    for (; row != end; ++row) {
      const V above = row->hi - row->at(c), up = 1 / above;
      worst = min(worst, above);
      add_row(*row, limit_weight * up, limit_weight * up * up);
    }
    auto bound_normal = [&](V room, double sign) {
      worst = min(worst, room);
      const V inverse = 1 / room;
      sum_g[0] += (sign * limit_weight) * inverse;
      if (with_hessian) sum_H[0] += limit_weight * inverse * inverse;
    };
    if (layout.ceilings) bound_normal(ceiling - c[0], 1);
    if (layout.floors) bound_normal(c[0] - floor, -1);

    const V inverse_det = 1 / ((height - radius) * (height + radius)), twice = 2 * inverse_det;
    const V scaled = cone_weight * twice;
    V first[Q];
    first[0] = -twice * mu * height;
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) first[i] = twice * weight(i) * weight(i) * c[i];
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) g[i] = sum_g[i] + cone_weight * first[i];
    if (with_hessian) {
      const V corner = mu * mu * (height * height + radius * radius);
      H[0] = sum_H[0] + scaled * (corner * inverse_det);
      GRASPFORCE_UNROLL
      for (int i = 1; i < Q; ++i) {
        const V outer = cone_weight * first[i];
        GRASPFORCE_UNROLL
        for (int j = 0; j < i; ++j) H[at(i, j)] = sum_H[at(i, j)] + outer * first[j];
        H[at(i, i)] = (sum_H[at(i, i)] + scaled * weight(i) * weight(i)) + outer * first[i];
      }
    }
    return rates(layout) ? add_rates<with_hessian>(limit_weight, worst) : worst;
  }

  // The rate limits' share of gradient and Hessian; returns the least slack, theirs included.
  // Apart, because few problems have any.
  template <bool with_hessian, class Weight>
  GRASPFORCE_APART V add_rates(Weight limit_weight, V worst) {
    for (int i = 0; i < Q; ++i) {
      const V above = rate_hi[i] - c[i], below = c[i] - rate_lo[i];
      const V up = 1 / above, down = 1 / below;
      worst = min(worst, min(above, below));
      g[i] += limit_weight * (up - down);
      if (with_hessian) H[at(i, i)] += limit_weight * (up * up + down * down);
    }
    return worst;
  }

  // H = L D Lᵀ in place; x ← L⁻¹ x, x ← L⁻ᵀ x, x ← H⁻¹ x. See lane_ldl.hpp.
  GRASPFORCE_INLINE void factor() { lane_ldl::factor<Q>(H, inverse); }
  GRASPFORCE_INLINE void forward(V* x) const { lane_ldl::forward<Q>(H, x); }
  GRASPFORCE_INLINE void back(V* x) const { lane_ldl::back<Q>(H, x); }
  void solve(V* x) const {
    forward(x);
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) x[i] *= inverse[i];
    back(x);
  }

  GRASPFORCE_INLINE V wrench(int r, const V* y) const {
    V sum = W[r][0] * y[0];
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) sum += W[r][i] * y[i];
    return sum;
  }

  // g ← g − Wᵀ ν.
  template <class Multiplier>
  GRASPFORCE_INLINE void subtract_wrench(const Multiplier* nu) {
    for (int i = 0; i < Q; ++i)
      for (int r = 0; r < kWrench; ++r) g[i] -= W[r][i] * nu[r];
  }

  // Adds W (H⁻¹ g − c), or W H⁻¹ g alone, to a right-hand side; H by a factor of it.
  template <bool less_forces>
  GRASPFORCE_INLINE void add_gradient(V* rhs, const V* L, const V* inverse) const {
    V x[Q];
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) x[i] = g[i];
    lane_ldl::solve<Q>(L, inverse, x);
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q && less_forces; ++i) x[i] -= c[i];
    GRASPFORCE_UNROLL
    for (int r = 0; r < kWrench; ++r) rhs[r] += wrench(r, x);
  }

  // Factors H and adds the group's share of the 6 × 6 system. With Y = L⁻¹ Wᵀ it is Yᵀ D⁻¹ Y. The
  // first group sets the triangle instead: clearing it beforehand would cost more than the sum.
  template <bool first>
  GRASPFORCE_INLINE void add(SumsOf<V>& sums) {
    factor();
    add_gradient<true>(sums.rhs(), H, inverse);
    V Y[kWrench][Q];
    GRASPFORCE_UNROLL
    for (int r = 0; r < kWrench; ++r) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i) Y[r][i] = W[r][i];
      forward(Y[r]);
      V scaled[Q];
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i) scaled[i] = inverse[i] * Y[r][i];
      GRASPFORCE_UNROLL
      for (int s = 0; s <= r; ++s) {
        V dot = scaled[0] * Y[s][0];
        GRASPFORCE_UNROLL
        for (int i = 1; i < Q; ++i) dot += scaled[i] * Y[s][i];
        V& sum = sums.v[at(r, s)];
        sum = first ? dot : sum + dot;
      }
    }
  }

  // x = L⁻¹ (Wᵀ ν − g), masked; returns its squared length in D⁻¹. H by a factor of it.
  template <class Multiplier>
  GRASPFORCE_INLINE V residual(const Multiplier* nu, V* x, const V* L, const V* inverse) const {
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) {
      V odd = W[1][i] * nu[1];  // two sums, each half as long to wait for
      x[i] = W[0][i] * nu[0] - g[i];
      GRASPFORCE_UNROLL
      for (int r = 2; r < kWrench; r += 2) {
        x[i] += W[r][i] * nu[r];
        odd += W[r + 1][i] * nu[r + 1];
      }
      x[i] = mask[0] * (x[i] + odd);
    }
    lane_ldl::forward<Q>(L, x);
    V squared = {};
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) squared += x[i] * x[i] * inverse[i];
    return squared;
  }

  // The step d; returns its decrement squared.
  template <class Multiplier>
  GRASPFORCE_INLINE V step(const Multiplier* nu) {
    const V squared = residual(nu, d, H, inverse);
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) d[i] *= inverse[i];
    back(d);
    return squared;
  }

  // 1 / largest t for which the point plus t d stays inside (0 or less: no limit).
  V inverse_limit(const Layout& layout) const {
    V height, radius, worst = {};
    cone(c, height, radius);
    const V rise = mu * d[0];
    // The greater root of c x² + 2 b x + a in x = 1/t; see lorentz::step_limit.
    V qa = rise * rise, qb = height * rise;
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) {
      const V w2 = weight(i) * weight(i);
      qa -= w2 * d[i] * d[i];
      qb -= w2 * c[i] * d[i];
    }
    const V qc = (height - radius) * (height + radius), discriminant = qb * qb - qa * qc;
    const V root = sqrt(max(discriminant, V{}));
    // For b > 0 the difference root − b is written without its cancellation.
    const V inverse_step = select(qb < 0, (root - qb) / qc, -qa / (root + qb));
    worst = max(worst, select(inverse_step == inverse_step, inverse_step, V{}));  // 0/0: d is zero
    auto limit = [&worst](V above, V below, V change) {
      worst = max(worst, abs(change) / select(change > 0, above, below));
    };
    limit(ceiling - c[0], c[0] - floor, d[0]);
    for (const Row& row : rows) {
      const V t = row.at(c);
      limit(row.hi - t, t - row.lo, row.at(d));
    }
    for (int i = 0; i < Q && rates(layout); ++i) limit(rate_hi[i] - c[i], c[i] - rate_lo[i], d[i]);
    return worst;
  }

  // Four numbers side by side.
  static Lanes gather(const double* from, const int* at) {
    return Lanes{from[at[0]], from[at[1]], from[at[2]], from[at[3]]};
  }

  // Q vectors of a contiguous group's numbers as they stand in memory, made from their number.
  template <class At>
  GRASPFORCE_INLINE static void take(At at, Lanes* to) {
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) to[i] = at(kLanes * i);
    to_components<Q>(to);
  }

  void set_forces(const double* from) {
    if (contiguous) return take([&](int i) { return four_at(from + component[0][0] + i); }, c);
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) c[i] = mask[i] * gather(from, component[i]);
    c[0] += padding;
  }

  // c ← 2 last − before.
  void extrapolate(const double* last, const double* before) {
    const int first = component[0][0];
    auto ahead = [&](int i) { return 2 * four_at(last + first + i) - four_at(before + first + i); };
    if (contiguous) return take(ahead, c);
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i)
      c[i] = mask[i] * (2 * gather(last, component[i]) - gather(before, component[i]));
    c[0] += padding;
  }

  // From the last to the first: what a lane left over or a missing component writes is then
  // overwritten by the one it repeats.
  void get_forces(double* to) const {
    if (contiguous) {
      Lanes side_by_side[Q];
      std::copy_n(c, Q, side_by_side);
      to_contacts<Q>(side_by_side);
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i)
        std::memcpy(to + component[0][0] + kLanes * i, &side_by_side[i], sizeof(Lanes));
      return;
    }
    GRASPFORCE_UNROLL
    for (int i = Q - 1; i >= 0; --i) {
      GRASPFORCE_UNROLL
      for (int l = kLanes - 1; l >= 0; --l) to[component[i][l]] = c[i][l];
    }
  }

  // The rows of W in use; the others are zeros.
  void load_map(const double* map, int m, const int* row, int k) {
    if (contiguous && k == kWrench) {
      const double* from = map + component[0][0];
      GRASPFORCE_UNROLL
      for (int r = 0; r < kWrench; ++r, from += m)
        take([&](int i) { return four_at(from + i); }, W[r]);
      return;
    }
    for (int r = 0; r < kWrench; ++r)
      for (int i = 0; i < Q; ++i)
        W[r][i] = r < k ? mask[i] * gather(map + std::size_t(row[r]) * m, component[i]) : Lanes{};
  }

  void load_jacobian(const double* J, int joints) {
    if (!contiguous) {
      for (int r = 0; r < two_sided; ++r) load_row(rows[r], J);
      return;
    }
    const std::ptrdiff_t step = stride;
    for (Row *row = rows.begin(), *end = row + two_sided; row != end; ++row) {
      const double* from = J + row->entry[0][0];
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i, from += joints)
        row->a[i] = Lanes{from[0], from[step], from[2 * step], from[3 * step]};
    }
  }

  // The row's entries of J or A.
  static void load_row(Row& row, const double* from) {
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) row.a[i] = row.mask[i] * gather(from, row.entry[i]);
  }

  void load_limits(const Problem& p, const Layout& layout) {
    for (int r = 0; r < two_sided; ++r) {
      Row& row = rows[r];
      const Lanes there = row.mask[0], bias = gather(p.tau_bias, row.source);
      row.lo = select(there > 0, gather(p.tau_lo, row.source) - bias, splat(-1));
      row.hi = select(there > 0, gather(p.tau_hi, row.source) - bias, splat(1));
    }
    for (int r = two_sided; r < rows.size(); ++r) {
      Row& row = rows[r];
      load_row(row, p.A);
      row.lo = splat(-kInfinity);
      row.hi = select(row.mask[0] > 0, gather(p.b, row.source), splat(1));
    }
    const Lanes own = gather(p.mu, contact);
    mu = select(has_friction > 0, own, splat(1));
    torsion = select(has_torsion > 0, own / gather(p.gamma, contact), splat(1));
    // normal_ceiling and normal_floor
    const Lanes share = gather(p.engagement, contact);
    Lanes most = layout.ceilings ? gather(p.c_max, contact) : splat(kInfinity);
    if (layout.floors) {
      const Lanes least = gather(p.c_min, contact);
      floor = select(padding > 0, splat(-kInfinity), share * min(least, (1 - kSqueeze) * most));
      if (layout.ceilings) most = max(most, (1 + kSqueeze) * least);
    }
    if (layout.ceilings) ceiling = select(padding > 0, splat(kInfinity), share * most);
    for (int i = 0; i < Q && rates(layout); ++i) {
      const Lanes last = gather(p.c_last, component[i]), most = gather(p.dc_max, component[i]);
      rate_lo[i] = select(mask[i] > 0, last - most, splat(-kInfinity));
      rate_hi[i] = select(mask[i] > 0, last + most, splat(kInfinity));
    }
  }

  // A pure push, less where that would pass a limit that a weaker push keeps to.
  void push(V normal, const Layout& layout) {
    V used = splat<V>(kMostUsed);
    for (const Row& row : rows) {
      const V t = row.a[0] * normal, up = t / row.hi, down = t / row.lo;
      used = max(used, select(t > 0, select(row.hi > 0, up, used), select(row.lo < 0, down, used)));
    }
    if (rates(layout)) used = select(rate_hi[0] > 0, max(used, normal / rate_hi[0]), used);
    c[0] = select(padding > 0, splat<V>(1), normal * (kMostUsed / used));
    for (int i = 1; i < Q; ++i) c[i] = V{};
  }

  // The same in one lane, of a problem without rate limits.
  void push(int lane, double normal) {
    double used = kMostUsed;
    for (const Row& row : rows) {
      const double t = row.a[0][lane] * normal, lo = row.lo[lane], hi = row.hi[lane];
      const double range = t > 0 ? hi : -lo;
      if (range > 0) used = std::max(used, std::abs(t) / range);
    }
    c[0][lane] = normal * (kMostUsed / used);
    for (int i = 1; i < Q; ++i) c[i][lane] = 0;
  }

  // The size of force that the limits are made for, by the largest of them.
  V size(const Layout& layout) const {
    V most = select(ceiling < kInfinity, ceiling, V{});
    for (int i = 0; i < Q && rates(layout); ++i)
      most = select(mask[i] > 0, max(most, max(abs(rate_lo[i]), abs(rate_hi[i]))), most);
    for (const Row& row : rows) {
      const V low = select(row.lo > -kInfinity, abs(row.lo), V{});
      V largest = abs(row.a[0]);
      for (int i = 1; i < Q; ++i) largest = max(largest, abs(row.a[i]));
      most = max(most, select(largest > 0, max(abs(row.hi), low) / largest, V{}));
    }
    return most;
  }

  // The normal force that alone uses up the tightest of the joints' torque ranges and the ceiling.
  V reach() const {
    V least = ceiling;
    for (const Row& row : rows) {
      const V moment_arm = abs(row.a[0]), range = row.hi - row.lo;
      least = select(moment_arm > 0, min(least, range / moment_arm), least);
    }
    return least;
  }
  // The same in one lane.
  double reach(int lane) const {
    double least = ceiling[lane];
    for (const Row& row : rows) {
      const double moment_arm = std::abs(row.a[0][lane]), range = row.hi[lane] - row.lo[lane];
      if (moment_arm > 0) least = std::min(least, range / moment_arm);
    }
    return least;
  }
};

}  // namespace graspforce
