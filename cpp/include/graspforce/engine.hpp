// A solver for one layout: a cold solve, and a servo tick from the ticks before.
//
// Set up once; after that neither solve nor tick allocates as long as the pattern of J and A and
// the set of contacts in the grasp stay the same. Nothing here throws or prints.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/barrier.hpp"
#include "graspforce/lane_barrier.hpp"
#include "graspforce/newton.hpp"
#include "graspforce/primal_dual.hpp"
#include "graspforce/rank.hpp"

namespace graspforce {

enum class Status : int {
  Solved = 0,
  Infeasible = 1,
  WrenchUnreachable = 2,
  Unbounded = 3,
  MaxSteps = 4,
  Stalled = 5,
  InvalidNumbers = 6,
};

struct Result {
  Status status = Status::InvalidNumbers;
  int newton_steps = 0;
  double decrement = kInfinity;  // certified bound, for Phi / min(1, alpha)
  double violation = 0;          // least relative violation when infeasible
};

class Engine {
 public:
  explicit Engine(const Layout& layout)
      : layout_(layout),
        offsets_(layout),
        structure_(layout_),
        lanes_(layout_),
        blocks_(layout_),
        barrier_(blocks_),
        primal_dual_(blocks_),
        c_(layout.components()),
        nu_(layout.wrench_rows),
        y_(layout.wrench_rows),
        z_(limit_count(layout)),
        guess_(layout.components()),
        ceiling_(layout.contacts()) {
    for (Past& past : past_) {
      past.c.resize(layout.components());
      past.ceiling.resize(layout.contacts());
    }
  }
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;

  const Layout& layout() const { return layout_; }
  const double* forces() const { return c_.data(); }
  const double* multipliers() const { return nu_.data(); }
  const double* certificate_y() const { return y_.data(); }
  const double* certificate_z() const { return z_.data(); }
  std::size_t limits() const { return z_.size(); }

  // Solves from `start` (m forces) where it is inside the limits, else from nothing.
  Result solve(const double* packed, double tol, int max_steps, const double* start = nullptr) {
    const Problem problem(offsets_, packed);
    unseen_ = kChangedAll;  // the next tick's numbers are compared with these, not with its last
    return in_core(problem, kChangedAll, [&](auto& barrier, unsigned) {
      double lambda = kInfinity;
      if (start != nullptr) {
        barrier.set_forces(start);
        lambda = first_step(barrier, problem);
      }
      return run(barrier, problem, lambda, tol, max_steps);
    });
  }

  // Solves the next problem of a stream, from the optima before it. `changed` tells what differs
  // from the tick before.
  Result tick(const double* packed, double tol, int max_steps, unsigned changed = kChangedAll) {
    const Problem problem(offsets_, packed);
    changed |= unseen_;
    unseen_ = 0;
    const Result result = in_core(problem, changed, [&](auto& barrier, unsigned news) {
      if (news & kChangedRest) {
        for (int i = 0; i < layout_.contacts(); ++i)
          ceiling_[i] = layout_.ceilings ? problem.engagement[i] * problem.c_max[i] : 1;
        steady_ = 0;
      } else {
        ++steady_;
      }
      return run(barrier, problem, predict(barrier, problem), tol, max_steps);
    });
    if (result.status == Status::Solved)
      remember(problem);
    else
      known_ = 0;
    return result;
  }

  void reset() { known_ = 0; }

 private:
  // Forces this many times their reach, with no minimum found, mean that nothing holds them.
  static constexpr double kRunaway = 1e6;
  // Pivot of the k × k system below which W may have dependent rows.
  static constexpr double kSuspectPivot = 1e-10;
  // Decrement at an extrapolated start above which the last optimum is looked at as well.
  static constexpr double kPromising = 0.5;

  struct Past {
    std::vector<double> c, ceiling;
  };

