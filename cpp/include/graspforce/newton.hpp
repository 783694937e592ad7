// Newton's method on Phi (Section III-C.4): the main loop of the solver.
#pragma once

#include <algorithm>
#include <cmath>

#include "graspforce/barrier_concept.hpp"
#include "graspforce/budget.hpp"
#include "graspforce/cone.hpp"

namespace graspforce {

// Full Newton step of decrement λ < 1: it stays inside, and leaves a decrement of at most this.
inline double decrement_after(double lambda) {
  const double ratio = lambda / (1 - lambda);
  return lambda < 1 ? ratio * ratio : kInfinity;
}

struct Newton {
  enum class End {
    Certified,          // W c = f, strictly inside, bound²/2 ≤ tol
    WrenchNotRestored,  // W c = f could not be restored within kMaxUnbalancedSteps steps
    Slow,               // W c = f holds, but the minimum is still far after kMaxSlowSteps steps
    Spent,              // out of steps or time
    Boundary,           // rounding put the point on the boundary
    Overflow,
  } end;
  double bound;  // on the decrement at the point reached
};

// Steps from a point that lacks W c = f after which the start counts as leading nowhere, and steps
// after which any start counts as slow. Of the grasps that can be solved this way nearly all are
// done long before; for the others there is the primal–dual method.
inline constexpr int kMaxUnbalancedSteps = 12, kMaxSlowSteps = 25;

// Minimises Phi from a point strictly inside the limits at which the step, of decrement `lambda`,
// has been computed; `balanced` tells that W c = f holds there.
//
// A step of decrement λ < 1/4 is taken whole and judged by what is known of it beforehand, or else
// by the gradient that it leads to, so the usual servo tick costs one factorisation. A longer step
// goes up to nine tenths of the way to the boundary. A whole step restores W c = f, and from then
// on no step may overshoot the minimum along its direction by much: the slope behind it tells,
// without a single logarithm, and 1/(1 + λ) is a length that never does.
template <class Barrier>
Newton minimise(Barrier& barrier, double lambda, double tol, Budget& budget, bool balanced) {
  static_assert(IsBarrier<Barrier>::value, "see barrier_concept.hpp");
  double bound = kInfinity;
  for (int steps = 1;; ++steps) {
    if (!std::isfinite(lambda)) return {Newton::End::Overflow, bound};
    if (!budget.take()) return {Newton::End::Spent, bound};
    double taken = lambda < 0.25 ? 1 : std::min(1.0, 0.9 * barrier.step_limit());
    barrier.advance(taken);
    bound = taken == 1 ? decrement_after(lambda) : kInfinity;
    if (bound < kInfinity && bound * bound / 2 > tol)
      bound = std::min(bound, barrier.decrement_bound(lambda));
    if (bound * bound / 2 <= tol && barrier.balanced())
      return {barrier.inside() ? Newton::End::Certified : Newton::End::Boundary, bound};

    // While W c = f is being restored Phi may well rise, and there is nothing to hold a step to.
    const double safe = balanced ? 1 / (1 + lambda) : taken;
    bool inside = barrier.evaluate();
    while (inside && taken > safe && barrier.slope() > 0.5 * lambda * lambda) {
      const double shorter = std::max(safe, taken / 2);
      barrier.advance(shorter - taken);
      taken = shorter;
      bound = kInfinity;
      inside = barrier.evaluate();
    }
    balanced = balanced || taken == 1;
    if (!inside) return {Newton::End::Boundary, bound};
    if (budget.spent()) return {Newton::End::Spent, bound};
    if (!balanced && steps >= kMaxUnbalancedSteps) return {Newton::End::WrenchNotRestored, bound};
    if (steps >= kMaxSlowSteps && bound >= 1) return {Newton::End::Slow, bound};
    // Close to the minimum the last multipliers are a better origin than zero.
    lambda = bound < 1 ? barrier.newton_from_multipliers() : barrier.newton();
  }
}

}  // namespace graspforce
