// The barrier of barrier.hpp for grasps in which no two contacts share a block: four contacts at a
// time, one a lane, with everything of a contact's size fixed when compiled.
//
// The same mathematics with the same names. Contacts of one model make up groups of four; lanes
// that are left over hold a contact without W and without limits, whose step is masked to zero.
// W c = f has at most six rows, and rows that are missing or not in use are rows of zeros with a
// one on the diagonal of the 6 × 6 system.
#pragma once

#include <algorithm>
#include <cmath>
#include <tuple>
#include <type_traits>
#include <vector>

#include "graspforce/cone.hpp"
#include "graspforce/lanes.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/structure.hpp"

namespace graspforce {

inline constexpr int kWrench = 6;  // rows of W that the kernels are made for

// What the groups add up to: the lower triangle of Σ W H⁻¹ Wᵀ, and a right-hand side.
struct WrenchSums {
  static constexpr int kTriangle = kWrench * (kWrench + 1) / 2;
  Lanes S[kTriangle];
  Lanes rhs[kWrench];
};

// One row lo ≤ a·c ≤ hi of each of four contacts; lanes without one have a = 0.
template <int Q>
struct LaneRow {
  Lanes a[Q] = {};
  Lanes lo = splat(-1), hi = splat(1);
  Lanes mask = {};
  int source[kLanes] = {};  // the joint, or the inequality

  Lanes at(const Lanes* y) const {
    Lanes t = a[0] * y[0];
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) t += a[i] * y[i];
    return t;
  }
};

// Q components of up to four contacts.
template <int Q>
struct LaneGroup {
  using Row = LaneRow<Q>;
  static constexpr int kLower = Q * (Q + 1) / 2;
  static constexpr int at(int i, int j) { return i * (i + 1) / 2 + j; }

  static constexpr int components = Q;

  int contact[kLanes] = {-1, -1, -1, -1};  // in the problem; −1 for a lane that is left over
  int start[kLanes] = {};                  // its first component there
  Lanes mask = {};                         // 1 where there is a contact
  Lanes mu = splat(1), torsion = splat(1);
  Lanes floor = splat(-kInfinity), ceiling = splat(kInfinity);
  Lanes W[kWrench][Q] = {};
  std::vector<Row> rows;
  int members = 0;    // lanes in use
  int two_sided = 0;  // the joints' rows come first, then inequalities, which have no lower side

  Lanes c[Q] = {splat(1)}, d[Q] = {}, g[Q];
  Lanes H[kLower];   // lower triangle, then the unit factor of H = L D Lᵀ below its diagonal
  Lanes inverse[Q];  // of D
  Lanes weight(int i) const { return i == 3 ? torsion : splat(1); }

