// Rank of the grasp map: which rows of W c = f are independent, and whether f fits the others.
//
// Two point contacts, planar grasps and parallel frictionless fingers have a W of lower rank.
// Newton's method then works on an independent set of rows. The rest of f is either implied by
// those rows or out of reach for these contacts, whatever their forces.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/layout.hpp"

namespace graspforce {

struct Rank {
  std::vector<int> rows;  // an independent set, best conditioned first
  bool reachable;         // f lies in the range of W
};

inline constexpr double kRankTolerance = 1e-10;
inline constexpr double kReachTolerance = 1e-9;

// Gram-Schmidt with pivoting and reorthogonalisation over the rows of W, scaled to unit length
// because forces and torques have different units; contacts out of the grasp do not count.
inline Rank examine_rank(const Layout& layout, const Problem& p) {
  const int k = layout.wrench_rows, m = layout.components();
  std::vector<double> Q(static_cast<std::size_t>(k) * m), f(p.f, p.f + k), size(k), length(k, 1);
  std::vector<bool> used(k, false);
  double largest_f = 0;  // what rounding in f is measured by
  for (int r = 0; r < k; ++r) largest_f = std::max(largest_f, std::abs(p.f[r]));
  for (int r = 0; r < k; ++r) {
    double sum = 0, largest = 0;
    for (int i = 0, c = 0; i < layout.contacts(); ++i)
      for (int d = 0; d < static_cast<int>(layout.models[i]); ++d, ++c) {
        Q[r * m + c] = p.in_grasp(i) ? p.W[r * m + c] : 0;
        largest = std::max(largest, std::abs(Q[r * m + c]));
      }
    for (int c = 0; c < m && largest > 0; ++c) sum += std::pow(Q[r * m + c] / largest, 2);
    length[r] = sum > 0 ? largest * std::sqrt(sum) : 1;
    for (int c = 0; c < m; ++c) Q[r * m + c] /= length[r];
    f[r] /= length[r];
    size[r] = std::abs(f[r]);
  }
  // Eliminating row q from row r eliminates it from f as well; what is left of f on a row that
  // vanishes is out of reach.
  Rank rank{{}, true};
  while (static_cast<int>(rank.rows.size()) < k) {
    int best = -1;
    double longest = kRankTolerance;
    for (int r = 0; r < k; ++r) {
      double sum = 0;
      for (int c = 0; c < m && !used[r]; ++c) sum += Q[r * m + c] * Q[r * m + c];
      if (std::sqrt(sum) > longest) {
        longest = std::sqrt(sum);
        best = r;
      }
    }
    if (best < 0) break;
    used[best] = true;
    rank.rows.push_back(best);
    for (int c = 0; c < m; ++c) Q[best * m + c] /= longest;
    f[best] /= longest;
    size[best] /= longest;
    for (int r = 0; r < k; ++r) {
      for (int pass = 0; pass < 2 && !used[r]; ++pass) {
        double along = 0;
        for (int c = 0; c < m; ++c) along += Q[r * m + c] * Q[best * m + c];
        for (int c = 0; c < m; ++c) Q[r * m + c] -= along * Q[best * m + c];
        f[r] -= along * f[best];
        size[r] += std::abs(along) * size[best];
      }
    }
  }
  for (int r = 0; r < k; ++r)
    if (!used[r] &&
        std::abs(f[r]) * length[r] > kReachTolerance * std::max(size[r] * length[r], largest_f))
      rank.reachable = false;
  return rank;
}

}  // namespace graspforce
