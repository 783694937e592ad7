// What decides the problems that Newton's method on Phi alone does not: Phase 1, then the
// primal–dual method to the minimum, and Newton's method by least squares to certify it. Where the
// wrench cannot be had, or only on the edge, the forces whose wrench is nearest to it.
#pragma once

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "graspforce/answer.hpp"
#include "graspforce/kernels.hpp"
#include "graspforce/nearest.hpp"
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
        primal_dual_(blocks, least_squares_),
        scale_(blocks.layout().wrench_rows),
        softness_(scale_),
        unused_y_(scale_),
        unused_z_(limit_count(blocks.layout())),
        c_(force_count(blocks.layout())) {}

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
    if (phase.end != PhaseOneResult::End::Inside) {
      give_up(phase, kernels, answer);
      if (answer.result.status == Status::Infeasible)
        find_nearest(problem, rank, kernels.cone_weight(), kernels.limit_weight(), budget, answer);
      if (answer.result.status == Status::OnEdge) keep_to_edge(problem, rank, budget, answer);
      return;
    }
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
    if (answer.result.status == Status::Stalled && phase.violation > -kEdge) {
      answer.clear(Status::OnEdge);  // inside by rounding alone
      primal_dual_.get_forces(answer.c.data());
      keep_to_edge(problem, rank, budget, answer);
    }
  }

  // The forces strictly inside the cones and limits whose wrench is nearest to f in its exact rows,
  // in units of wrench_scales; the soft rows have no say. Where many make that wrench, those that
  // the barriers choose. The answer keeps its own where no forces are strictly inside; with the
  // budget spent it gets the nearest so far, if there is any.
  void find_nearest(const Problem& problem, const RankExamination& rank, double cone_weight,
                    double limit_weight, Budget& budget, Answer& answer) {
    const std::vector<int>& exact = rank.all_exact_rows();
    if (find_any(problem, budget).end != PhaseOneResult::End::Inside) return;
    wrench_scales(blocks_.layout(), problem, scale_.data());
    double size = 0;  // of f, or of what the limits are made for
    for (int r : exact) size = std::max(size, std::abs(problem.f[r]) / scale_[r]);
    if (!(size > 0)) size = blocks_.size();
    for (int r : exact) softness_[r] = size * scale_[r];
    blocks_.soften(problem, exact, softness_.data());
    least_squares_.allot();
    primal_dual_.allot();
    primal_dual_.set_forces(c_.data());
    answer.result.nearest = primal_dual_.approach(cone_weight, limit_weight, budget);
    primal_dual_.get_forces(answer.c.data());
    for (std::size_t i = 0; i < c_.size(); ++i) answer.c[i] += kInward * (c_[i] - answer.c[i]);
    blocks_.harden(exact);
    allot();
  }

 private:
  // Moves forces on the edge, which violate limits by no more than kEdge, as far inside as it takes
  // to be so by more than rounding; not at all where the wrench would suffer.
  void keep_to_edge(const Problem& problem, const RankExamination& rank, Budget& budget,
                    Answer& answer) {
    const double outside = answer.result.violation;
    answer.result.violation = 0;
    if (!rank.fits(problem, answer.c.data())) {
      answer.result.status = Status::Stalled;
      return;
    }
    const PhaseOneResult phase = find_any(problem, budget);
    if (phase.end != PhaseOneResult::End::Inside) return;
    const double share = kInward + 2 * outside / (outside - phase.violation);
    for (std::size_t i = 0; i < c_.size(); ++i) c_[i] = answer.c[i] + share * (c_[i] - answer.c[i]);
    if (!(share < kMostInward) || !rank.fits(problem, c_.data())) return;
    std::copy(c_.begin(), c_.end(), answer.c.begin());
    answer.result.nearest = true;
  }

  // Forces well inside all limits, whatever their wrench, into c_.
  PhaseOneResult find_any(const Problem& problem, Budget& budget) {
    blocks_.restrict_rows(problem, {});
    const PhaseOneResult phase = primal_dual_.find_inside(problem, budget, unused_y_, unused_z_);
    primal_dual_.get_forces(c_.data());
    return phase;
  }

  // Infeasible, or undecided. Without a verdict, forces inside the limits that lack some of f are
  // better than forces that make f and slip.
  template <class AnyBarrier>
  void give_up(const PhaseOneResult& phase, AnyBarrier& kernels, Answer& answer) {
    using End = PhaseOneResult::End;
    const bool edge = phase.end == End::Closest && phase.balanced && phase.violation < kEdge;
    if (edge || answer.wrench_error == kInfinity) {
      primal_dual_.get_forces(answer.c.data());
      kernels.set_forces(answer.c.data());
      if (kernels.inside()) answer.wrench_error = kernels.wrench_error();
      answer.result.decrement = kInfinity;  // what was known was of other forces
    }
    if (phase.end != End::Steps) answer.result.decrement = kInfinity;  // there is no minimum
    answer.result.violation = std::isfinite(phase.violation) ? phase.violation : 0;
    answer.result.status = phase.end == End::Infeasible ? Status::Infeasible
                           : phase.end == End::Steps    ? Status::MaxSteps
                           : phase.end == End::Overflow ? Status::InvalidNumbers
                           : edge                       ? Status::OnEdge
                                                        : Status::Stalled;
  }

  // Relative violation below which forces that no step brings inside are on the edge.
  static constexpr double kEdge = 1e-9;

  // Share of the way to forces well inside that the nearest ones are moved: off the boundary by
  // more than the rounding of what their slacks are computed from. And the largest for forces on
  // the edge.
  static constexpr double kInward = 1e-11, kMostInward = 1e-7;

  Blocks& blocks_;
  LeastSquares least_squares_;  // of the two that follow
  OrthogonalBarrier barrier_;
  PrimalDual primal_dual_;
  std::vector<double> scale_, softness_;     // of the rows of W c = f
  std::vector<double> unused_y_, unused_z_;  // no proof of theirs is asked for
  std::vector<double> c_;
};

}  // namespace graspforce
