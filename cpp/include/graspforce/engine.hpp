// A solver for one layout: a cold solve, and a servo tick from the ticks before.
//
// The constructor makes room for whatever a problem of the layout can need: every contact in the
// grasp and all of them tied together by joints or inequalities. After it neither solve nor tick
// allocates. Nothing here throws or prints.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/barrier.hpp"
#include "graspforce/budget.hpp"
#include "graspforce/floating_point.hpp"
#include "graspforce/lane_barrier.hpp"
#include "graspforce/newton.hpp"
#include "graspforce/orthogonal_barrier.hpp"
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

// Where the Newton steps that led to the answer set out from.
enum class Start : int {
  Cold = 0,          // pure pushes, or Phase 1
  Held = 1,          // the last optimum
  Extrapolated = 2,  // the last two optima
  Given = 3,         // forces that the caller gave
};

struct Result {
  Status status = Status::InvalidNumbers;
  int newton_steps = 0;
  double decrement = kInfinity;  // certified bound, for Phi / min(1, alpha)
  double violation = 0;          // least relative violation when infeasible
  Start start = Start::Cold;
  double elapsed_us = 0;  // measured only where the settings limit the time
};

class Engine {
 public:
  explicit Engine(const Layout& layout)
      : layout_(layout),
        offsets_(layout),
        structure_(layout_),
        lanes3_single_(layout_),
        lanes4_single_(layout_),
        lanes3_(layout_),
        lanes4_(layout_),
        blocks_(layout_),
        barrier_(blocks_),
        least_squares_(blocks_),
        orthogonal_barrier_(blocks_, least_squares_),
        primal_dual_(blocks_, least_squares_),
        rank_(layout_),
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
  const Result& result() const { return result_; }  // of the last solve or tick
  const double* forces() const { return c_.data(); }
  const double* multipliers() const { return nu_.data(); }
  const double* certificate_y() const { return y_.data(); }
  const double* certificate_z() const { return z_.data(); }
  std::size_t limits() const { return z_.size(); }

  // Solves from `start` (m forces) where it is inside the limits, else from nothing. Where rates
  // are limited the last forces are the start that there is.
  const Result& solve(const double* packed, const Settings& settings,
                      const double* start = nullptr) {
    const DefaultFloatingPoint environment;
    const Problem problem(offsets_, packed);
    if (start == nullptr && layout_.rate_limits) start = problem.c_last;
    // The next tick's numbers are compared with these, not with its last.
    pending_changes_ = kChangedAll;
    dispatch(problem, settings, kChangedAll, [&](auto& barrier, Budget& budget, unsigned) {
      double lambda = kInfinity;
      if (start != nullptr) {
        result_.start = Start::Given;
        barrier.set_forces(start);
        lambda = first_step(barrier, problem);
      }
      run(barrier, problem, lambda, settings.tol, budget);
    });
    return result_;
  }

  // Solves the next problem of a stream, from the optima before it. `changed` tells what differs
  // from the tick before.
  const Result& tick(const double* packed, const Settings& settings,
                     unsigned changed = kChangedAll) {
    const DefaultFloatingPoint environment;
    const Problem problem(offsets_, packed);
    changed |= pending_changes_;
    pending_changes_ = 0;
    dispatch(problem, settings, changed, [&](auto& barrier, Budget& budget, unsigned news) {
      if (news & kChangedRest) {
        for (int i = 0; i < layout_.contacts(); ++i)
          ceiling_[i] = layout_.ceilings ? problem.engagement[i] * problem.c_max[i] : 1;
        ticks_since_limits_changed_ = 0;
      } else {
        ++ticks_since_limits_changed_;
      }
      run(barrier, problem, predict(barrier, problem), settings.tol, budget);
    });
    // A tick that ran out of budget goes on from where it stopped.
    const bool unfinished = result_.status == Status::MaxSteps && wrench_error_ < kInfinity;
    if (result_.status != Status::Solved) history_size_ = 0;
    if (result_.status == Status::Solved || unfinished) remember(problem);
    return result_;
  }

  void reset() { history_size_ = 0; }

 private:
  // Decrement at an extrapolated start above which the last optimum is looked at as well.
  static constexpr double kPromising = 0.5;

  struct Past {
    std::vector<double> c, ceiling;
  };

