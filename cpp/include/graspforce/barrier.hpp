// The weighted barrier function Phi on {W c = f} and its Newton step.
//
// In every block the Hessian H and the gradient g of Phi are dense and small; the blocks meet only
// in W c = f. With H = L Lᵀ, Z = L⁻¹ Wᵀ, u = L⁻¹ g the step of the whole problem is
//
//     (Σ ZᵀZ) ν = f − W c + Σ Zᵀu        k × k, for any number of contacts
//     d = L⁻ᵀ (Z ν − u)                  in each block
//     λ² = Σ ‖Z ν − u‖²                  the decrement, d's restoring part included
//
// so no null space is formed, and the residual f − W c is removed by the same step. Phi is divided
// by its unit, the least weight of its terms: each is then standard self-concordant.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/block_point.hpp"
#include "graspforce/schur.hpp"

namespace graspforce {

class Barrier : public BlockPoint {
 public:
  explicit Barrier(const Blocks& blocks)
      : BlockPoint(blocks),
        arena_(unknowns(blocks.layout()) *
               (2 + largest_block(blocks.layout()) + blocks.layout().wrench_rows)),
        schur_(blocks.layout().wrench_rows),
        nu_(blocks.layout().wrench_rows),
        last_nu_(nu_) {
    work_.reserve(most_blocks(blocks.layout()));
  }

  // Makes the vectors that are kept by block; needed after Blocks::allot. Does not allocate.
  void allot() {
    BlockPoint::allot();
    const std::size_t k = blocks_.layout().wrench_rows;
    std::size_t total = 0;
    for (const BlockData& part : blocks_.parts()) total += part.q * (2 + part.q + k);
    arena_.reset(total);
    work_.clear();
    for (const BlockData& part : blocks_.parts()) {
      const std::size_t q = part.q;
      work_.push_back({arena_.take(q), arena_.take(q), arena_.take(q * q), arena_.take(q * k)});
    }
  }

  void set_weights(const Problem& p) {
    cone_weight_ = 1 / barrier_unit(blocks_.layout(), p);
    limit_weight_ = *p.alpha * cone_weight_;
  }

  double cone_weight() const { return cone_weight_; }
  double limit_weight() const { return limit_weight_; }

  // ---- derivatives and the Newton step -------------------------------------------------------

  // Gradient (Eq. 7, 12) and Hessian (Eq. 7, 14) at the point; false when it is outside.
  bool evaluate() { return evaluate<true>(); }

  // Newton step d from the evaluated point, with the multipliers ν; returns the decrement λ.
  double newton() {
    const int k = blocks_.k();
    schur_.clear(k);
    std::copy(blocks_.f(), blocks_.f() + k, nu_.begin());
    for (int b = 0; b < count(); ++b) {
      const int q = part(b).q;
      const Work& w = work_[b];
      cholesky(w.H, q);
      std::copy(part(b).Wt, part(b).Wt + q * k, w.Z);
      std::copy(w.g, w.g + q, w.u);
      forward_substitute(w.H, q, w.Z, k);
      forward_substitute(w.H, q, w.u);
      schur_.add(w.Z, q);
      for (int i = 0; i < q; ++i)
        for (int r = 0; r < k; ++r)
          nu_[r] += w.Z[i * k + r] * w.u[i] - part(b).Wt[i * k + r] * c(b)[i];
    }
    sound_ = schur_.factor() >= kSuspectPivot;
    schur_.solve(nu_.data());
    double squared = 0;
    for (int b = 0; b < count(); ++b) {
      const int q = part(b).q;
      const Work& w = work_[b];
      for (int i = 0; i < q; ++i) {
        d(b)[i] = dot(w.Z + i * k, nu_.data(), k) - w.u[i];
        squared += d(b)[i] * d(b)[i];
      }
      back_substitute(w.H, q, d(b));
    }
    return std::sqrt(squared);
  }

