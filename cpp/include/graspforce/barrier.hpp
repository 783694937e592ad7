// The weighted barrier function Phi on {W c = f} and its Newton step.
//
// In every block the Hessian H and the gradient g of Phi are dense and small; the blocks meet only
// in W c = f. With H = L Lᵀ, Z = L⁻¹ Wᵀ, u = L⁻¹ g the step of the whole problem is
//
//     (Σ ZᵀZ) ν = f − W c + Σ Zᵀu        k × k, whatever the number of contacts
//     d = L⁻ᵀ (Z ν − u)                  in each block
//     λ² = Σ ‖Z ν − u‖²                  the decrement, d's restoring part included
//
// so no null space is formed, and the residual f − W c is removed by the same step. Phi is divided
// by min(1, alpha): each of its terms is then standard self-concordant.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/blocks.hpp"
#include "graspforce/schur.hpp"

namespace graspforce {

class Barrier {
 public:
  explicit Barrier(const Blocks& blocks)
      : blocks_(blocks),
        arena_(blocks.layout().components() *
               (4 + largest_block(blocks.layout()) + blocks.layout().wrench_rows)),
        schur_(blocks.layout().wrench_rows),
        nu_(blocks.layout().wrench_rows),
        last_nu_(nu_) {
    work_.reserve(blocks.layout().contacts());
  }

  // Makes the vectors that are kept by block; needed after Blocks::allot. Does not allocate.
  void allot() {
    const std::size_t k = blocks_.layout().wrench_rows;
    std::size_t total = 0;
    for (const Part& part : blocks_.parts()) total += part.q * (4 + part.q + k);
    arena_.reset(total);
    work_.clear();
    for (const Part& part : blocks_.parts()) {
      const std::size_t q = part.q;
      work_.push_back({arena_.take(q), arena_.take(q), arena_.take(q), arena_.take(q),
                       arena_.take(q * q), arena_.take(q * k)});
    }
  }

  void set_weights(double alpha) {
    cone_weight_ = 1 / std::min(1.0, alpha);
    limit_weight_ = alpha * cone_weight_;
  }

  double cone_weight() const { return cone_weight_; }
  double limit_weight() const { return limit_weight_; }

  // ---- the point ---------------------------------------------------------------------------

  void set_forces(const double* c) {
    for (std::size_t b = 0; b < work_.size(); ++b)
      for (int i = 0; i < part(b).q; ++i) work_[b].c[i] = c[part(b).block->components[i]];
  }

  // c ← 2 last − before.
  void extrapolate(const double* last, const double* before) {
    for (std::size_t b = 0; b < work_.size(); ++b)
      for (int i = 0; i < part(b).q; ++i) {
        const int component = part(b).block->components[i];
        work_[b].c[i] = 2 * last[component] - before[component];
      }
  }

  // Writes c in the problem's order; contacts out of the grasp get zero.
  void get_forces(double* c) const {
    std::fill(c, c + blocks_.layout().components(), 0.0);
    for (std::size_t b = 0; b < work_.size(); ++b)
      for (int i = 0; i < part(b).q; ++i) c[part(b).block->components[i]] = work_[b].c[i];
  }

  // Pure pushes, each `fraction` of its contact's reach; less in a block where that would pass a
  // limit that weaker pushes keep to.
  void set_pushes(double fraction) {
    for (std::size_t b = 0; b < work_.size(); ++b) {
      std::fill(work_[b].c, work_[b].c + part(b).q, 0.0);
      for (const Tip& tip : part(b).tips) work_[b].c[tip.first] = fraction * tip.reach;
      double used = kMostUsed;
      for (int r = 0; r < part(b).rows; ++r) {
        const double t = dot(part(b).a + r * part(b).q, work_[b].c, part(b).q);
        const double limit = t > 0 ? part(b).hi[r] : part(b).lo[r];
        if (t * limit > 0) used = std::max(used, t / limit);
      }
      for (const Tip& tip : part(b).tips) work_[b].c[tip.first] *= kMostUsed / used;
    }
  }

  bool inside() const {
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const double* c = work_[b].c;
      for (const Tip& tip : part(b).tips)
        if (!(tip.cone.margin(c + tip.first) > 0)) return false;
      for (int r = 0; r < part(b).rows; ++r) {
        const double t = dot(part(b).a + r * part(b).q, c, part(b).q);
        if (!(part(b).hi[r] > t) || !(t > part(b).lo[r])) return false;
      }
    }
    return true;
  }

  bool balanced() const { return wrench_error() < kBalanced; }
  double wrench_error() const {
    return relative_wrench_error(blocks_, [this](std::size_t b) { return work_[b].c; });
  }

