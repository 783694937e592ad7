// A solver for one layout: a cold solve, and a servo tick from the ticks before.
//
// The constructor allocates for the largest problem of the layout: every contact in the grasp, all
// of them coupled by joints or inequalities. After it neither solve nor tick allocates. No function
// throws or prints.
#pragma once

#include "graspforce/answer.hpp"
#include "graspforce/budget.hpp"
#include "graspforce/empty_grasp.hpp"
#include "graspforce/fallback.hpp"
#include "graspforce/floating_point.hpp"
#include "graspforce/history.hpp"
#include "graspforce/kernels.hpp"
#include "graspforce/nearest.hpp"
#include "graspforce/newton.hpp"
#include "graspforce/pull.hpp"
#include "graspforce/rank.hpp"

namespace graspforce {

class Engine {
 public:
  explicit Engine(const Layout& layout)
      : pull_(layout),
        layout_(pull_.inner()),
        offsets_(layout_),
        kernels_(layout_),
        fallback_(kernels_.blocks()),
        rank_(layout_),
        range_(layout_),
        history_(layout_),
        answer_(layout_),
        given_(layout_.internals > 0 ? force_count(layout_) : 0) {}
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;

  const Layout& layout() const { return pull_.outer(); }
  std::size_t packed_size() const { return pull_.packed_size(); }  // numbers of a problem
  Kernels::Kind kernels() const { return kernels_.chosen(); }      // of the last solve or tick
  const Structure& structure() const { return kernels_.structure(); }

  // What the last solve or tick has found.
  const Result& result() const { return answer_.result; }
  // The forces of the contacts, then the internal ones.
  const double* forces() const { return forces_; }
  const double* multipliers() const { return answer_.nu.data(); }
  const double* certificate_y() const { return answer_.y.data(); }
  const double* certificate_z() const { return answer_.z.data(); }
  std::size_t limits() const { return answer_.z.size(); }

  // Solves from `start` (m forces) where it is inside the limits, else cold. Where rates
  // are limited the last forces are the start that there is.
  const Result& solve(const double* packed, const Settings& settings,
                      const double* start = nullptr) {
    const DefaultFloatingPoint environment;
    const Problem problem(offsets_, pull_.problem(packed));
    if (start != nullptr) start = given(start);
    if (start == nullptr && layout_.rate_limits) start = with_internals(problem.c_last);
    // The next tick's numbers are compared with these, not with its last.
    pending_changes_ = kChangedAll;
    dispatch(problem, settings, kChangedAll,
             [&](auto& barrier, const Problem& wanted, Budget& budget, unsigned) {
               double lambda = kInfinity;
               if (start != nullptr) {
                 answer_.result.start = Start::Given;
                 barrier.set_forces(start);
                 lambda = first_step(barrier, wanted);
               }
               run(barrier, wanted, lambda, settings.tol, budget);
             });
    forces_ = pull_.outward(answer_.c.data());
    return answer_.result;
  }

  // Solves the next problem of a stream, from the optima before it. `changed` tells what differs
  // from the tick before (see Changed); what it leaves out is neither read nor compared.
  const Result& tick(const double* packed, const Settings& settings,
                     unsigned changed = kChangedAll) {
    const DefaultFloatingPoint environment;
    const Problem problem(offsets_, pull_.problem(packed));
    // Of c + pull the bias changes with J.
    if (layout().pulls && changed & kChangedJacobian) changed |= kChangedRest;
    if (pending_changes_ != 0) changed = pending_changes_;  // by other blocks than the last tick's
    pending_changes_ = 0;
    dispatch(problem, settings, changed,
             [&](auto& barrier, const Problem& wanted, Budget& budget, unsigned news) {
               if (&wanted == &problem) history_.begin_tick(problem, news);
               run(barrier, wanted, predict(barrier, wanted), settings.tol, budget);
             });
    // A tick that ran out of budget goes on from where it stopped.
    if (!minimal_) history_.clear();
    if (minimal_ || unfinished_) history_.remember(problem, answer_.c);
    forces_ = pull_.outward(answer_.c.data());
    return answer_.result;
  }

  // Discards the optima of the ticks before.
  void reset() { history_.clear(); }