  enum class Kernels { General, Lanes3Single, Lanes4Single, Lanes3, Lanes4 };

  // Loads the problem and hands it to the kernels that fit it, with what is new to them.
  template <class Work>
  void dispatch(const Problem& problem, const Settings& settings, unsigned changed, Work work) {
    result_ = Result();
    if (layout_.joints == 0 && !layout_.ceilings && layout_.inequalities == 0 &&
        !layout_.rate_limits)
      return answer_nothing(Status::Unbounded);
    Budget budget(settings);
    if (!structure_.holds(problem, changed)) {
      rearrange(problem);
      changed = kChangedAll;
    }
    rank_known_ = unreachable_ = false;
    if (structure_.blocks().empty()) return answer_idle(problem);
    auto work_on = [&](auto& rows, auto& barrier) {
      rows.load(problem, changed);
      if (was_deficient_) reduce_rank(rows, problem);
      work(barrier, budget, changed);
    };
    switch (kernels_) {
      case Kernels::Lanes3Single:
        work_on(lanes3_single_, lanes3_single_);
        break;
      case Kernels::Lanes4Single:
        work_on(lanes4_single_, lanes4_single_);
        break;
      case Kernels::Lanes3:
        work_on(lanes3_, lanes3_);
        break;
      case Kernels::Lanes4:
        work_on(lanes4_, lanes4_);
        break;
      case Kernels::General:
        barrier_.set_weights(*problem.alpha);
        work_on(blocks_, barrier_);
    }
    if (result_.status == Status::Solved && was_deficient_ && !rank_.fits(problem, c_.data()))
      result_.status = Status::Stalled;
    if (result_.status != Status::Solved && !finite()) answer_nothing(Status::InvalidNumbers);
    result_.newton_steps = budget.steps();
    result_.elapsed_us = budget.elapsed_us();
  }

  // Finds the blocks anew.
  void rearrange(const Problem& problem) {
    structure_.find(problem);
    blocks_.allot(structure_);
    barrier_.allot();
    least_squares_.allot();
    orthogonal_barrier_.allot();
    primal_dual_.allot();
    kernels_ = Kernels::General;
    auto prefer = [&](auto& barrier, Kernels kernels) {
      if (kernels_ != Kernels::General || !barrier.fits(layout_, structure_)) return;
      kernels_ = kernels;
      barrier.allot(structure_);
    };
    prefer(lanes3_single_, Kernels::Lanes3Single);
    prefer(lanes4_single_, Kernels::Lanes4Single);
    prefer(lanes3_, Kernels::Lanes3);
    prefer(lanes4_, Kernels::Lanes4);
  }

  bool finite() const {
    for (double c : c_)
      if (!std::isfinite(c)) return false;
    for (double nu : nu_)
      if (!std::isfinite(nu)) return false;
    return true;
  }

  void answer_nothing(Status status) {
    std::fill(c_.begin(), c_.end(), 0.0);
    std::fill(nu_.begin(), nu_.end(), 0.0);
    result_.status = status;
    result_.decrement = kInfinity;
    result_.violation = 0;
  }

  // With every contact out of the grasp nothing is left to ask for but what no contact touches.
  void answer_idle(const Problem& p) {
    if (std::any_of(p.f, p.f + layout_.wrench_rows, [](double f) { return f != 0; }))
      return answer_nothing(Status::WrenchUnreachable);
    answer_nothing(Status::Solved);
    result_.decrement = 0;
    const int m = layout_.components(), joints = layout_.joints;
    std::fill(y_.begin(), y_.end(), 0.0);
    std::fill(z_.begin(), z_.end(), 0.0);
    // A limit 0 ≤ room that is not kept proves by itself that nothing can be done about it.
    auto keep = [&](int limit, double room, double scale, const double* entry, int stride) {
      if (room > 0 || result_.status != Status::Solved) return;
      for (int c = 0; c < m; ++c)
        if (entry[c * stride] != 0) return;
      z_[limit] = 1;
      result_.status = proves_infeasible(layout_, p, y_.data(), z_.data()) ? Status::Infeasible
                                                                           : Status::Stalled;
      result_.decrement = kInfinity;
      if (result_.status == Status::Infeasible && scale > 0) result_.violation = -room / scale;
    };
    for (int j = 0; j < joints; ++j) {
      const double half = 0.5 * (p.tau_hi[j] - p.tau_lo[j]);
      keep(j, p.tau_hi[j] - p.tau_bias[j], half, p.J + j, joints);
      keep(joints + j, p.tau_bias[j] - p.tau_lo[j], half, p.J + j, joints);
    }
    for (int r = 0; r < layout_.inequalities; ++r)
      keep(limit_count(layout_) - layout_.inequalities + r, p.b[r], std::abs(p.b[r]), p.A + r * m,
           1);
  }

