// The forces of a grasp, tick after tick: the header for controllers.
//
// A Servo is a problem's fields by name, written in place, and `tick()`. All memory is made by the
// constructor; after it nothing allocates, locks, throws, prints or calls the system. (A limit on
// time reads the steady clock.) Servos share nothing: use one a thread.
#pragma once

#include <algorithm>

#include "graspforce/double_buffer.hpp"
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
        numbers_(layout, engine_.structure()) {}

  using ProblemData::operator=;  // all fields at once

  // Solves from the fields as they stand. Numbers that do not make a problem are refused with
  // InvalidNumbers and a refusal(): nothing but that changes, and c() stays that of the last tick.
  Status tick() {
    stage();
    return refuses() ? Status::InvalidNumbers : solve_staged().status;
  }

  // Discards the past optima: the next tick starts cold.
  void reset() { engine_.reset(); }

  const Layout& layout() const { return engine_.layout(); }

  // ---- what the last tick found ----------------------------------------------------------------

  Span<const double> c() const { return {engine_.forces(), layout().components()}; }
  // Of the motors, in the rows of `internal`.
  Span<const double> internal_forces() const {
    return {engine_.forces() + layout().components(), layout().internals};
  }
  Span<const double> nu() const { return {engine_.multipliers(), layout().wrench_rows}; }

  // Verdict, steps, decrement, where the steps set out from, violation, time; of the last tick that
  // was not refused.
  const Result& result() const { return engine_.result(); }

  // Why the last tick was refused: the field, its entry, what came and what was expected. False as
  // a condition when it was not.
  const Flaw& refusal() const { return refusal_; }

  // The problem of the last tick that was not refused. While it is kept, a later tick makes itself
  // new memory; this is the one thing that lets a tick allocate.
  Snapshot snapshot() const { return numbers_.snapshot(); }

  // The torque that a joint's motor has to give: J.T c + tau_bias, and what the internal forces
  // make of it [N·m].
  double torque(int joint) const {
    const Problem p(offsets(), numbers_.now());
    double tau = p.tau_bias[joint];
    const int m = layout().components(), all = force_count(layout());
    for (int i = 0; i < all; ++i) tau += p.arm(i, joint, m, layout().joints) * engine_.forces()[i];
    return tau;
  }

  // None at all before the first tick.
  Margins margins() const {
    if (!ticked_) return {0, 0, 0, 0};
    return find_margins(layout(), Problem(offsets(), numbers_.now()), engine_.forces());
  }

  // For the certificate of an infeasible tick.
  const Engine& engine() const { return engine_; }
  bool ticked() const { return ticked_; }
  const Offsets& offsets() const { return numbers_.offsets(); }

 protected:
  // Makes the fields as they stand the snapshot that there is before the first tick.
  void take_first_snapshot() { std::copy_n(packed(), packed_size(), numbers_.now()); }

  // A tick in three parts, for callers that have numbers of their own beside the fields: stage the
  // fields, stage other numbers in the place of some, then ask and solve; `restore` copies staged
  // numbers back to a field.
  void stage() { numbers_.stage(packed()); }
  void stage(const double* numbers, std::size_t offset, std::size_t count) {
    numbers_.stage(numbers, offset, count);
  }
  void restore(std::size_t offset, std::size_t count) { numbers_.restore(packed(), offset, count); }

  // Whether the staged numbers make no problem; refusal() says why.
  bool refuses() {
    changed_ = ticked_ ? numbers_.changes() : unsigned(kChangedAll);
    const bool finite = numbers_.finite();
    refusal_ = finite && !(changed_ & kChangedRest) ? Flaw{}
                                                    : find_flaw(layout(), numbers_.next(), finite);
    return bool(refusal_);
  }

  // Where rates are limited, forces that were found become the last ones of the next tick, those
  // for the nearest wrench too.
  const Result& solve_staged() {
    numbers_.swap();
    ticked_ = true;
    const Result& result = engine_.tick(numbers_.now(), settings, changed_);
    if (layout().rate_limits && (result.status == Status::Solved || result.nearest))
      std::copy_n(engine_.forces(), c_last.size(), c_last.begin());
    return result;
  }

 private:
  Engine engine_;
  DoubleBuffer numbers_;
  Flaw refusal_;
  unsigned changed_ = kChangedAll;
  bool ticked_ = false;
};

}  // namespace graspforce