  // Slacks of cone and normal force at y; `worst` takes the least.
  void cone(const Lanes* y, Lanes& height, Lanes& radius) const {
    height = mu * y[0];
    Lanes sum = {};
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) {
      const Lanes t = i == 3 ? torsion * y[i] : y[i];
      sum += t * t;
    }
    radius = Q > 1 ? sqrt(sum) : sum;
  }

  // Least slack at the point.
  Lanes slack() const {
    Lanes height, radius;
    cone(c, height, radius);
    Lanes worst = min(height - radius, min(ceiling - c[0], c[0] - floor));
    for (const Row& row : rows) {
      const Lanes t = row.at(c);
      worst = min(worst, min(row.hi - t, t - row.lo));
    }
    return worst;
  }

  // Gradient and, when wanted, Hessian; returns the least slack.
  template <bool with_hessian>
  Lanes evaluate(double cone_weight, double limit_weight, bool ceilings, bool floors) {
    Lanes height, radius;
    cone(c, height, radius);
    Lanes worst = height - radius;
    const Lanes det = worst * (height + radius);
    const Lanes inverse_det = 1 / det, twice = 2 * inverse_det;
    Lanes first[Q];
    first[0] = -twice * mu * height;
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) first[i] = twice * weight(i) * weight(i) * c[i];
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) g[i] = cone_weight * first[i];
    if (with_hessian) {
      H[0] = cone_weight * twice * mu * mu * ((height * height + radius * radius) * inverse_det);
      GRASPFORCE_UNROLL
      for (int i = 1; i < Q; ++i) {
        GRASPFORCE_UNROLL
        for (int j = 0; j < i; ++j) H[at(i, j)] = cone_weight * first[i] * first[j];
        H[at(i, i)] = cone_weight * (first[i] * first[i] + twice * weight(i) * weight(i));
      }
    }
    auto add_row = [&](const Row& row, Lanes slope, Lanes bend) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i) g[i] += slope * row.a[i];
      if (!with_hessian) return;
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i) {
        const Lanes scaled = bend * row.a[i];
        GRASPFORCE_UNROLL
        for (int j = 0; j <= i; ++j) H[at(i, j)] += scaled * row.a[j];
      }
    };
    for (int r = 0; r < two_sided; ++r) {
      const Row& row = rows[r];
      const Lanes t = row.at(c), above = row.hi - t, below = t - row.lo;
      worst = min(worst, min(above, below));
      // 1/above and 1/below for one division
      const Lanes inverse = 1 / (above * below), up = below * inverse, down = above * inverse;
      add_row(row, limit_weight * (up - down), limit_weight * (up * up + down * down));
    }
    for (std::size_t r = two_sided; r < rows.size(); ++r) {
      const Lanes above = rows[r].hi - rows[r].at(c), up = 1 / above;
      worst = min(worst, above);
      add_row(rows[r], limit_weight * up, limit_weight * up * up);
    }
    auto bound_normal = [&](Lanes room, double sign) {
      worst = min(worst, room);
      const Lanes inverse = 1 / room;
      g[0] += (sign * limit_weight) * inverse;
      if (with_hessian) H[0] += limit_weight * inverse * inverse;
    };
    if (ceilings) bound_normal(ceiling - c[0], 1);
    if (floors) bound_normal(c[0] - floor, -1);
    return worst;
  }

  // H = L D Lᵀ in place. A pivot lost to rounding is replaced by a tiny positive one.
  void factor() {
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) {
      Lanes pivot = H[at(i, i)];
      Lanes scaled[Q];
      GRASPFORCE_UNROLL
      for (int j = 0; j < i; ++j) {
        scaled[j] = H[at(i, j)];
        GRASPFORCE_UNROLL
        for (int k = 0; k < j; ++k) scaled[j] -= H[at(j, k)] * scaled[k];
      }
      GRASPFORCE_UNROLL
      for (int j = 0; j < i; ++j) {
        H[at(i, j)] = scaled[j] * inverse[j];
        pivot -= H[at(i, j)] * scaled[j];
      }
      inverse[i] = 1 / max(pivot, 1e-15 * H[at(i, i)]);
    }
  }

  // x ← L⁻¹ x, and x ← L⁻ᵀ x.
  void forward(Lanes* x) const {
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) GRASPFORCE_UNROLL
    for (int k = 0; k < i; ++k) x[i] -= H[at(i, k)] * x[k];
  }
  void back(Lanes* x) const {
    GRASPFORCE_UNROLL
    for (int i = Q - 2; i >= 0; --i) GRASPFORCE_UNROLL
    for (int k = i + 1; k < Q; ++k) x[i] -= H[at(k, i)] * x[k];
  }
  void solve(Lanes* x) const {
    forward(x);
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) x[i] *= inverse[i];
    back(x);
  }

  Lanes wrench(int r, const Lanes* y) const {
    Lanes sum = W[r][0] * y[0];
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) sum += W[r][i] * y[i];
    return sum;
  }

  // Adds W (H⁻¹ g − c), or W H⁻¹ g alone, to a right-hand side; the first group sets it instead
  // (clearing it beforehand would cost more than the sum).
  template <bool first>
  void add_gradient(Lanes* rhs, bool less_forces) const {
    Lanes x[Q];
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) x[i] = g[i];
    solve(x);
    if (less_forces) GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) x[i] -= c[i];
    GRASPFORCE_UNROLL
    for (int r = 0; r < kWrench; ++r) rhs[r] = first ? wrench(r, x) : rhs[r] + wrench(r, x);
  }

  // Factors H and adds the group's share of the 6 × 6 system, W H⁻¹ Wᵀ, and its right-hand side.
  template <bool first>
  void add(WrenchSums& sums) {
    factor();
    add_gradient<first>(sums.rhs, true);
    GRASPFORCE_UNROLL
    for (int r = 0; r < kWrench; ++r) {
      Lanes x[Q];
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i) x[i] = W[r][i];
      solve(x);
      GRASPFORCE_UNROLL
      for (int s = 0; s <= r; ++s) {
        Lanes& sum = sums.S[r * (r + 1) / 2 + s];
        sum = first ? wrench(s, x) : sum + wrench(s, x);
      }
    }
  }

  // x = L⁻¹ (Wᵀ ν − g), masked; returns its squared length in D⁻¹.
  Lanes residual(const double* nu, Lanes* x) const {
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) {
      x[i] = -g[i];
      GRASPFORCE_UNROLL
      for (int r = 0; r < kWrench; ++r) x[i] += W[r][i] * nu[r];
      x[i] *= mask;
    }
    forward(x);
    Lanes squared = {};
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) squared += x[i] * x[i] * inverse[i];
    return squared;
  }

  // The step d; returns its decrement squared.
  Lanes step(const double* nu) {
    const Lanes squared = residual(nu, d);
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) d[i] *= inverse[i];
    back(d);
    return squared;
  }

  // 1 / largest t for which the point plus t d stays inside (0 or less: no limit).
  Lanes inverse_limit() const {
    Lanes height, radius, worst = {};
    cone(c, height, radius);
    const Lanes rise = mu * d[0];
    // The greater root of c x² + 2 b x + a in x = 1/t; see lorentz::step_limit.
    Lanes qa = rise * rise, qb = height * rise;
    GRASPFORCE_UNROLL
    for (int i = 1; i < Q; ++i) {
      const Lanes w2 = weight(i) * weight(i);
      qa -= w2 * d[i] * d[i];
      qb -= w2 * c[i] * d[i];
    }
    const Lanes qc = (height - radius) * (height + radius), discriminant = qb * qb - qa * qc;
    const Lanes root = sqrt(max(discriminant, Lanes{}));
    // For b > 0 the difference root − b is written without its cancellation.
    const Lanes inverse_step = qb < 0 ? (root - qb) / qc : -qa / (root + qb);
    worst = max(worst, inverse_step == inverse_step ? inverse_step : Lanes{});  // 0/0: d is zero
    auto limit = [&worst](Lanes above, Lanes below, Lanes change) {
      worst = max(worst, max(change / above, -change / below));
    };
    limit(ceiling - c[0], c[0] - floor, d[0]);
    for (const Row& row : rows) {
      const Lanes t = row.at(c);
      limit(row.hi - t, t - row.lo, row.at(d));
    }
    return worst;
  }

  // The group's entries of four columns of a row-major matrix, masked.
  static Lanes gather(const double* entries, const int* index, std::size_t shift, Lanes lanes) {
    const double* from = entries + shift;
    return lanes * Lanes{from[index[0]], from[index[1]], from[index[2]], from[index[3]]};
  }

  void load_map(const double* map, int m, const int* row, int k) {
    for (int r = 0; r < k; ++r) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i) W[r][i] = gather(map + std::size_t(row[r]) * m, start, i, mask);
    }
    for (int r = k; r < kWrench; ++r) std::fill_n(W[r], Q, Lanes{});
  }

  void load_jacobian(const double* J, int joints) {
    for (int r = 0; r < two_sided; ++r) {
      int index[kLanes];
      GRASPFORCE_UNROLL
      for (int l = 0; l < kLanes; ++l) index[l] = start[l] * joints + rows[r].source[l];
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i)
        rows[r].a[i] = gather(J, index, std::size_t(i) * joints, rows[r].mask);
    }
  }

  void load_limits(const Problem& p, const Layout& layout, int m) {
    for (std::size_t r = 0; r < rows.size(); ++r) {
      Row& row = rows[r];
      for (int l = 0; l < kLanes; ++l) {
        if (row.mask[l] == 0) continue;
        const int source = row.source[l];
        if (static_cast<int>(r) < two_sided) {
          row.lo[l] = p.tau_lo[source] - p.tau_bias[source];
          row.hi[l] = p.tau_hi[source] - p.tau_bias[source];
        } else {
          row.lo[l] = -kInfinity;
          row.hi[l] = p.b[source];
          for (int i = 0; i < Q; ++i) row.a[i][l] = p.A[source * m + start[l] + i];
        }
      }
    }
    for (int l = 0; l < kLanes; ++l) {
      if (contact[l] < 0) continue;
      mu[l] = Q == 1 ? 1 : p.mu[contact[l]];
      torsion[l] = p.mu[contact[l]] / p.gamma[contact[l]];
      const double share = p.engagement[contact[l]];
      ceiling[l] = layout.ceilings ? share * p.c_max[contact[l]] : kInfinity;
      floor[l] = layout.floors ? share * p.c_min[contact[l]] : -kInfinity;
    }
  }

  // The normal force that alone uses up the tightest of the joints' torque ranges and the ceiling.
  Lanes reach() const {
    Lanes least = ceiling;
    for (const Row& row : rows) {
      const Lanes lever = abs(row.a[0]), range = row.hi - row.lo;
      least = lever > 0 ? min(least, range / lever) : least;
    }
    return least;
  }
};