  // The same, solved for the change of ν alone: near the minimum ∇Phi − Wᵀν is small, and with it
  // the rounding that would leave W c = f unbalanced where contacts are close to the boundary.
  double newton_from_multipliers() {
    const int k = blocks_.k();
    std::copy_n(nu_.begin(), k, last_nu_.begin());
    for (int b = 0; b < count(); ++b)
      for (int i = 0; i < part(b).q; ++i)
        work_[b].g[i] -= dot(part(b).Wt + i * k, last_nu_.data(), k);
    const double lambda = newton();
    add_scaled(1, last_nu_.data(), k, nu_.data());
    return lambda;
  }

  // False when the last step's system was nearly singular.
  bool sound() const { return sound_; }

  // ∇Phi·d: the slope of Phi along the last step, at the point last evaluated.
  double slope() const {
    double sum = 0;
    for (int b = 0; b < count(); ++b) sum += dot(work_[b].g, d(b), part(b).q);
    return sum;
  }

  // The multipliers of W c = f for Phi itself, in the problem's rows; unused rows get zero.
  void get_multipliers(double* nu) const {
    std::fill(nu, nu + blocks_.layout().wrench_rows, 0.0);
    for (int r = 0; r < blocks_.k(); ++r) nu[blocks_.row(r)] = nu_[r] / cone_weight_;
  }

  // Bound on the decrement at the point a whole step of decrement λ < 1 led to, from its gradient
  // and the step's own factors: H there is at least (1 − λ)² H. Replaces ν by the multipliers that
  // fit the new gradient best.
  double decrement_bound(double lambda) {
    if (!evaluate<false>()) return kInfinity;
    const int k = blocks_.k();
    std::fill_n(nu_.begin(), k, 0.0);
    for (int b = 0; b < count(); ++b) {
      const Work& w = work_[b];
      std::copy(w.g, w.g + part(b).q, w.u);
      forward_substitute(w.H, part(b).q, w.u);
      for (int i = 0; i < part(b).q; ++i) add_scaled(w.u[i], w.Z + i * k, k, nu_.data());
    }
    schur_.solve(nu_.data());
    double squared = 0;
    for (int b = 0; b < count(); ++b)
      for (int i = 0; i < part(b).q; ++i) {
        const double left = work_[b].u[i] - dot(work_[b].Z + i * k, nu_.data(), k);
        squared += left * left;
      }
    return std::sqrt(squared) / (1 - lambda);
  }

 private:
  template <bool with_hessian>
  bool evaluate() {
    for (int b = 0; b < count(); ++b) {
      const int q = part(b).q;
      const Work& w = work_[b];
      std::fill(w.g, w.g + q, 0.0);
      if (with_hessian) std::fill(w.H, w.H + q * q, 0.0);
      if (part(b).slack_row >= 0) {
        w.g[0] = cone_weight_ * c(b)[0];
        if (with_hessian) w.H[0] = cone_weight_;
      }
      for (const Tip& tip : part(b).tips)
        if (!tip.cone.add_derivatives(c(b) + tip.first, tip.weight * cone_weight_, w.g + tip.first,
                                      with_hessian ? w.H + tip.first * (q + 1) : nullptr, q))
          return false;
      for (int r = 0; r < part(b).rows; ++r) {
        const double* a = part(b).a + r * q;
        const double t = dot(a, c(b), q);
        const double above = part(b).hi[r] - t, below = t - part(b).lo[r];
        if (!(above > 0) || !(below > 0)) return false;
        const double up = 1 / above, down = 1 / below;
        add_scaled(limit_weight_ * (up - down), a, q, w.g);
        if (with_hessian) add_outer(a, q, limit_weight_ * (up * up + down * down), w.H);
      }
    }
    return true;
  }

  struct Work {
    double *g, *u;  // q
    double *H, *Z;  // q × q, then its factor; q × k
  };

  std::vector<Work> work_;
  Arena arena_;
  Schur schur_;
  std::vector<double> nu_, last_nu_;
  double cone_weight_ = 1, limit_weight_ = 1;
  bool sound_ = true;
};

}  // namespace graspforce
