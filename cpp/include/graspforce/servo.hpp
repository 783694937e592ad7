// The forces of a grasp, tick after tick: what a controller includes.
//
// A Servo is a problem's fields by name, written in place, and `tick()`. All memory is made by the
// constructor; after it nothing allocates, locks, throws, prints or calls the system. (A limit on
// time reads the steady clock.) Servos share nothing: use one a thread.
#pragma once

#include <vector>

#include "graspforce/engine.hpp"
#include "graspforce/margins.hpp"
#include "graspforce/problem_data.hpp"
#include "graspforce/validity.hpp"

namespace graspforce {

class Servo : public ProblemData {
 public:
  Settings settings;  // of the ticks to come

  // The layout is the largest grasp that there will be: contacts may leave it by an engagement of
  // 0, joints by a column of zeros in J.
  explicit Servo(const Layout& layout, const Settings& limits = {})
      : ProblemData(layout),
        settings(limits),
        engine_(layout),
        at_(layout),
        now_(at_.size),
        next_(at_.size) {}

  using ProblemData::operator=;  // all fields at once

  // Solves from the fields as they stand. Numbers that do not make a problem are refused with
  // InvalidNumbers and a refusal(): nothing but that changes, and c() stays that of the last tick.
  Status tick() {
    const bool finite = copy_finite(packed(), next_.data(), at_.size);
    const unsigned changed =
        ticked_ ? find_changes(at_, now_.data(), next_.data()) : unsigned(kChangedAll);
    refusal_ = !finite                  ? "a number that is not finite"
               : changed & kChangedRest ? find_flaw(layout(), Problem(at_, next_.data()))
                                        : nullptr;
    if (refusal_ != nullptr) return Status::InvalidNumbers;
    now_.swap(next_);
    ticked_ = true;
    return engine_.tick(now_.data(), settings, changed).status;
  }

  // Forgets the past optima: the next tick starts cold.
  void reset() { engine_.reset(); }

  const Layout& layout() const { return engine_.layout(); }

  // ---- what the last tick found ----------------------------------------------------------------

  Span<const double> c() const { return {engine_.forces(), layout().components()}; }
  Span<const double> nu() const { return {engine_.multipliers(), layout().wrench_rows}; }

  // Verdict, steps, decrement, where the steps set out from, violation, time; of the last tick that
  // was not refused.
  const Result& result() const { return engine_.result(); }

  // Why the last tick was refused; null when it was not.
  const char* refusal() const { return refusal_; }

  // The torque that a joint's motor has to give: J.T c + tau_bias [N·m].
  double torque(int joint) const {
    const Problem p(at_, now_.data());
    double tau = p.tau_bias[joint];
    for (int i = 0; i < layout().components(); ++i)
      tau += p.J[i * layout().joints + joint] * engine_.forces()[i];
    return tau;
  }

  // None at all before the first tick.
  Margins margins() const {
    if (!ticked_) return {0, 0, 0, 0};
    return find_margins(layout(), Problem(at_, now_.data()), engine_.forces());
  }

  // For the certificate of an infeasible tick.
  const Engine& engine() const { return engine_; }

 private:
  Engine engine_;
  Offsets at_;
  std::vector<double> now_, next_;  // of the last tick, and of the one that is being made
  const char* refusal_ = nullptr;
  bool ticked_ = false;
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
    case Status::InvalidNumbers:
      break;
  }
  return "INVALID_NUMBERS";
}

}  // namespace graspforce
