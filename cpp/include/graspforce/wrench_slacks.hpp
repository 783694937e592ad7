// The slacks of a soft wrench for the lanes: of a row with softness F, kept as W c + F s = f, the
// slack s costs ½ s² (see blocks.hpp). Of an exact row F and s are zero.
#pragma once

#include <cstring>

#include "graspforce/wrench_system.hpp"

namespace graspforce {

class WrenchSlacks {
 public:
  // Takes the softness of the rows in use, rows[0] to rows[k − 1] of the problem's (null: all are
  // exact); `w` is the weight of the cones.
  void load(const double* softness, const int* rows, int k, double w) {
    inverse_w_ = 1 / w;
    for (int r = 0; r < kWrench; ++r) {
      F_[r] = softness != nullptr && r < k ? softness[rows[r]] : 0;
      diagonal_[r] = r < k ? inverse_w_ * F_[r] * F_[r] : 1;
      exact_[r] = F_[r] > 0 ? 0 : 1;
    }
  }

  // What the slacks add to the diagonal of the system, F²/w; rows that are not in use get a one.
  const double* diagonal() const { return diagonal_; }
  bool is_soft(int r) const { return F_[r] > 0; }

  // s ← what the forces leave of f, for a missing wrench f − W c.
  void settle(const Lanes* missing) {
    for (int r = 0; r < kWrench; ++r)
      s_[r] = is_soft(r) ? missing[r / kLanes][r % kLanes] / F_[r] : 0;
  }

  void evaluate(double w) {
    for (int r = 0; r < kRoom; ++r) gradient_[r] = w * s_[r];
  }

  // Takes multipliers for granted: their part of the gradient, and of the right-hand side f.
  void subtract(const double* nu, double* f) {
    for (int r = 0; r < kWrench; ++r) {
      gradient_[r] -= F_[r] * nu[r];
      f[r] -= diagonal_[r] * nu[r];
    }
  }

  // What the gradient adds to the right-hand side of row r.
  double pull(int r) const { return inverse_w_ * F_[r] * gradient_[r]; }

  // The step under multipliers ν (room for eight), and its part in λ².
  Lanes step(const double* nu) {
    Lanes squared = {};
    for (int r : {0, kLanes}) {
      const Lanes left = four_at(F_ + r) * four_at(nu + r) - four_at(gradient_ + r);
      const Lanes ds = inverse_w_ * left;
      std::memcpy(ds_ + r, &ds, sizeof ds);
      squared += left * ds;
    }
    return squared;
  }

  Lanes slope() const {
    return four_at(gradient_) * four_at(ds_) + four_at(gradient_ + kLanes) * four_at(ds_ + kLanes);
  }

  void advance(double t) {
    for (int r = 0; r < kRoom; ++r) s_[r] += t * ds_[r];
  }

  // Errors of the rows, of which soft ones become less than any.
  void mask(Lanes& high, Lanes& low) const {
    high = four_at(exact_) * high - (1 - four_at(exact_));
    low = four_at(exact_ + kLanes) * low - (1 - four_at(exact_ + kLanes));
  }

 private:
  static constexpr int kRoom = 2 * kLanes;  // zeros behind the last row

  double F_[kRoom] = {}, s_[kRoom] = {}, ds_[kRoom] = {}, gradient_[kRoom] = {};
  double exact_[kRoom] = {};  // 1 for a row that is not soft
  double diagonal_[kWrench] = {};
  double inverse_w_ = 1;
};

}  // namespace graspforce
