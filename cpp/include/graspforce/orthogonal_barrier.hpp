// The barrier of barrier.hpp with its Newton step by least squares: slower, and right to the last
// digits where the Hessian is too close to singular for Cholesky. The last steps of a hard problem
// are taken on it.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/block_point.hpp"
#include "graspforce/least_squares.hpp"

namespace graspforce {

class OrthogonalBarrier : public BlockPoint {
 public:
  OrthogonalBarrier(const Blocks& blocks, LeastSquares& least_squares)
      : BlockPoint(blocks),
        least_squares_(least_squares),
        g_(c_),
        nu_(blocks.layout().wrench_rows) {}

  void set_weights(double cone_weight, double limit_weight) {
    cone_weight_ = cone_weight;
    limit_weight_ = limit_weight;
  }

  // Rows of G and the scaled gradient γ: ∇²Phi = Gᵀ G and ∇Phi = Gᵀ γ. False outside.
  bool evaluate() {
    if (!find_gradient()) return false;
    least_squares_.clear();
    const double root = std::sqrt(limit_weight_);
    for (int b = 0; b < count(); ++b) {
      const int q = part(b).q;
      if (part(b).slack_row >= 0) {
        double* row = least_squares_.row(b, 0);
        row[0] = std::sqrt(cone_weight_);
        row[1] = row[0] * c(b)[0];
      }
      for (const Tip& tip : part(b).tips) {
        const int dim = tip.cone.dim;
        double s[4] = {}, z[4], scaled[4], V[16];
        tip.cone.lift(c(b) + tip.first, s);
        lorentz::center(s, dim, tip.weight * cone_weight_, z);
        lorentz::scale(s, z, dim, V, scaled);
        for (int i = 0; i < dim; ++i) {
          double* row = least_squares_.row(b, tip.first + i);
          for (int j = 0; j < dim; ++j) row[tip.first + j] = V[i * dim + j] * tip.cone.weight(j);
          row[q] = -scaled[i];
        }
      }
      for (int r = 0; r < part(b).rows; ++r) {
        const double* a = part(b).a + r * q;
        const double t = dot(a, c(b), q);
        const double up = 1 / (part(b).hi[r] - t), down = 1 / (t - part(b).lo[r]);
        const double size = std::hypot(up, down);
        double* row = least_squares_.row(b, q + r);
        add_scaled(root * size, a, q, row);
        if (size > 0) row[q] = root * (up - down) / size;
      }
    }
    return true;
  }

  // Newton step d from the evaluated point, with the multipliers ν; returns the decrement λ. A
  // wrench error within rounding is not corrected: where W is nearly singular that would take
  // unbounded forces.
  double newton() {
    missing_wrench(missing_.data());
    if (wrench_error() < kRounding) std::fill(missing_.begin(), missing_.end(), 0.0);
    least_squares_.factor(missing_.data());
    least_squares_.step(1, 0, d_.data());
    least_squares_.multipliers(1, 0, nu_.data());
    return least_squares_.length(1);
  }
  double newton_from_multipliers() { return newton(); }
  bool sound() const { return true; }

  double slope() const { return dot(g_.data(), d_.data(), static_cast<int>(g_.size())); }

  // As Barrier's.
  double decrement_bound(double lambda) {
    if (!find_gradient()) return kInfinity;
    return least_squares_.project(g_.data(), nu_.data()) / (1 - lambda);
  }

  void get_multipliers(double* nu) const {
    std::fill(nu, nu + blocks_.layout().wrench_rows, 0.0);
    for (int r = 0; r < blocks_.k(); ++r) nu[blocks_.row(r)] = nu_[r] / cone_weight_;
  }

 private:
  bool find_gradient() {
    std::fill(g_.begin(), g_.end(), 0.0);
    double* g = g_.data();
    for (int b = 0; b < count(); g += part(b++).q) {
      if (part(b).slack_row >= 0) g[0] = cone_weight_ * c(b)[0];
      for (const Tip& tip : part(b).tips)
        if (!tip.cone.add_derivatives(c(b) + tip.first, tip.weight * cone_weight_, g + tip.first,
                                      nullptr, 0))
          return false;
      for (int r = 0; r < part(b).rows; ++r) {
        const double* a = part(b).a + r * part(b).q;
        const double t = dot(a, c(b), part(b).q);
        const double above = part(b).hi[r] - t, below = t - part(b).lo[r];
        if (!(above > 0) || !(below > 0)) return false;
        add_scaled(limit_weight_ * (1 / above - 1 / below), a, part(b).q, g);
      }
    }
    return true;
  }

  static constexpr double kRounding = 1e-13;

  LeastSquares& least_squares_;
  std::vector<double> g_, nu_;
  double cone_weight_ = 1, limit_weight_ = 1;
};

}  // namespace graspforce