  // Loads the problem and hands it to the kernels that fit it, with what is new to them.
  template <class Work>
  Result in_core(const Problem& problem, unsigned changed, Work work) {
    if (layout_.joints == 0 && !layout_.ceilings && layout_.inequalities == 0)
      return nothing(Status::Unbounded);
    if (!structure_.holds(problem, changed)) {
      structure_.find(problem);
      blocks_.allot(structure_);
      barrier_.allot();
      primal_dual_.allot();
      by_lanes_ = lanes_.allot(structure_);
      changed = kChangedAll;
    }
    rank_known_ = unreachable_ = false;
    Result result;
    if (structure_.blocks().empty()) {  // every contact is out of the grasp
      const bool idle =
          std::all_of(problem.f, problem.f + layout_.wrench_rows, [](double f) { return f == 0; });
      result = nothing(idle ? Status::Solved : Status::WrenchUnreachable);
      result.decrement = idle ? 0 : kInfinity;
      return result;
    }
    if (by_lanes_) {
      lanes_.load(problem, changed);
      if (was_deficient_) examine(lanes_, problem);
      result = work(lanes_, changed);
    } else {
      blocks_.load(problem);
      barrier_.set_weights(*problem.alpha);
      if (was_deficient_) examine(blocks_, problem);
      result = work(barrier_, changed);
    }
    if (result.status != Status::Solved && !finite()) return nothing(Status::InvalidNumbers);
    return result;
  }

  bool finite() const {
    for (double c : c_)
      if (!std::isfinite(c)) return false;
    for (double nu : nu_)
      if (!std::isfinite(nu)) return false;
    return true;
  }

  Result nothing(Status status) {
    std::fill(c_.begin(), c_.end(), 0.0);
    std::fill(nu_.begin(), nu_.end(), 0.0);
    Result result;
    result.status = status;
    return result;
  }

  // Reduces W c = f to independent rows where it has others.
  template <class Rows>
  void examine(Rows& rows, const Problem& problem) {
    rank_ = examine_rank(layout_, problem);
    rank_known_ = true;
    unreachable_ = !rank_.reachable;
    was_deficient_ = static_cast<int>(rank_.rows.size()) < layout_.wrench_rows;
    if (was_deficient_) rows.restrict_rows(problem, rank_.rows);
  }
  void examine(Barrier&, const Problem& problem) { examine(blocks_, problem); }

  // Decrement of the Newton step from the barrier's point; infinite outside the limits, and when
  // f turns out to be out of W's range.
  template <class AnyBarrier>
  double first_step(AnyBarrier& barrier, const Problem& problem) {
    if (unreachable_ || !barrier.evaluate()) return kInfinity;
    const double lambda = barrier.newton();
    if (rank_known_ || !(barrier.smallest_pivot() < kSuspectPivot)) return lambda;
    examine(barrier, problem);
    return first_step(barrier, problem);
  }

  // Puts the barrier at the extrapolation of the last two optima, or at the last one where that
  // promises a shorter step (the wanted wrench may be noisy); returns the step's decrement.
  template <class AnyBarrier>
  double predict(AnyBarrier& barrier, const Problem& problem) {
    double ahead = kInfinity;
    if (known_ == 2) {
      extrapolate(barrier, problem, 2);
      ahead = first_step(barrier, problem);
      if (ahead < kPromising) return ahead;
    }
    if (known_ == 0) return kInfinity;
    extrapolate(barrier, problem, 1);
    const double hold = first_step(barrier, problem);
    if (hold <= ahead) return hold;
    extrapolate(barrier, problem, 2);
    return first_step(barrier, problem);
  }

  // Forces extrapolated from the last `order` optima. A contact's forces are taken as shares of
  // its ceiling, so that they follow it to zero and back; a contact that has just come into the
  // grasp starts with a push.
  template <class AnyBarrier>
  void extrapolate(AnyBarrier& barrier, const Problem& problem, int order) {
    const Past &last = past_[newest_], &before = past_[1 - newest_];
    if (steady_ >= 2 && order == 2) {  // the ceilings are those of the last two ticks
      for (std::size_t c = 0; c < guess_.size(); ++c) guess_[c] = 2 * last.c[c] - before.c[c];
      barrier.set_forces(guess_.data());
      return;
    }
    for (int i = 0, c = 0; i < layout_.contacts(); ++i) {
      const int end = c + static_cast<int>(layout_.models[i]);
      const double now = ceiling_[i];
      const bool one = last.ceiling[i] > 0, two = order == 2 && before.ceiling[i] > 0;
      const double to_last = one ? now / last.ceiling[i] : 0;
      const double to_before = two ? now / before.ceiling[i] : 0;
      for (bool normal = true; c < end; ++c, normal = false) {
        if (!one)
          guess_[c] = normal ? now * push(problem) : 0;
        else if (!two)
          guess_[c] = to_last * last.c[c];
        else
          guess_[c] = 2 * to_last * last.c[c] - to_before * before.c[c];
      }
    }
    barrier.set_forces(guess_.data());
  }