// The 6 × 6 system, S = L D Lᵀ.
class WrenchSystem {
 public:
  // Takes the sums over the lanes; rows from `k` on are not in use. Returns the smallest pivot
  // relative to its diagonal entry.
  double factor(const WrenchSums& sums_of, int k) {
    double entries[WrenchSums::kTriangle + 3];
    for (int i = 0; i < WrenchSums::kTriangle; i += kLanes) {
      const Lanes* v = sums_of.S + i;
      const Lanes none = {};
      const bool whole = i + kLanes <= WrenchSums::kTriangle;
      const Lanes four = sums(v[0], whole ? v[1] : none, whole ? v[2] : none, whole ? v[3] : none);
      for (int l = 0; l < kLanes; ++l) entries[i + l] = four[l];
    }
    double smallest = 1;
    GRASPFORCE_UNROLL
    for (int i = 0; i < kWrench; ++i) {
      double* row = L_[i];
      double scaled[kWrench];
      double pivot = i < k ? entries[i * (i + 1) / 2 + i] : 1;
      const double before = pivot;
      GRASPFORCE_UNROLL
      for (int j = 0; j < i; ++j) {
        scaled[j] = entries[i * (i + 1) / 2 + j];
        GRASPFORCE_UNROLL
        for (int l = 0; l < j; ++l) scaled[j] -= L_[j][l] * scaled[l];
      }
      GRASPFORCE_UNROLL
      for (int j = 0; j < i; ++j) {
        row[j] = scaled[j] * inverse_[j];
        pivot -= row[j] * scaled[j];
      }
      const double relative = pivot / before;
      if (!(relative >= smallest)) smallest = relative;
      inverse_[i] = 1 / (relative > 1e-15 ? pivot : 1e-15 * before);
    }
    return smallest;
  }