  // Whether the forces are out of all proportion to the limits.
  bool runaway() const {
    double largest = 0;
    for (std::size_t b = 0; b < work_.size(); ++b)
      for (int i = 0; i < part(b).q; ++i) largest = std::max(largest, std::abs(work_[b].c[i]));
    return largest > kRunaway * blocks_.size();
  }

  // ---- derivatives and the Newton step -------------------------------------------------------

  // Gradient (Eq. 7, 12) and Hessian (Eq. 7, 14) at the point; false when it is outside.
  bool evaluate() { return evaluate<true>(); }

  // Newton step d from the evaluated point, with the multipliers ν; returns the decrement λ.
  double newton() {
    const int k = blocks_.k();
    schur_.clear(k);
    std::copy(blocks_.f(), blocks_.f() + k, nu_.begin());
    for (std::size_t b = 0; b < work_.size(); ++b) {
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
          nu_[r] += w.Z[i * k + r] * w.u[i] - part(b).Wt[i * k + r] * w.c[i];
    }
    sound_ = schur_.factor() >= kSuspectPivot;
    schur_.solve(nu_.data());
    double squared = 0;
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const int q = part(b).q;
      const Work& w = work_[b];
      for (int i = 0; i < q; ++i) {
        w.d[i] = dot(w.Z + i * k, nu_.data(), k) - w.u[i];
        squared += w.d[i] * w.d[i];
      }
      back_substitute(w.H, q, w.d);
    }
    return std::sqrt(squared);
  }

  // The same, solved for the change of ν alone: near the minimum ∇Phi − Wᵀν is small, and with it
  // the rounding that would leave W c = f unbalanced where contacts are close to the boundary.
  double newton_from_multipliers() {
    const int k = blocks_.k();
    std::copy_n(nu_.begin(), k, last_nu_.begin());
    for (std::size_t b = 0; b < work_.size(); ++b)
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
    for (std::size_t b = 0; b < work_.size(); ++b) sum += dot(work_[b].g, work_[b].d, part(b).q);
    return sum;
  }

  // Largest t for which the point plus t d stays inside.
  double step_limit() const {
    double limit = kInfinity;
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const Work& w = work_[b];
      for (const Tip& tip : part(b).tips)
        limit = std::min(limit, tip.cone.step_limit(w.c + tip.first, w.d + tip.first));
      for (int r = 0; r < part(b).rows; ++r) {
        const double* a = part(b).a + r * part(b).q;
        const double t = dot(a, w.c, part(b).q), change = dot(a, w.d, part(b).q);
        if (change > 0) limit = std::min(limit, (part(b).hi[r] - t) / change);
        if (change < 0) limit = std::min(limit, (part(b).lo[r] - t) / change);
      }
    }
    return limit;
  }

  void advance(double t) {
    for (std::size_t b = 0; b < work_.size(); ++b)
      for (int i = 0; i < part(b).q; ++i) work_[b].c[i] += t * work_[b].d[i];
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
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const Work& w = work_[b];
      std::copy(w.g, w.g + part(b).q, w.u);
      forward_substitute(w.H, part(b).q, w.u);
      for (int i = 0; i < part(b).q; ++i) add_scaled(w.u[i], w.Z + i * k, k, nu_.data());
    }
    schur_.solve(nu_.data());
    double squared = 0;
    for (std::size_t b = 0; b < work_.size(); ++b)
      for (int i = 0; i < part(b).q; ++i) {
        const double left = work_[b].u[i] - dot(work_[b].Z + i * k, nu_.data(), k);
        squared += left * left;
      }
    return std::sqrt(squared) / (1 - lambda);
  }

 private:
  template <bool with_hessian>
  bool evaluate() {
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const int q = part(b).q;
      const Work& w = work_[b];
      std::fill(w.g, w.g + q, 0.0);
      if (with_hessian) std::fill(w.H, w.H + q * q, 0.0);
      for (const Tip& tip : part(b).tips)
        if (!tip.cone.add_derivatives(w.c + tip.first, cone_weight_, w.g + tip.first,
                                      with_hessian ? w.H + tip.first * (q + 1) : nullptr, q))
          return false;
      for (int r = 0; r < part(b).rows; ++r) {
        const double* a = part(b).a + r * q;
        const double t = dot(a, w.c, q);
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
    double *c, *d, *g, *u;  // q
    double *H, *Z;          // q × q, then its factor; q × k
  };

  const Part& part(std::size_t b) const { return blocks_.parts()[b]; }

  const Blocks& blocks_;
  std::vector<Work> work_;
  Arena arena_;
  Schur schur_;
  std::vector<double> nu_, last_nu_;
  double cone_weight_ = 1, limit_weight_ = 1;
  bool sound_ = true;
};

}  // namespace graspforce
