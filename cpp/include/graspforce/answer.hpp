// The result of a solve: status, forces, multipliers and, where there is one, a certificate; and
// how a run of Newton's method enters it.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/budget.hpp"
#include "graspforce/cone.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/newton.hpp"

namespace graspforce {

enum class Status : int {
  Solved = 0,
  Infeasible = 1,
  WrenchUnreachable = 2,
  Unbounded = 3,
  MaxSteps = 4,
  Stalled = 5,
  InvalidNumbers = 6,
  OnEdge = 7,
};

inline const char* to_string(Status status) {
  switch (status) {
    case Status::Solved:
      return "SOLVED";
    case Status::Infeasible:
      return "INFEASIBLE";
    case Status::WrenchUnreachable:
      return "WRENCH_UNREACHABLE";
    case Status::Unbounded:
      return "UNBOUNDED";
    case Status::MaxSteps:
      return "MAX_STEPS";
    case Status::Stalled:
      return "STALLED";
    case Status::OnEdge:
      return "ON_EDGE";
    case Status::InvalidNumbers:
      break;
  }
  return "INVALID_NUMBERS";
}

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
  double decrement = kInfinity;  // certified bound, for Phi / barrier_unit
  double violation = 0;          // least relative violation when infeasible
  // Without a verdict of Solved: the forces are strictly inside every cone and limit, and make the
  // wrench nearest to f (see nearest.hpp).
  bool nearest = false;
  Start start = Start::Cold;
  double elapsed_us = 0;  // measured only where the settings limit the time
};

struct Answer {
  Result result;
  std::vector<double> c;   // forces of the contacts, then the internal ones
  std::vector<double> nu;  // multipliers of W c = f
  // The certificate when infeasible, as proves_infeasible takes it.
  std::vector<double> y, z;
  double wrench_error = kInfinity;  // of the best forces inside the limits that are known

  explicit Answer(const Layout& layout)
      : c(force_count(layout)),
        nu(layout.wrench_rows),
        y(layout.wrench_rows),
        z(limit_count(layout)) {}

  // Zeros with a verdict.
  void clear(Status status) {
    std::fill(c.begin(), c.end(), 0.0);
    std::fill(nu.begin(), nu.end(), 0.0);
    result.status = status;
    result.decrement = kInfinity;
    result.violation = 0;
    result.nearest = false;
  }

  // Takes over what Newton's method has reached on a barrier; true when that ends the solve: with a
  // certified answer, or with the budget spent and forces in hand. A point without a certificate is
  // kept if it is strictly inside the limits and lacks less of f than the last one, or if the run
  // began `balanced`.
  template <class AnyBarrier>
  bool take(const Newton& reached, const AnyBarrier& barrier, const Budget& budget, bool balanced) {
    using End = Newton::End;
    if (reached.end == End::Certified && barrier.runaway()) {  // bounded by rounding only
      clear(Status::Unbounded);
      return true;
    }
    result.status = reached.end == End::Certified  ? Status::Solved
                    : reached.end == End::Overflow ? Status::InvalidNumbers
                    : reached.end == End::Spent    ? Status::MaxSteps
                                                   : Status::Stalled;
    if (result.status != Status::Solved) {
      const double error = barrier.inside() ? barrier.wrench_error() : kInfinity;
      if (!(error <= wrench_error) && !balanced) return false;
      wrench_error = error;
    }
    result.decrement = reached.bound;
    barrier.get_forces(c.data());
    barrier.get_multipliers(nu.data());
    return result.status == Status::Solved || (budget.spent() && wrench_error < kInfinity);
  }

  bool finite() const {
    const auto is_finite = [](double number) { return std::isfinite(number); };
    return std::all_of(c.begin(), c.end(), is_finite) &&
           std::all_of(nu.begin(), nu.end(), is_finite);
  }
};

}  // namespace graspforce
