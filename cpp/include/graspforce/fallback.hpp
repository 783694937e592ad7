// What decides the problems that Newton's method on Phi alone does not: Phase 1, then the
// primal–dual method to the minimum, and Newton's method by least squares to certify it.
#pragma once

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "graspforce/answer.hpp"
#include "graspforce/kernels.hpp"
#include "graspforce/newton.hpp"
#include "graspforce/orthogonal_barrier.hpp"
#include "graspforce/primal_dual.hpp"
#include "graspforce/rank.hpp"

namespace graspforce {

class Fallback {
 public:
  explicit Fallback(Blocks& blocks)
      : blocks_(blocks),
        least_squares_(blocks),
        barrier_(blocks, least_squares_),
        primal_dual_(blocks, least_squares_) {}

  // Needed after Blocks::allot. Does not allocate.
  void allot() {
    least_squares_.allot();
    barrier_.allot();
    primal_dual_.allot();
  }

  // Goes on from where the kernels' barrier has given up; the rank of W is known.
  template <class AnyBarrier>
  void solve(const Problem& problem, const RankExamination& rank, AnyBarrier& kernels, double tol,
             Budget& budget, Answer& answer) {
    std::fill(answer.nu.begin(), answer.nu.end(), 0.0);
    if (!std::is_same_v<AnyBarrier, Barrier>) {  // which has them loaded already
      blocks_.load(problem);
      if (rank.deficient()) blocks_.restrict_rows(problem, rank.rows());
    }
    // Phase 1 asks for the exact rows alone: whatever the others lack is no matter of inside.
    const bool soft = blocks_.layout().soft_wrench;
    if (soft) blocks_.restrict_rows(problem, rank.exact_rows());
    const PhaseOneResult phase = primal_dual_.find_inside(problem, budget, answer.y, answer.z);
    if (phase.end != PhaseOneResult::End::Inside) return give_up(phase, kernels, answer);
    if (soft) blocks_.restrict_rows(problem, rank.rows());
    primal_dual_.follow(kernels.cone_weight(), kernels.limit_weight(), budget);
    primal_dual_.get_forces(answer.c.data());
    barrier_.set_weights(kernels.cone_weight(), kernels.limit_weight());
    barrier_.set_forces(answer.c.data());
    const double lambda = barrier_.evaluate() ? barrier_.newton() : kInfinity;
    answer.take(minimise(barrier_, lambda, tol, budget, true), barrier_, budget, true);
    if (answer.result.status != Status::Solved && barrier_.runaway())
      answer.clear(Status::Unbounded);
    // Rows of W that all but vanish may take multipliers of any size.
    if (!answer.finite()) answer.result.status = Status::Stalled;
  }

 private:
  // Infeasible, or undecided. Without a verdict, forces inside the limits that lack some of f are
  // better than forces that make f and slip.
  template <class AnyBarrier>
  void give_up(const PhaseOneResult& phase, AnyBarrier& kernels, Answer& answer) {
    using End = PhaseOneResult::End;
    if (phase.end == End::Infeasible || answer.wrench_error == kInfinity) {
      primal_dual_.get_forces(answer.c.data());
      kernels.set_forces(answer.c.data());
      if (kernels.inside()) answer.wrench_error = kernels.wrench_error();
      answer.result.decrement = kInfinity;  // what was known was of other forces
    }
    answer.result.violation = std::isfinite(phase.violation) ? phase.violation : 0;
    answer.result.status = phase.end == End::Infeasible ? Status::Infeasible
                           : phase.end == End::Steps    ? Status::MaxSteps
                           : phase.end == End::Overflow ? Status::InvalidNumbers
                                                        : Status::Stalled;
  }

  Blocks& blocks_;
  LeastSquares least_squares_;  // of the two that follow
  OrthogonalBarrier barrier_;
  PrimalDual primal_dual_;
};

}  // namespace graspforce