  // Reduces W c = f to independent rows where it has others.
  template <class Rows>
  void reduce_rank(Rows& rows, const Problem& problem) {
    rank_.run(problem);
    rank_known_ = true;
    unreachable_ = rank_.overflows() || !rank_.reachable();
    was_deficient_ = rank_.deficient();
    if (was_deficient_) rows.restrict_rows(problem, rank_.rows());
  }
  void reduce_rank(Barrier&, const Problem& problem) { reduce_rank(blocks_, problem); }
  void reduce_rank(OrthogonalBarrier&, const Problem& problem) { reduce_rank(blocks_, problem); }

  // Decrement of the Newton step from the barrier's point; infinite outside the limits, and when
  // f turns out to be out of W's range.
  template <class AnyBarrier>
  double first_step(AnyBarrier& barrier, const Problem& problem) {
    if (unreachable_ || !barrier.evaluate()) return kInfinity;
    const double lambda = barrier.newton();
    if (rank_known_ || barrier.sound()) return lambda;
    reduce_rank(barrier, problem);
    return first_step(barrier, problem);
  }

  // Puts the barrier at the extrapolation of the last two optima, or at the last one where that
  // promises a shorter step (the wanted wrench may be noisy); returns the step's decrement.
  template <class AnyBarrier>
  double predict(AnyBarrier& barrier, const Problem& problem) {
    double ahead = kInfinity;
    result_.start = Start::Extrapolated;
    if (history_size_ == 2) {
      extrapolate(barrier, problem, 2);
      ahead = first_step(barrier, problem);
      if (ahead < kPromising) return ahead;
    }
    if (history_size_ == 0) return kInfinity;
    result_.start = Start::Held;
    extrapolate(barrier, problem, 1);
    const double hold = first_step(barrier, problem);
    if (hold <= ahead) return hold;
    result_.start = Start::Extrapolated;
    extrapolate(barrier, problem, 2);
    return first_step(barrier, problem);
  }

