// The kernels of four contacts at a time, one a lane: barrier, step and limits with everything of a
// contact's size fixed when compiled, and the 6 × 6 system that they add up to.
//
// Lanes that are left over hold a contact without W and without limits, whose step is masked to
// zero. See barrier.hpp for the mathematics; the names are the same.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/cone.hpp"
#include "graspforce/lanes.hpp"
#include "graspforce/layout.hpp"

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

  // Height mu n and radius ‖w t‖ of y: inside the cone the height is the larger.
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
    for (int i = 1; i < Q; ++i) {
      GRASPFORCE_UNROLL
      for (int k = 0; k < i; ++k) x[i] -= H[at(i, k)] * x[k];
    }
  }
  void back(Lanes* x) const {
    GRASPFORCE_UNROLL
    for (int i = Q - 2; i >= 0; --i) {
      GRASPFORCE_UNROLL
      for (int k = i + 1; k < Q; ++k) x[i] -= H[at(k, i)] * x[k];
    }
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
    GRASPFORCE_UNROLL
    for (int i = 0; i < Q && less_forces; ++i) x[i] -= c[i];
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
  double factor(const WrenchSums& totals, int k) {
    double entries[WrenchSums::kTriangle + 3];
    for (int i = 0; i < WrenchSums::kTriangle; i += kLanes) {
      const Lanes* v = totals.S + i;
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
    for (int i = 1; i < kWrench; ++i) {
      GRASPFORCE_UNROLL
      for (int j = 0; j < i; ++j) x[i] -= L_[i][j] * x[j];
    }
    GRASPFORCE_UNROLL
    for (int i = 0; i < kWrench; ++i) x[i] *= inverse_[i];
    GRASPFORCE_UNROLL
    for (int i = kWrench - 2; i >= 0; --i) {
      GRASPFORCE_UNROLL
      for (int j = i + 1; j < kWrench; ++j) x[i] -= L_[j][i] * x[j];
    }
  }

 private:
  double L_[kWrench][kWrench], inverse_[kWrench];
};

}  // namespace graspforce
