// The native half of graspforce.Servo.
#pragma once

#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <stdexcept>

#include "graspforce/validity.hpp"
#include "outcome.hpp"

namespace graspforce {

// Fields of a tick, in the order of Servo.step.
enum Field {
  kF,
  kW,
  kJ,
  kTauLo,
  kTauHi,
  kTauBias,
  kCMax,
  kCMin,
  kEngagement,
  kA,
  kB,
  kAlpha,
  kFields
};

class Servo {
 public:
  // `statuses` are the members of graspforce.Status in their order; `refuse` gets the numbers that
  // do not make a problem and raises an error that says why; `solution` and `shape` are
  // graspforce.Solution and its second argument.
  Servo(int wrench_rows, const std::vector<int>& dims, int joints, int inequalities, bool ceilings,
        bool floors, Vector packed, double tol, int max_steps, double budget_us,
        const std::vector<nb::object>& statuses, nb::object refuse, nb::object solution,
        nb::object shape)
      : engine_(make_layout(wrench_rows, dims, joints, inequalities, ceilings, floors)),
        at_(engine_.layout()),
        settings_{tol, max_steps, budget_us},
        statuses_(statuses),
        refuse_(std::move(refuse)),
        solution_(std::move(solution)),
        shape_(std::move(shape)),
        numbers_(packed.data(), packed.data() + packed.size()),
        now_(std::make_shared<std::vector<double>>(numbers_)),
        next_(std::make_shared<std::vector<double>>(numbers_)) {
    const Layout& layout = engine_.layout();
    const int n = layout.contacts(), m = layout.components(), k = wrench_rows;
    auto place = [&](Field field, std::size_t offset, int rows, int columns) {
      slots_[field] = {offset, rows, columns};
    };
    place(kF, at_.f, k, 0);
    place(kW, 0, k, m);
    place(kJ, at_.J, m, joints);
    place(kTauLo, at_.tau_lo, joints, 0);
    place(kTauHi, at_.tau_hi, joints, 0);
    place(kTauBias, at_.tau_bias, joints, 0);
    place(kCMax, at_.c_max, ceilings ? n : 0, 0);
    place(kCMin, at_.c_min, floors ? n : 0, 0);
    place(kEngagement, at_.engagement, n, 0);
    place(kA, at_.A, inequalities, m);
    place(kB, at_.b, inequalities, 0);
  }

  // Solves from the numbers as they stand in `numbers()`; the verdict.
  nb::object tick() {
    const Turn turn(busy_);
    const bool finite = collect();
    compare();
    if (!finite || !plausible()) {
      refuse_(own_array(numbers_));
      throw nb::value_error("the numbers of the tick do not make a problem");
    }
    return statuses_[static_cast<int>(solve().status)];
  }

  // Takes changed fields that are plainly fine and solves, for a Solution; None, with nothing
  // changed, when any is not a float64 array of the field's shape or might not be valid: Python
  // looks closer.
  nb::object step(PyObject* const* given) {
    const Turn turn(busy_);
    if (given[kAlpha] != Py_None || !collect()) return nb::none();
    for (int field = 0; field < kAlpha; ++field)
      if (given[field] != Py_None && !stage(given[field], slots_[field])) return nb::none();
    compare();
    if (!plausible()) return nb::none();
    for (int field = 0; field < kAlpha; ++field)
      if (given[field] != Py_None) slots_[field].copy(*next_, numbers_);
    return make_solution(solution_, nb::cast(outcome(solve())), shape_);
  }

  Outcome step_problem(Vector packed) {
    if (packed.size() != numbers_.size()) throw nb::value_error("packed: wrong size");
    const Turn turn(busy_);
    numbers_.assign(packed.data(), packed.data() + packed.size());
    collect();
    compare();
    return outcome(solve());
  }

  // What the last tick found, if there was one.
  std::optional<Outcome> last() {
    const Turn turn(busy_);
    if (!ticked_) return std::nullopt;
    return outcome(result_);
  }

  void reset() {
    const Turn turn(busy_);
    engine_.reset();
  }

  std::vector<double>& numbers() { return numbers_; }
  const Engine& engine() const { return engine_; }
  nb::object packed() const { return own_array(*now_); }

