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
    for (double& gradient : gradient_) gradient *= w * inverse_w_;  // the slacks remain
    inverse_w_ = 1 / w;
    for (int r = 0; r < kWrench; ++r) {
      F_[r] = softness != nullptr && r < k ? softness[rows[r]] : 0;
      F_over_w_[r] = F_[r] * inverse_w_;
      diagonal_[r] = r < k ? F_over_w_[r] * F_[r] : 1;
      exact_[r] = F_[r] > 0 ? 0 : 1;
      other_[r] = 1 - exact_[r];
    }
  }

  // What the slacks add to the diagonal of the system, F²/w; rows that are not in use get a one.
  const double* diagonal() const { return diagonal_; }
  bool is_soft(int r) const { return F_[r] > 0; }

  // s ← what the forces leave of f, for a missing wrench f − W c.
  void settle(const Lanes* missing) {
    for (int r = 0; r < kWrench; ++r)
      gradient_[r] = is_soft(r) ? missing[r / kLanes][r % kLanes] / F_over_w_[r] : 0;
  }

  // Takes multipliers for granted: their part of the gradient, and of the right-hand side f.
  void subtract(const double* nu, double* f) {
    for (int r = 0; r < kWrench; ++r) {
      gradient_[r] -= F_[r] * nu[r];
      f[r] -= diagonal_[r] * nu[r];
    }
  }
  // Gives the gradient back what they were granted.
  void restore(const double* nu) {
    for (int r = 0; r < kWrench; ++r) gradient_[r] += F_[r] * nu[r];
  }

  // What the gradient adds to the right-hand sides of the rows, 0 to 3 and the others.
  void pull(Lanes& high, Lanes& low) const {
    high += four_at(F_over_w_) * four_at(gradient_);
    low += four_at(F_over_w_ + kLanes) * four_at(gradient_ + kLanes);
  }

  // The step under multipliers ν (room for eight), and its part in λ².
  Lanes step(const double* nu) {
    Lanes squared = {};
    for (int r : {0, kLanes}) {
      const Lanes change = four_at(F_ + r) * four_at(nu + r) - four_at(gradient_ + r);
      std::memcpy(change_ + r, &change, sizeof change);
      squared += change * change;
    }
    return inverse_w_ * squared;
  }

  Lanes slope() const {
    return inverse_w_ * (four_at(gradient_) * four_at(change_) +
                         four_at(gradient_ + kLanes) * four_at(change_ + kLanes));
  }

  void advance(double t) {
    for (int r = 0; r < kRoom; ++r) gradient_[r] += t * change_[r];
  }

  // Errors of the rows, of which soft ones become less than any.
  void mask(Lanes& high, Lanes& low) const {
    high = four_at(exact_) * high - four_at(other_);
    low = four_at(exact_ + kLanes) * low - four_at(other_ + kLanes);
  }

 private:
  static constexpr int kRoom = 2 * kLanes;  // zeros behind the last row

  double F_[kRoom] = {}, F_over_w_[kRoom] = {}, diagonal_[kWrench] = {};
  // The gradient w s stands for the slacks, and its change for their step.
  double gradient_[kRoom] = {}, change_[kRoom] = {};
  double exact_[kRoom] = {};  // 1 for a row that is not soft
  double other_[kRoom] = {0, 0, 0, 0, 0, 0, 1, 1};
  double inverse_w_ = 1;
};

}  // namespace graspforce