  void solve(double* x) const {
    GRASPFORCE_UNROLL
    for (int i = 1; i < kWrench; ++i) GRASPFORCE_UNROLL
    for (int j = 0; j < i; ++j) x[i] -= L_[i][j] * x[j];
    GRASPFORCE_UNROLL
    for (int i = 0; i < kWrench; ++i) x[i] *= inverse_[i];
    GRASPFORCE_UNROLL
    for (int i = kWrench - 2; i >= 0; --i) GRASPFORCE_UNROLL
    for (int j = i + 1; j < kWrench; ++j) x[i] -= L_[j][i] * x[j];
  }

 private:
  double L_[kWrench][kWrench], inverse_[kWrench];
};

class LaneBarrier {
 public:
  explicit LaneBarrier(const Layout& layout) : layout_(layout) {}

  // Sorts the contacts into groups; false when the structure does not fit the kernels.
  bool allot(const Structure& structure) {
    if (layout_.wrench_rows > kWrench || structure.blocks().empty()) return false;
    for (const Block& block : structure.blocks())
      if (block.contacts.size() > 1) return false;
    members_ = 0;
    allot_groups<1>(structure);
    allot_groups<3>(structure);
    allot_groups<4>(structure);
    return true;
  }

  // Takes what has changed of a problem's numbers.
  void load(const Problem& p, unsigned changed) {
    if (changed & kChangedMap || k_ < layout_.wrench_rows) {
      k_ = layout_.wrench_rows;
      for (int r = 0; r < k_; ++r) row_[r] = r;
      load_wrench_rows(p);
    }
    for (int r = 0; r < k_; ++r) f_[r] = p.f[r];
    if (changed & kChangedJacobian)
      each([&](auto& group) { group.load_jacobian(p.J, layout_.joints); });
    if (changed & kChangedRest) load_limits(p);
  }