  // Forgets the problems before, the blocks and the rank that they had included: the next answer
  // then depends on the next problem alone, to the last bit.
  void forget() {
    history_.clear();
    kernels_.forget();
    rank_.forget_deficiency();
  }
  // As much of it as the bits of a solve depend on. Blocks of a contact each are kept: at worst a
  // joint stands in one that it no longer touches, and zeros change nothing.
  void forget_couplings() {
    if (kernels_.chosen() == Kernels::Kind::General) kernels_.forget();
    rank_.forget_deficiency();
  }

 private:
  // Decrement at an extrapolated start above which the last optimum is looked at as well.
  static constexpr double kPromising = 0.5;

  // Forces of the contacts that a caller gives, as the engine counts them. Of internal forces
  // nothing is known.
  const double* given(const double* c) { return pull_.inward(with_internals(c)); }
  const double* with_internals(const double* c) {
    if (given_.empty()) return c;
    std::copy_n(c, layout_.components(), given_.begin());
    return given_.data();
  }

  // Hands the problem to the kernels that fit it, with what is new to them.
  template <class Work>
  void dispatch(const Problem& problem, const Settings& settings, unsigned changed, Work work) {
    answer_.result = Result();
    minimal_ = unfinished_ = false;
    if (layout_.joints == 0 && !layout_.ceilings && layout_.inequalities == 0 &&
        !layout_.rate_limits)
      return answer_.clear(Status::Unbounded);
    Budget budget(settings);
    if (kernels_.rearrange(problem, changed)) {
      fallback_.allot();
      changed = kChangedAll;
    }
    rank_.forget();
    if (kernels_.empty()) {
      answer_empty_grasp(layout_, problem, answer_);
      minimal_ = answer_.result.status == Status::Solved;
      return;
    }
    kernels_.dispatch(problem, changed, [&](auto& barrier) {
      if (rank_.deficient()) reduce_rank(barrier, problem);
      // Once more for the nearest wrench where no forces make f.
      for (const Problem* wanted = &problem; wanted != nullptr;) {
        work(barrier, *wanted, budget, changed);
        wanted = judge(barrier, problem, *wanted);
      }
    });
    Result& result = answer_.result;
    // A certified answer is finite, or its decrement were not: those of the slacks of soft rows,
    // whose multipliers (f − W c)/F² may overflow where the forces are fine, count in it.
    if (result.status != Status::Solved && !answer_.finite()) {
      answer_.clear(Status::InvalidNumbers);
      minimal_ = unfinished_ = false;
    }
    result.newton_steps = budget.steps();
    result.elapsed_us = budget.elapsed_us();
  }

  // Looks at what has come of work towards a wrench. The problem to go on with; null as a rule.
  template <class AnyBarrier>
  GRASPFORCE_INLINE const Problem* judge(AnyBarrier& barrier, const Problem& problem,
                                         const Problem& wanted) {
    Status& status = answer_.result.status;
    if (status == Status::Solved && rank_.deficient() && !rank_.fits(wanted, answer_.c.data()))
      status = Status::Stalled;
    minimal_ = status == Status::Solved;
    unfinished_ = status == Status::MaxSteps && answer_.wrench_error < kInfinity;
    if (&wanted != &problem) return keep_verdict();
    return status == Status::WrenchUnreachable ? nearest_in_range(barrier, problem) : nullptr;
  }

  // The problem with the wrench nearest to f in the range of W, which the barrier is led to.
  template <class AnyBarrier>
  GRASPFORCE_APART const Problem* nearest_in_range(AnyBarrier& barrier, const Problem& problem) {
    nearest_ = problem;
    nearest_.f = range_.project(problem, rank_.all_exact_rows(), int(rank_.exact_rows().size()));
    rank_.reach();
    kernels_.rows(barrier).restrict_rows(nearest_, rank_.rows());
    return &nearest_;
  }

