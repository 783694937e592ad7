// The limits of a solve or a tick on steps and time, and what is used of them.
#pragma once

#include <chrono>

#include "graspforce/cone.hpp"

namespace graspforce {

struct Settings {
  double tol = 1e-9;             // certified bound on decrement²/2 at return
  int max_steps = 200;           // Newton steps in all
  double budget_us = kInfinity;  // time [µs]; the step that is under way is finished
};

class Budget {
 public:
  explicit Budget(const Settings& settings)
      : most_(settings.max_steps), timed_(settings.budget_us < kInfinity) {
    if (!timed_) return;  // reading the clock twice costs a tenth of a tick
    start_ = Clock::now();
    microseconds_ = settings.budget_us;
  }

  // Takes one more step out of the budget; false when there is none left. The first is
  // always granted.
  bool take() {
    if (spent() && steps_ > 0) return false;
    ++steps_;
    return true;
  }

  bool spent() const { return steps_ >= most_ || (timed_ && elapsed_us() > microseconds_); }
  int steps() const { return steps_; }

  // Time since the beginning [µs]; 0 without a limit on it.
  double elapsed_us() const {
    if (!timed_) return 0;
    return std::chrono::duration<double, std::micro>(Clock::now() - start_).count();
  }

 private:
  using Clock = std::chrono::steady_clock;

  int steps_ = 0, most_;
  bool timed_;
  double microseconds_ = 0;
  Clock::time_point start_;
};

}  // namespace graspforce