 private:
  struct Slot {
    std::size_t offset = 0;
    int rows = 0, columns = 0;  // columns 0: a vector

    std::size_t size() const { return std::size_t(rows) * (columns > 0 ? columns : 1); }
    void copy(const std::vector<double>& from, std::vector<double>& to) const {
      std::copy_n(from.begin() + offset, size(), to.begin() + offset);
    }
  };

  // The interpreter's lock may be released while the core works: a second thread could get here.
  class Turn {
   public:
    explicit Turn(bool& busy) : busy_(busy) {
      if (busy) throw std::runtime_error("this Servo is at work in another thread");
      busy = true;
    }
    ~Turn() { busy_ = false; }
    Turn(const Turn&) = delete;

   private:
    bool& busy_;
  };

  // Sets out from the numbers as they stand; false unless all of them are finite.
  bool collect() {
    if (next_.use_count() > 1)  // somebody keeps the outcome of the tick before the last
      next_ = std::make_shared<std::vector<double>>(numbers_.size());
    return copy_finite(numbers_.data(), next_->data(), numbers_.size());
  }

  // Copies an array into its field of the next problem; false unless it is a C-contiguous array of
  // finite float64 numbers in the field's exact shape. By NumPy's own interface: the general ones
  // take longer than the Newton step.
  bool stage(PyObject* object, const Slot& slot) {
    if (!PyArray_CheckExact(object)) return false;
    auto* array = reinterpret_cast<PyArrayObject*>(object);
    return PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY_RO(array) &&
           matches(PyArray_NDIM(array), PyArray_DIMS(array), slot) &&
           copy_finite(static_cast<const double*>(PyArray_DATA(array)), next_->data() + slot.offset,
                       slot.size());
  }

  static bool matches(int axes, const npy_intp* shape, const Slot& slot) {
    if (slot.rows == 0 || axes != (slot.columns > 0 ? 2 : 1)) return false;
    return shape[0] == slot.rows && (axes == 1 || shape[1] == slot.columns);
  }

  // Finds what differs from the last tick.
  void compare() { changed_ = find_changes(at_, now_->data(), next_->data()); }

  // The value checks of ForceProblem that what differs could fail.
  bool plausible() const {
    return !(changed_ & kChangedRest) ||
           find_flaw(engine_.layout(), Problem(at_, next_->data())) == nullptr;
  }

  // Solves the next problem, which is fine.
  const Result& solve() {
    now_.swap(next_);
    ticked_ = true;
    const Release release(engine_.layout());
    return result_ = engine_.tick(now_->data(), settings_, changed_);
  }

  Outcome outcome(const Result& result) const { return Outcome(engine_, result, now_); }

  Engine engine_;
  Offsets at_;
  Settings settings_;
  std::vector<nb::object> statuses_;
  nb::object refuse_, solution_, shape_;
  std::vector<double> numbers_;  // as Python sees and writes them
  Numbers now_, next_;           // of the last tick, and of the one that is being made
  std::array<Slot, kAlpha> slots_;
  unsigned changed_ = kChangedAll;
  Result result_;
  bool ticked_ = false, busy_ = false;
};

// Servo.step for the interpreter, called with an array of its arguments: nanobind's dispatch of
// twelve of them takes as long as the tick itself.
inline PyObject* servo_step(PyObject* self, PyObject* const* arguments, Py_ssize_t count) noexcept {
  if (count != kFields) {
    PyErr_Format(PyExc_TypeError, "step() takes %d arguments, got %zd", int(kFields), count);
    return nullptr;
  }
  try {
    return nb::inst_ptr<Servo>(self)->step(arguments).release().ptr();
  } catch (nb::python_error& error) {
    error.restore();
  } catch (const std::exception& error) {
    PyErr_SetString(PyExc_RuntimeError, error.what());
  }
  return nullptr;
}

inline PyMethodDef servo_methods[] = {
    {"step", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(servo_step)), METH_FASTCALL,
     nullptr},
    {nullptr, nullptr, 0, nullptr}};
inline PyType_Slot servo_slots[] = {{Py_tp_methods, servo_methods}, {0, nullptr}};

}  // namespace graspforce
