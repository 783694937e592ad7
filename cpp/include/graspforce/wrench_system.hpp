// The 6 × 6 system that ties four contacts at a time together: schur.hpp for the lanes.
#pragma once

#include <cstring>

#include "graspforce/lanes.hpp"
#include "graspforce/schur.hpp"

namespace graspforce {

inline constexpr int kWrench = 6;  // rows of W that the kernels are made for

// What the groups add up to, lane by lane: the lower triangle of Σ W H⁻¹ Wᵀ, row by row, then the
// right-hand side, f + Σ W (H⁻¹ g − c).
template <class V>
struct SumsOf {
  static constexpr int kTriangle = kWrench * (kWrench + 1) / 2;
  V v[kTriangle + kWrench];

  V* rhs() { return v + kTriangle; }
  const V& at(int r, int s) const { return v[r * (r + 1) / 2 + s]; }
  const V& rhs(int r) const { return v[kTriangle + r]; }
};
using WrenchSums = SumsOf<Lanes>;

// The 6 × 6 system, S = L D Lᵀ.
//
// The right-hand side is a seventh row of it, which eliminating the columns turns into D⁻¹ L⁻¹
// times it. A column is two vectors: rows 0 to 3, then rows 4, 5 and the right-hand side. Places
// above the diagonal hold anything.
class WrenchSystem {
 public:
  // What rows get on the diagonal beside their sums: a soft one D, one that is not in use a one.
  void set_diagonal(const double* D) {
    for (int r = 0; r < kWrench; ++r) diagonal_[r][r % kLanes] = D[r];
  }

  // Takes the sums over the lanes and solves for x. False when a pivot is negligible beside
  // its diagonal entry: W may have dependent rows.
  GRASPFORCE_INLINE bool solve(const WrenchSums& s, double* x) {
    Lanes upper[kWrench] = {}, lower[kWrench];  // the last two have no upper rows
    upper[0] = sums(s.at(0, 0), s.at(1, 0), s.at(2, 0), s.at(3, 0));
    upper[1] = sums(s.at(3, 3), s.at(1, 1), s.at(2, 1), s.at(3, 1));
    upper[2] = sums(s.rhs(5), s.at(5, 5), s.at(2, 2), s.at(3, 2));
    upper[3] = splat(upper[1][0]);
    GRASPFORCE_UNROLL
    for (int j = 0; j < 5; ++j) lower[j] = sums(s.at(4, j), s.at(5, j), s.rhs(j), s.rhs(j));
    lower[5] = shuffle<0, 1, 0, 0>(upper[2], upper[2]);
    const bool sound = eliminate(upper, lower);
    back(x);
    return sound;
  }

  // Solves for another right-hand side, in place.
  GRASPFORCE_INLINE void solve(double* x) {
    GRASPFORCE_UNROLL
    for (int j = 0; j < kWrench; ++j) {
      GRASPFORCE_UNROLL
      for (int i = j + 1; i < kWrench; ++i) x[i] -= L_[j][i] * x[j];
      L_[j][kWrench] = x[j] * inverse_[j];
    }
    back(x);
  }

 private:
  // Two columns at a time, as in LaneGroup::factor.
  GRASPFORCE_INLINE bool eliminate(Lanes* upper, Lanes* lower) {
    bool sound = true;
    auto entry = [](int row, Lanes high, Lanes low) {
      return row < kLanes ? broadcast(high, row) : broadcast(low, row - kLanes);
    };
    Lanes before[kWrench];
    GRASPFORCE_UNROLL
    for (int j = 0; j < kWrench; ++j) {
      (j < kLanes ? upper : lower)[j] += diagonal_[j];
      before[j] = entry(j, upper[j], lower[j]);
    }
    GRASPFORCE_UNROLL
    for (int j = 0; j < kWrench; j += 2) {
      const bool tall = j < kLanes;  // the columns reach into the upper rows
      const Lanes p = entry(j, upper[j], lower[j]);
      const Lanes q = entry(j + 1, upper[j], lower[j]);
      const Lanes r = entry(j + 1, upper[j + 1], lower[j + 1]);
      const Lanes det = p * r - q * q;
      sound &= (p[0] > kSuspectPivot * before[j][0]) &
               (det[0] > kSuspectPivot * before[j + 1][0] * p[0]);
      const Lanes first = max(p, 1e-15 * before[j]), inverse = 1 / first;
      const Lanes inverse_det = 1 / max(det, 1e-15 * before[j + 1] * first);
      inverse_[j] = inverse[0];
      inverse_[j + 1] = (first * inverse_det)[0];
      const Lanes high = tall ? inverse * upper[j] : Lanes{}, low = inverse * lower[j];
      const Lanes t_high = tall ? p * upper[j + 1] - q * upper[j] : Lanes{};
      const Lanes t_low = p * lower[j + 1] - q * lower[j];
      GRASPFORCE_UNROLL
      for (int i = j + 2; i < kWrench; ++i) {
        const Lanes u = entry(i, upper[j], lower[j]), t = inverse * entry(i, t_high, t_low);
        if (i < kLanes) upper[i] = (upper[i] - u * high) - inverse_det * (t * t_high);
        lower[i] = (lower[i] - u * low) - inverse_det * (t * t_low);
      }
      keep(j, high, low);
      keep(j + 1, inverse_det * t_high, inverse_det * t_low);
    }
    return sound;
  }
  GRASPFORCE_INLINE void keep(int j, Lanes high, Lanes low) {
    if (j < kLanes) std::memcpy(L_[j], &high, sizeof high);
    std::memcpy(L_[j] + kLanes, &low, sizeof low);
  }

  // x ← L⁻ᵀ x from the seventh row.
  GRASPFORCE_INLINE void back(double* x) const {
    GRASPFORCE_UNROLL
    for (int j = kWrench - 1; j >= 0; --j) {
      x[j] = L_[j][kWrench];
      GRASPFORCE_UNROLL
      for (int i = kWrench - 1; i > j; --i) x[j] -= L_[j][i] * x[i];
    }
  }

  Lanes diagonal_[kWrench] = {};                                // column by column
  double L_[kWrench][2 * kLanes] = {}, inverse_[kWrench] = {};  // L column by column
};

}  // namespace graspforce
