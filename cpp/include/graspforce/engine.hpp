// A solver for one layout: a cold solve, and a servo tick from the ticks before.
//
// Set up once; after that neither solve nor tick allocates as long as the pattern of J and A and
// the set of contacts in the grasp stay the same. Nothing here throws or prints.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/newton.hpp"
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
        system_(layout_),
        c_(layout.components()),
        nu_(layout.wrench_rows),
        y_(layout.wrench_rows),
        y_try_(layout.wrench_rows),
        guess_(layout.components()) {
    const std::size_t limits = 2 * layout.joints + layout.inequalities +
                               layout.contacts() * (int(layout.ceilings) + int(layout.floors));
    z_.resize(limits);
    z_try_.resize(limits);
    for (Past& past : past_) {
      past.c.resize(layout.components());
      past.ceiling.resize(layout.contacts());
    }
    ceiling_.resize(layout.contacts());
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
    const Problem problem(layout_, packed);
    Result result;
    if (!prepare(problem, result)) return result;
    bool warm = start != nullptr;
    if (warm) {
      system_.set_forces(start);
      warm = system_.inside();
    }
    if (!warm) start_cold(problem);
    return run(problem, tol, max_steps, warm);
  }

  // Solves the next problem of a stream, from the optima before it.
  Result tick(const double* packed, double tol, int max_steps) {
    const Problem problem(layout_, packed);
    Result result;
    if (prepare(problem, result)) {
      for (int i = 0; i < layout_.contacts(); ++i)
        ceiling_[i] = layout_.ceilings ? problem.engagement[i] * problem.c_max[i] : 1;
      const bool warm = predict(problem);
      if (!warm) start_cold(problem);
      result = run(problem, tol, max_steps, warm);
    }
    if (result.status == Status::Solved)
      remember(problem);
    else
      known_ = 0;
    return result;
  }

  void reset() { known_ = 0; }

 private:
  // Newton steps without Phase 1 after which a start counts as leading nowhere.
  static constexpr int kPatience = 30;
  // Forces this many times their reach, with no minimum found, mean that nothing holds them.
  static constexpr double kRunaway = 1e9;

  struct Past {
    std::vector<double> c, ceiling;
  };

  // Loads the problem; false with the result's status set when there is nothing to iterate on.
  bool prepare(const Problem& problem, Result& result) {
    rank_known_ = false;
    if (layout_.joints == 0 && !layout_.ceilings && layout_.inequalities == 0) {
      result.status = Status::Unbounded;
      return give_up();
    }
    system_.load(problem);
    return !was_deficient_ || restrict_to_range(problem, result);
  }

  // Reduces W c = f to independent rows; false when f is out of their range.
  bool restrict_to_range(const Problem& problem, Result& result) {
    const Rank rank = examine_rank(layout_, problem);
    rank_known_ = true;
    was_deficient_ = static_cast<int>(rank.rows.size()) < layout_.wrench_rows;
    if (was_deficient_) system_.restrict_rows(problem, rank.rows);
    if (rank.reachable) return true;
    result.status = Status::WrenchUnreachable;
    return give_up();
  }

  bool give_up() {
    std::fill(c_.begin(), c_.end(), 0.0);
    std::fill(nu_.begin(), nu_.end(), 0.0);
    return false;
  }

  // Pure pushes; the more the limits weigh, the smaller the forces that balance them.
  void start_cold(const Problem& problem) {
    system_.set_pushes(1 / std::sqrt(4 + 3 * *problem.alpha));
  }

  // Newton from the system's point where that is inside the limits and leads somewhere, else from
  // where Phase 1 ends.
  Result run(const Problem& problem, double tol, int max_steps, bool warm) {
    Result result;
    if (system_.inside()) {
      Newton newton = minimise(system_, tol, std::min(max_steps, kPatience), false, rank_known_);
      if (newton.end == Newton::End::Suspect) {
        if (!restrict_to_range(problem, result)) return result;
        newton = minimise(system_, tol, std::min(max_steps, kPatience), false, true);
      }
      result.newton_steps = newton.steps;
      if (newton.end == Newton::End::Certified) return solved(newton, result);
      if (warm) {
        start_cold(problem);
        const Result cold = run(problem, tol, max_steps, false);
        result.status = cold.status;
        result.decrement = cold.decrement;
        result.violation = cold.violation;
        result.newton_steps += cold.newton_steps;
        return result;
      }
    }
    if (!rank_known_ && !restrict_to_range(problem, result)) return result;
    const PhaseOne phase = find_inside(system_, layout_, problem, max_steps, y_.data(), z_.data(),
                                       y_try_.data(), z_try_.data());
    result.newton_steps += phase.steps;
    result.violation = phase.end == PhaseOne::End::Infeasible ? phase.violation : 0;
    switch (phase.end) {
      case PhaseOne::End::Inside: {
        const Newton newton = minimise(system_, tol, max_steps, true, true);
        result.newton_steps += newton.steps;
        if (newton.end == Newton::End::Certified) return solved(newton, result);
        result.status = newton.end == Newton::End::Steps      ? Status::MaxSteps
                        : newton.end == Newton::End::Overflow ? Status::InvalidNumbers
                                                              : Status::Stalled;
        if (system_.largest_force() > kRunaway * system_.largest_reach())
          result.status = Status::Unbounded;
        break;
      }
      case PhaseOne::End::Infeasible:
        result.status = Status::Infeasible;
        break;
      case PhaseOne::End::Steps:
        result.status = Status::MaxSteps;
        break;
      case PhaseOne::End::Closest:
        result.status = Status::Stalled;
        break;
      case PhaseOne::End::Overflow:
        result.status = Status::InvalidNumbers;
        break;
    }
    finish();
    return result;
  }

  Result solved(const Newton& newton, Result result) {
    result.status = Status::Solved;
    result.decrement = newton.bound;
    finish();
    return result;
  }

  void finish() {
    system_.get_forces(c_.data());
    system_.get_multipliers(nu_.data());
  }

  // Puts the system at the extrapolation of the last two optima, or at the last one. A contact's
  // forces are taken as shares of its ceiling, so that they follow it to zero and back; a contact
  // that has just come into the grasp starts with a push. False when neither point is inside.
  bool predict(const Problem& problem) {
    for (int order = std::min(known_, 2); order > 0; --order) {
      const Past &last = past_[newest_], &before = past_[1 - newest_];
      for (int i = 0, c = 0; i < layout_.contacts(); ++i) {
        const int end = c + static_cast<int>(layout_.models[i]);
        const double now = ceiling_[i];
        const bool one = last.ceiling[i] > 0, two = order == 2 && before.ceiling[i] > 0;
        const double push = now / std::sqrt(4 + 3 * *problem.alpha);
        const double to_last = one ? now / last.ceiling[i] : 0;
        const double to_before = two ? now / before.ceiling[i] : 0;
        for (bool normal = true; c < end; ++c, normal = false) {
          if (!one)
            guess_[c] = normal ? push : 0;
          else if (!two)
            guess_[c] = to_last * last.c[c];
          else
            guess_[c] = 2 * to_last * last.c[c] - to_before * before.c[c];
        }
      }
      system_.set_forces(guess_.data());
      if (system_.inside()) return true;
    }
    return false;
  }

  void remember(const Problem& problem) {
    newest_ = 1 - newest_;
    std::copy(c_.begin(), c_.end(), past_[newest_].c.begin());
    for (int i = 0; i < layout_.contacts(); ++i)
      past_[newest_].ceiling[i] = problem.in_grasp(i) ? ceiling_[i] : 0;
    known_ = std::min(known_ + 1, 2);
  }

  Layout layout_;
  System system_;
  std::vector<double> c_, nu_, y_, z_, y_try_, z_try_, guess_, ceiling_;
  Past past_[2];
  int newest_ = 0, known_ = 0;
  bool rank_known_ = false, was_deficient_ = false;
};

}  // namespace graspforce