  // Share of its reach with which a contact starts that nothing is known of; the more the limits
  // weigh, the smaller the forces that balance them.
  static double push(const Problem& problem) { return 1 / std::sqrt(4 + 3 * *problem.alpha); }

  // Newton's method where the barrier stands (at a step of decrement lambda), else from pure
  // pushes, else the primal–dual method: from certain progress to certain verdicts.
  template <class AnyBarrier>
  Result run(AnyBarrier& barrier, const Problem& problem, double lambda, double tol,
             int max_steps) {
    Result result;
    if (lambda < kInfinity && newton(barrier, lambda, tol, max_steps, false, result)) return result;
    barrier.set_pushes(push(problem));
    lambda = first_step(barrier, problem);
    if (lambda < kInfinity && newton(barrier, lambda, tol, max_steps, false, result)) return result;
    if (!rank_known_) examine(barrier, problem);
    if (unreachable_) return nothing(Status::WrenchUnreachable);
    std::fill(nu_.begin(), nu_.end(), 0.0);

    if (by_lanes_) {  // the primal–dual method works on the general blocks
      blocks_.load(problem);
      if (was_deficient_) blocks_.restrict_rows(problem, rank_.rows);
    }
    const PhaseOneResult phase = primal_dual_.find_inside(problem, max_steps, y_, z_);
    result.newton_steps += phase.steps;
    result.violation = phase.violation;
    primal_dual_.get_forces(c_.data());
    using End = PhaseOneResult::End;
    if (phase.end != End::Inside) {
      result.status = phase.end == End::Infeasible ? Status::Infeasible
                      : phase.end == End::Steps    ? Status::MaxSteps
                      : phase.end == End::Overflow ? Status::InvalidNumbers
                                                   : Status::Stalled;
      return result;
    }
    result.violation = 0;
    result.newton_steps +=
        primal_dual_.follow(barrier.cone_weight(), barrier.limit_weight(), max_steps);
    primal_dual_.get_forces(c_.data());
    barrier.set_forces(c_.data());
    newton(barrier, first_step(barrier, problem), tol, max_steps, true, result);
    if (barrier.largest_force() > kRunaway * blocks_.largest_reach() &&
        result.status != Status::Solved)
      result.status = Status::Unbounded;
    return result;
  }

  // Newton's method from the barrier's point; true when it certifies an answer.
  template <class AnyBarrier>
  bool newton(AnyBarrier& barrier, double lambda, double tol, int max_steps, bool balanced,
              Result& result) {
    const Newton outcome = minimise(barrier, lambda, tol, max_steps, balanced);
    result.newton_steps += outcome.steps;
    using End = Newton::End;
    result.status = outcome.end == End::Certified  ? Status::Solved
                    : outcome.end == End::Overflow ? Status::InvalidNumbers
                    : outcome.end == End::Steps    ? Status::MaxSteps
                                                   : Status::Stalled;
    if (!balanced && result.status != Status::Solved) return false;
    result.decrement = outcome.bound;
    barrier.get_forces(c_.data());
    barrier.get_multipliers(nu_.data());
    return result.status == Status::Solved;
  }

  void remember(const Problem& problem) {
    newest_ = 1 - newest_;
    std::copy(c_.begin(), c_.end(), past_[newest_].c.begin());
    for (int i = 0; i < layout_.contacts(); ++i)
      past_[newest_].ceiling[i] = problem.in_grasp(i) ? ceiling_[i] : 0;
    known_ = std::min(known_ + 1, 2);
  }

  Layout layout_;
  Offsets offsets_;
  Structure structure_;
  LaneBarrier lanes_;  // for grasps without coupled contacts
  Blocks blocks_;      // for all others, and for the primal–dual method
  Barrier barrier_;
  PrimalDual primal_dual_;
  std::vector<double> c_, nu_, y_, z_, guess_, ceiling_;
  Past past_[2];
  int newest_ = 0, known_ = 0;
  int steady_ = 0;                 // ticks since the ceilings may last have changed
  unsigned unseen_ = kChangedAll;  // what the next tick has to load whatever it is told
  Rank rank_;
  bool by_lanes_ = false, rank_known_ = false, was_deficient_ = false, unreachable_ = false;
};

}  // namespace graspforce
