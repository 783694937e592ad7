// The system that ties the blocks together, for any number of wrench rows.
#pragma once

#include <algorithm>
#include <vector>

#include "graspforce/linalg.hpp"

namespace graspforce {

// Pivot of S, relative to its diagonal entry, below which W may have dependent rows.
inline constexpr double kSuspectPivot = 1e-10;

// The k × k system S = Σ W_i H_i⁻¹ W_iᵀ.
class Schur {
 public:
  explicit Schur(int largest) : S_(static_cast<std::size_t>(largest) * largest) {}

  void clear(int k) {
    k_ = k;
    std::fill_n(S_.begin(), k * k, 0.0);
  }
  void add(const double* Z, int q) {  // S += ZᵀZ for a q × k block, lower triangle
    for (int i = 0; i < q; ++i) {
      const double* z = Z + i * k_;
      for (int r = 0; r < k_; ++r)
        for (int s = 0; s <= r; ++s) S_[r * k_ + s] += z[r] * z[s];
    }
  }
  // Returns the smallest pivot relative to its diagonal: tiny when W has dependent rows, or when
  // the point is extremely close to the boundary.
  double factor() { return cholesky(S_.data(), k_); }
  void solve(double* x) const {
    forward_substitute(S_.data(), k_, x);
    back_substitute(S_.data(), k_, x);
  }

 private:
  int k_ = 0;
  std::vector<double> S_;
};

}  // namespace graspforce
