// Newton's method on Phi (Section III-C.4) and Phase 1 (III-C.5). These two loops are the method.
#pragma once

#include <cmath>

#include "graspforce/certificate.hpp"
#include "graspforce/system.hpp"

namespace graspforce {

// Full Newton step of decrement λ < 1: it stays inside, and leaves a decrement of at most this.
inline double decrement_after(double lambda) {
  const double ratio = lambda / (1 - lambda);
  return lambda < 1 ? ratio * ratio : kInfinity;
}

struct Newton {
  enum class End {
    Certified,  // W c = f, strictly inside, bound²/2 ≤ tol
    Steps,      // out of steps
    Boundary,   // rounding put the point on the boundary
    Suspect,    // the k × k system is nearly singular: W may have dependent rows
    Overflow,
  } end = End::Boundary;
  int steps = 0;
  double bound = kInfinity;  // on the decrement at the point reached
};

// Relative pivot of the k × k system below which W's rank has to be looked at.
inline constexpr double kSuspectPivot = 1e-10;

// Minimises Phi from a point strictly inside the limits; `balanced` tells that W c = f holds.
//
// A step of decrement λ < 1/4 is taken whole and judged by what is known of it beforehand, so
// the usual servo tick costs one factorisation. A longer one goes up to nine tenths of the way to
// the boundary. A whole step restores W c = f, and from then on no step may overshoot the minimum
// along its direction by much: the slope behind it tells, without a single logarithm, and
// 1/(1 + λ) is a length that never does.
inline Newton minimise(System& system, double tol, int max_steps, bool balanced, bool rank_known) {
  Newton result;
  double taken = 0, safe = 0, steepness = 0;  // of the last step
  while (system.evaluate<Barrier::Exact>()) {
    if (taken > safe && system.slope() > 0.5 * steepness) {
      const double shorter = std::max(safe, taken / 2);
      system.advance(shorter - taken);
      taken = shorter;
      continue;
    }
    if (result.steps == max_steps) {
      result.end = Newton::End::Steps;
      return result;
    }
    const double lambda = system.newton();
    ++result.steps;
    if (!std::isfinite(lambda)) {
      result.end = Newton::End::Overflow;
      return result;
    }
    if (!rank_known && system.smallest_pivot() < kSuspectPivot) {
      result.end = Newton::End::Suspect;
      return result;
    }
    taken = lambda < 0.25 ? 1 : std::min(1.0, 0.9 * system.step_limit<Barrier::Exact>());
    system.advance(taken);
    result.bound = taken == 1 ? decrement_after(lambda) : kInfinity;
    if (result.bound * result.bound / 2 <= tol && system.relative_wrench_error() < 1e-10) {
      result.end = system.inside() ? Newton::End::Certified : Newton::End::Boundary;
      return result;
    }
    // While W c = f is being restored Phi may well rise, and there is nothing to hold a step to.
    safe = balanced ? 1 / (1 + lambda) : kInfinity;
    steepness = lambda * lambda;
    balanced = balanced || taken == 1;
  }
  return result;
}

struct PhaseOne {
  enum class End { Inside, Infeasible, Steps, Closest, Overflow } end = End::Steps;
  int steps = 0;
  double violation = 0;
};

// Shrinks one slack σ that relaxes every cone and limit (Section III-C.5), from W⁺ f.
//
// Minimises κσ + Phi_relaxed on W c = f for growing κ. Ends Inside as soon as the point is
// strictly inside the limits. Each step of decrement below 1 defines a dual point; once one proves
// that σ cannot reach 0 it is kept in y and z, and the loop goes on to the least violation.
inline PhaseOne find_inside(System& system, const Layout& layout, const Problem& problem,
                            int max_steps, double* y, double* z, double* y_try, double* z_try) {
  constexpr double kClosest = 1e-13, kLeast = 1e-7;  // gaps at which to give up, and to be done
  constexpr int kBold = 20;  // steps towards the boundary before only safe ones are taken
  int bold_steps = 0;
  PhaseOne result;
  const double terms = system.complexity();
  const std::size_t duals = 2 * layout.joints + layout.inequalities +
                            layout.contacts() * (int(layout.ceilings) + int(layout.floors));
  bool proved = false;
  double kappa = 10;
  system.set_least_norm();
  system.sigma = system.least_sigma();
  system.sigma = system.sigma > 0 ? 1.2 * system.sigma + 0.1 : 0.1;
  while (result.steps < max_steps && system.evaluate<Barrier::Relaxed>()) {
    const double lambda = system.newton_relaxed(kappa);
    ++result.steps;
    if (!std::isfinite(lambda)) {
      result.end = PhaseOne::End::Overflow;
      return result;
    }
    if (lambda < 1 && !proved) {
      system.get_dual(y_try, z_try);
      proved = proves_infeasible(layout, problem, y_try, z_try);
      if (proved) {
        for (int r = 0; r < layout.wrench_rows; ++r) y[r] = y_try[r] / kappa;
        for (std::size_t i = 0; i < duals; ++i) z[i] = z_try[i] / kappa;
      }
    }
    const double safe = 1 / (1 + lambda);
    const double bold = 0.9 * system.step_limit<Barrier::Relaxed>();
    const double step = lambda < 0.25          ? 1
                        : ++bold_steps > kBold ? safe
                                               : std::min(1.0, std::max(safe, bold));
    system.advance(step);
    system.advance_sigma(step);
    if (system.inside() && system.relative_wrench_error() < 1e-9) {
      result.end = PhaseOne::End::Inside;
      return result;
    }
    if (lambda < 0.3) {
      const double gap = terms / kappa;
      if (proved && gap < kLeast * system.sigma) {
        result.end = PhaseOne::End::Infeasible;
        result.violation = system.sigma;
        return result;
      }
      if (gap < kClosest) {
        result.end = PhaseOne::End::Closest;
        return result;
      }
      kappa *= 10;
      bold_steps = 0;
    }
  }
  return result;
}

}  // namespace graspforce