  // Forces extrapolated from the last `order` optima. A contact's forces are taken as shares of
  // its ceiling, so that they follow it to zero and back; a contact that has just come into the
  // grasp starts with a push.
  template <class AnyBarrier>
  void extrapolate(AnyBarrier& barrier, const Problem& problem, int order) {
    const Past &last = past_[newest_], &before = past_[1 - newest_];
    if (ticks_since_limits_changed_ >= 2 &&
        order == 2) {  // the ceilings are those of the last two ticks
      barrier.extrapolate(last.c.data(), before.c.data());
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
  void run(AnyBarrier& barrier, const Problem& problem, double lambda, double tol, Budget& budget) {
    wrench_error_ = kInfinity;
    if (lambda < kInfinity && newton(barrier, lambda, tol, budget, false)) return;
    result_.start = Start::Cold;
    barrier.set_pushes(push(problem));
    lambda = first_step(barrier, problem);
    if (lambda < kInfinity && newton(barrier, lambda, tol, budget, false)) return;
    if (!rank_known_) reduce_rank(barrier, problem);
    if (unreachable_)
      return answer_nothing(rank_.overflows() ? Status::InvalidNumbers : Status::WrenchUnreachable);
    std::fill(nu_.begin(), nu_.end(), 0.0);

    if (kernels_ != Kernels::General) {  // the primal–dual method works on the general blocks
      blocks_.load(problem);
      if (was_deficient_) blocks_.restrict_rows(problem, rank_.rows());
    }
    const PhaseOneResult phase = primal_dual_.find_inside(problem, budget, y_, z_);
    using End = PhaseOneResult::End;
    if (phase.end != End::Inside) {
      // Without a verdict, forces inside the limits that lack some of f are better than forces
      // that make f and slip.
      if (phase.end == End::Infeasible || wrench_error_ == kInfinity) {
        primal_dual_.get_forces(c_.data());
        barrier.set_forces(c_.data());
        if (barrier.inside()) wrench_error_ = barrier.wrench_error();
        result_.decrement = kInfinity;  // what was known was of other forces
      }
      result_.violation = std::isfinite(phase.violation) ? phase.violation : 0;
      result_.status = phase.end == End::Infeasible ? Status::Infeasible
                       : phase.end == End::Steps    ? Status::MaxSteps
                       : phase.end == End::Overflow ? Status::InvalidNumbers
                                                    : Status::Stalled;
      return;
    }
    primal_dual_.follow(barrier.cone_weight(), barrier.limit_weight(), budget);
    primal_dual_.get_forces(c_.data());
    orthogonal_barrier_.set_weights(barrier.cone_weight(), barrier.limit_weight());
    orthogonal_barrier_.set_forces(c_.data());
    newton(orthogonal_barrier_, first_step(orthogonal_barrier_, problem), tol, budget, true);
    if (result_.status != Status::Solved && orthogonal_barrier_.runaway())
      answer_nothing(Status::Unbounded);
  }

  // Newton's method from the barrier's point; true when that ends the solve: with a certified
  // answer, or with the budget spent and forces in hand. A point without a certificate is kept if
  // it is strictly inside the limits and lacks less of f than the last one.
  template <class AnyBarrier>
  bool newton(AnyBarrier& barrier, double lambda, double tol, Budget& budget, bool balanced) {
    const Newton outcome = minimise(barrier, lambda, tol, budget, balanced);
    using End = Newton::End;
    if (outcome.end == End::Certified && barrier.runaway()) {  // rounding alone has stopped it
      answer_nothing(Status::Unbounded);
      return true;
    }
    result_.status = outcome.end == End::Certified  ? Status::Solved
                     : outcome.end == End::Overflow ? Status::InvalidNumbers
                     : outcome.end == End::Spent    ? Status::MaxSteps
                                                    : Status::Stalled;
    if (result_.status != Status::Solved) {
      const double error = barrier.inside() ? barrier.wrench_error() : kInfinity;
      if (!(error <= wrench_error_) && !balanced) return false;
      wrench_error_ = error;
    }
    result_.decrement = outcome.bound;
    barrier.get_forces(c_.data());
    barrier.get_multipliers(nu_.data());
    return result_.status == Status::Solved || (budget.spent() && wrench_error_ < kInfinity);
  }

  void remember(const Problem& problem) {
    newest_ = 1 - newest_;
    std::copy(c_.begin(), c_.end(), past_[newest_].c.begin());
    for (int i = 0;
         (history_size_ < 2 || ticks_since_limits_changed_ < 2) && i < layout_.contacts(); ++i)
      past_[newest_].ceiling[i] = problem.in_grasp(i) ? ceiling_[i] : 0;
    history_size_ = std::min(history_size_ + 1, 2);
  }

  Layout layout_;
  Offsets offsets_;
  Structure structure_;
  // For grasps without coupled contacts; the first of each pair up to four contacts, the threes
  // without soft fingers.
  LaneBarrier<3, true> lanes3_single_;
  LaneBarrier<4, true> lanes4_single_;
  LaneBarrier<3, false> lanes3_;
  LaneBarrier<4, false> lanes4_;
  Blocks blocks_;  // for all others, and for the primal–dual method
  Barrier barrier_;
  LeastSquares least_squares_;  // of the two that follow
  OrthogonalBarrier orthogonal_barrier_;
  PrimalDual primal_dual_;
  RankExamination rank_;
  std::vector<double> c_, nu_, y_, z_, guess_, ceiling_;
  Past past_[2];
  int newest_ = 0, history_size_ = 0;
  int ticks_since_limits_changed_ = 0;      // ticks since the ceilings may last have changed
  unsigned pending_changes_ = kChangedAll;  // what the next tick has to load whatever it is told
  Kernels kernels_ = Kernels::General;
  Result result_;
  double wrench_error_ = kInfinity;  // of the best force inside the limits that is known
  bool rank_known_ = false, was_deficient_ = false, unreachable_ = false;
};

}  // namespace graspforce