  // What has been found for that wrench comes with the verdict on f itself.
  GRASPFORCE_APART const Problem* keep_verdict() {
    Result& result = answer_.result;
    const bool found = result.nearest || minimal_ || unfinished_ ||
                       result.status == Status::Infeasible || result.status == Status::OnEdge;
    if (found && answer_.finite()) {
      result.nearest = result.nearest || minimal_;
      result.status = Status::WrenchUnreachable;
      result.decrement = kInfinity;
      result.violation = 0;
    } else {
      answer_.clear(Status::WrenchUnreachable);
      minimal_ = unfinished_ = false;
    }
    return nullptr;
  }

  // Reduces W c = f to independent rows where it has others.
  template <class AnyBarrier>
  void reduce_rank(AnyBarrier& barrier, const Problem& problem) {
    rank_.run(problem);
    if (rank_.deficient()) kernels_.rows(barrier).restrict_rows(problem, rank_.rows());
  }

  // Decrement of the Newton step from the barrier's point; infinite outside the limits, and when
  // f turns out to be out of W's range.
  template <class AnyBarrier>
  double first_step(AnyBarrier& barrier, const Problem& problem) {
    if (rank_.unreachable() || !barrier.evaluate()) return kInfinity;
    const double lambda = barrier.newton();
    if (rank_.known() || barrier.sound()) return lambda;
    reduce_rank(barrier, problem);
    return first_step(barrier, problem);
  }

  // Puts the barrier at the extrapolation of the last two optima, or at the last one where that
  // promises a shorter step (the wanted wrench may be noisy); returns the step's decrement.
  template <class AnyBarrier>
  double predict(AnyBarrier& barrier, const Problem& problem) {
    double ahead = kInfinity;
    if (history_.size() == 2) {
      ahead = step_from(Start::Extrapolated, barrier, problem);
      if (ahead < kPromising) return ahead;
    }
    if (history_.size() == 0) return kInfinity;
    const double hold = step_from(Start::Held, barrier, problem);
    return hold <= ahead ? hold : step_from(Start::Extrapolated, barrier, problem);
  }

  // First step from one of the two. Called as a function of its own it makes a warm tick 9 %
  // longer.
  template <class AnyBarrier>
  GRASPFORCE_INLINE double step_from(Start start, AnyBarrier& barrier, const Problem& problem) {
    answer_.result.start = start;
    history_.extrapolate(barrier, problem, start == Start::Extrapolated ? 2 : 1);
    return first_step(barrier, problem);
  }

  // Newton's method where the barrier stands (at a step of decrement lambda), else from pure
  // pushes, else the primal–dual method: in the order of speed, the most robust last.
  template <class AnyBarrier>
  void run(AnyBarrier& barrier, const Problem& problem, double lambda, double tol, Budget& budget) {
    answer_.wrench_error = kInfinity;
    if (newton(barrier, lambda, tol, budget)) return;
    answer_.result.start = Start::Cold;
    barrier.set_pushes(initial_push(problem));
    if (newton(barrier, first_step(barrier, problem), tol, budget)) return;
    if (!rank_.known()) reduce_rank(barrier, problem);
    if (rank_.unreachable())
      return answer_.clear(rank_.overflows() ? Status::InvalidNumbers : Status::WrenchUnreachable);
    fallback_.solve(problem, rank_, barrier, tol, budget, answer_);
  }

  // Newton's method from the barrier's point; true when that ends the solve.
  template <class AnyBarrier>
  bool newton(AnyBarrier& barrier, double lambda, double tol, Budget& budget) {
    return lambda < kInfinity &&
           answer_.take(minimise(barrier, lambda, tol, budget, false), barrier, budget, false);
  }

  Pull pull_;
  Layout layout_;  // without pulls
  Offsets offsets_;
  Kernels kernels_;
  Fallback fallback_;
  RankExamination rank_;
  RangeProjection range_;
  Problem nearest_;  // the problem with f in the range of W, where it is not
  History history_;
  Answer answer_;
  std::vector<double> given_;  // a start with zeros for the internal forces
  const double* forces_ = answer_.c.data();
  bool minimal_ = false;     // the forces of the last solve are a minimum of Phi
  bool unfinished_ = false;  // they are strictly inside, and the budget ran out on the way
  unsigned pending_changes_ = kChangedAll;  // where nonzero, the next tick's in place of `changed`
};

}  // namespace graspforce