  // Keeps only the given rows of W c = f: an independent set when W is rank-deficient.
  void restrict_rows(const Problem& p, const std::vector<int>& rows) {
    k_ = static_cast<int>(rows.size());
    for (int r = 0; r < k_; ++r) {
      row_[r] = rows[r];
      f_[r] = p.f[rows[r]];
    }
    load_wrench_rows(p);
  }

  double cone_weight() const { return cone_weight_; }
  double limit_weight() const { return limit_weight_; }

  // ---- the point ---------------------------------------------------------------------------

  void set_forces(const double* c) {
    each([&](auto& group) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < group.components; ++i)
        group.c[i] = group.gather(c, group.start, i, group.mask);
      group.c[0] += 1 - group.mask;
    });
  }

  void get_forces(double* c) const {
    if (members_ < layout_.contacts()) std::fill_n(c, components_, 0.0);
    each([&](const auto& group) {
      for (int l = 0; l < group.members; ++l) GRASPFORCE_UNROLL
      for (int i = 0; i < group.components; ++i) c[group.start[l] + i] = group.c[i][l];
    });
  }

  // Pure pushes, each `fraction` of its contact's reach.
  void set_pushes(double fraction) {
    double known = 0, wrench = 0;
    each([&](auto& group) {
      const Lanes reach = group.reach();
      for (int l = 0; l < kLanes; ++l)
        if (group.contact[l] >= 0 && reach[l] < kInfinity) known = std::max(known, reach[l]);
    });
    for (int r = 0; r < k_; ++r) wrench = std::max(wrench, std::abs(f_[r]));
    const double fallback = known > 0 ? known : wrench > 0 ? wrench : 1;
    each([&](auto& group) {
      const Lanes reach = group.reach();
      for (int l = 0; l < kLanes; ++l) {
        GRASPFORCE_UNROLL
        for (int i = 1; i < group.components; ++i) group.c[i][l] = 0;
        group.c[0][l] = group.contact[l] < 0 ? 1 : fraction * std::min(reach[l], fallback);
      }
    });
  }

  bool inside() const {
    Lanes worst = splat(kInfinity);
    each([&](const auto& group) { worst = min(worst, group.slack()); });
    return least(worst) > 0;
  }

  // max |f − W c| relative to the wrenches that add up to f.
  double wrench_error() const {
    double worst = 0, scale = 0;
    Lanes parts[kWrench];
    each_and_first([&](const auto& group, auto first) {
      GRASPFORCE_UNROLL
      for (int r = 0; r < kWrench; ++r)
        parts[r] = first ? group.wrench(r, group.c) : parts[r] + group.wrench(r, group.c);
    });
    double wrench[kWrench];
    add_lanes(parts, wrench);
    for (int r = 0; r < k_; ++r) {
      const double error = std::abs(f_[r] - wrench[r]);
      if (!(error <= worst)) worst = error;  // NaN stays
      scale = std::max(scale, std::abs(f_[r]));
    }
    if (worst < 1e-12 * scale) return worst / scale;  // the sizes of the parts only add to that
    each([&](const auto& group) {
      GRASPFORCE_UNROLL
      for (int r = 0; r < kWrench; ++r) {
        Lanes size = {};
        GRASPFORCE_UNROLL
        for (int i = 0; i < group.components; ++i) size += abs(group.W[r][i] * group.c[i]);
        scale = std::max(scale, sum(size));
      }
    });
    return scale > 0 ? worst / scale : 0;
  }

  double largest_force() const {
    double largest = 0;
    each([&](const auto& group) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < group.components; ++i)
        for (int l = 0; l < kLanes; ++l)
          if (group.contact[l] >= 0) largest = std::max(largest, std::abs(group.c[i][l]));
    });
    return largest;
  }

  // ---- derivatives and the Newton step -------------------------------------------------------

  bool evaluate() { return evaluate<true>(); }

  double newton() {
    WrenchSums total;
    each_and_first([&](auto& group, auto first) { group.template add<first>(total); });
    smallest_pivot_ = system_.factor(total, k_);
    add_lanes(total.rhs, nu_);
    for (int r = 0; r < k_; ++r) nu_[r] += f_[r];
    system_.solve(nu_);
    Lanes squared = {};
    each([&](auto& group) { squared += group.step(nu_); });
    return std::sqrt(sum(squared));
  }

  double smallest_pivot() const { return smallest_pivot_; }

  double slope() const {
    Lanes total = {};
    each([&](const auto& group) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < group.components; ++i) total += group.g[i] * group.d[i];
    });
    return sum(total);
  }

  double step_limit() const {
    Lanes worst = {};
    each([&](const auto& group) { worst = max(worst, group.inverse_limit()); });
    const double inverse = -least(-worst);
    return inverse > 0 ? 1 / inverse : kInfinity;
  }

  void advance(double t) {
    each([t](auto& group) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < group.components; ++i) group.c[i] += t * group.d[i];
    });
  }

  void get_multipliers(double* nu) const {
    for (int r = 0; r < layout_.wrench_rows; ++r) nu[r] = 0;
    for (int r = 0; r < k_; ++r) nu[row_[r]] = nu_[r] / cone_weight_;
  }

  double decrement_bound(double lambda) {
    if (!evaluate<false>()) return kInfinity;
    Lanes rhs[kWrench];
    each_and_first(
        [&](auto& group, auto first) { group.template add_gradient<first>(rhs, false); });
    add_lanes(rhs, nu_);
    system_.solve(nu_);
    Lanes squared = {};
    each([&](auto& group) {
      Lanes left[std::decay_t<decltype(group)>::components];
      squared += group.residual(nu_, left);
    });
    return std::sqrt(sum(squared)) / (1 - lambda);
  }

 private:
  template <class Visit>
  void each(Visit visit) {
    std::apply([&](auto&... lists) { (visit_all(lists, visit), ...); }, groups_);
  }
  template <class Visit>
  void each_and_first(Visit visit) const {
    bool first = true;
    each([&](const auto& group) {
      if (first)
        visit(group, std::true_type{});
      else
        visit(group, std::false_type{});
      first = false;
    });
  }
  template <class Visit>
  void each(Visit visit) const {
    std::apply([&](const auto&... lists) { (visit_all(lists, visit), ...); }, groups_);
  }
  template <class List, class Visit>
  static void visit_all(List& list, Visit& visit) {
    for (auto& group : list) visit(group);
  }

  // The same, telling at compile time which group is the first.
  template <class Visit>
  void each_and_first(Visit visit) {
    bool first = true;
    each([&](auto& group) {
      if (first)
        visit(group, std::true_type{});
      else
        visit(group, std::false_type{});
      first = false;
    });
  }

  template <bool with_hessian>
  bool evaluate() {
    Lanes worst = splat(kInfinity);
    each([&](auto& group) {
      worst = min(worst, group.template evaluate<with_hessian>(cone_weight_, limit_weight_,
                                                               layout_.ceilings, layout_.floors));
    });
    return least(worst) > 0;
  }

  static void add_lanes(const Lanes* rhs, double* x) {
    const Lanes low = sums(rhs[0], rhs[1], rhs[2], rhs[3]),
                high = sums(rhs[4], rhs[5], rhs[4], rhs[5]);
    for (int r = 0; r < kWrench; ++r) x[r] = r < kLanes ? low[r] : high[r - kLanes];
  }

  template <int Q>
  void allot_groups(const Structure& structure) {
    auto& list = std::get<std::vector<LaneGroup<Q>>>(groups_);
    list.clear();
    std::size_t members = 0;
    for (const Block& block : structure.blocks()) members += block.components.size() == Q;
    list.resize((members + kLanes - 1) / kLanes);
    members_ += static_cast<int>(members);
    std::size_t next = 0;
    for (const Block& block : structure.blocks()) {
      if (block.components.size() != Q) continue;
      LaneGroup<Q>& group = list[next / kLanes];
      group.two_sided = std::max(group.two_sided, static_cast<int>(block.joints.size()));
      ++next;
    }
    next = 0;
    for (const Block& block : structure.blocks()) {
      if (block.components.size() != Q) continue;
      LaneGroup<Q>& group = list[next / kLanes];
      const int lane = static_cast<int>(next++ % kLanes);
      group.contact[lane] = block.contacts[0];
      group.members = lane + 1;
      group.mask[lane] = 1;
      // Lanes that stay empty read what the last contact reads, and mask it.
      for (int l = lane; l < kLanes; ++l) group.start[l] = block.components[0];
      group.rows.resize(std::max(group.rows.size(), group.two_sided + block.inequalities.size()));
      auto occupy = [lane](LaneRow<Q>& row, int source) {
        row.mask[lane] = 1;
        row.source[lane] = source;
      };
      for (std::size_t r = 0; r < block.joints.size(); ++r) occupy(group.rows[r], block.joints[r]);
      for (std::size_t r = 0; r < block.inequalities.size(); ++r)
        occupy(group.rows[group.two_sided + r], block.inequalities[r]);
    }
  }

  void load_wrench_rows(const Problem& p) {
    each([&](auto& group) { group.load_map(p.W, components_, row_, k_); });
  }

  void load_limits(const Problem& p) {
    const double weakest = std::min(1.0, *p.alpha);
    cone_weight_ = 1 / weakest;
    limit_weight_ = *p.alpha / weakest;
    each([&](auto& group) { group.load_limits(p, layout_, components_); });
  }

  const Layout& layout_;
  const int components_ = layout_.components();
  std::tuple<std::vector<LaneGroup<1>>, std::vector<LaneGroup<3>>, std::vector<LaneGroup<4>>>
      groups_;
  WrenchSystem system_;
  int members_ = 0;  // contacts in the grasp
  int k_ = 0, row_[kWrench] = {};
  double f_[kWrench] = {}, nu_[kWrench] = {};
  double cone_weight_ = 1, limit_weight_ = 1, smallest_pivot_ = 1;
};

}  // namespace graspforce
