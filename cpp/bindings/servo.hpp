// graspforce.Servo from Python: the core's Servo, and arrays in place of fields written one by one.
#pragma once

#include <nanobind/stl/optional.h>

#include <array>
#include <stdexcept>

#include "graspforce/servo.hpp"
#include "outcome.hpp"
#include "solution.hpp"

namespace graspforce {

// A flaw, of which Python makes the message: the field, the indices of the entry, what came, what
// was expected.
inline nb::object describe(const Flaw& flaw) {
  const nb::object indices = flaw.axes == 0   ? nb::make_tuple()
                             : flaw.axes == 1 ? nb::make_tuple(flaw.row)
                                              : nb::make_tuple(flaw.row, flaw.column);
  return nb::make_tuple(flaw.field, indices, flaw.got, flaw.expected);
}

class PythonServo : public Servo {
 public:
  // `shape` is a graspforce._engine.layout.Layout; `statuses` are the members of graspforce.Status
  // in their order; `refuse` gets a described flaw and raises an error; `solution` is
  // graspforce.Solution.
  PythonServo(nb::object shape, nb::handle packed, double tol, int max_steps, double budget_us,
              std::vector<nb::object> statuses, nb::object refuse, nb::object solution)
      : Servo(make_layout(shape), {tol, max_steps, budget_us}),
        shape_(std::move(shape)),
        statuses_(std::move(statuses)),
        refuse_(std::move(refuse)),
        solution_(std::move(solution)) {
    write(packed);
    take_first_snapshot();
    each_field(layout(), [this](const Field& field) {
      fields_.push_back(field);
      names_.push_back(nb::steal(PyUnicode_InternFromString(field.name)));
    });
  }

  // Solves from the numbers as they stand in the fields; the verdict.
  nb::object tick() {
    const BusyGuard guard(busy_);
    stage();
    if (refuses()) {
      refuse_(describe(refusal()));
      throw nb::value_error("the numbers of the tick do not make a problem");
    }
    return statuses_[static_cast<int>(solve().status)];
  }

  // Takes a dict of changed fields that need no conversion and solves, for a Solution; None, with
  // nothing changed, when any is no field, not a float64 array of the field's shape (or a float for
  // alpha) or might not be valid: Python then checks and converts.
  nb::object step(PyObject* changes) {
    const BusyGuard guard(busy_);
    stage();
    std::size_t staged_fields = 0;
    PyObject *name = nullptr, *value = nullptr;
    for (Py_ssize_t at = 0; PyDict_Next(changes, &at, &name, &value);) {
      if (value == Py_None) continue;
      const Field* field = find(name);
      if (field == nullptr || !stage_array(value, *field)) return nb::none();
      changed_[staged_fields++] = field;
    }
    if (refuses()) return nb::none();
    for (std::size_t i = 0; i < staged_fields; ++i)
      restore(changed_[i]->offset, changed_[i]->size());
    return make_solution(solution_, nb::cast(outcome(solve())), shape_);
  }

  // Solves a validated problem, whose numbers become the fields', for a Solution.
  nb::object step_problem(nb::handle packed, nb::handle problem) {
    const BusyGuard guard(busy_);
    write(packed);
    stage();
    if (refuses()) throw nb::value_error("packed: numbers that do not make a problem");
    return make_solution(solution_, nb::cast(outcome(solve())), problem);
  }

  // What the last tick found, if there was one.
  std::optional<Outcome> last() {
    const BusyGuard guard(busy_);
    if (!ticked()) return std::nullopt;
    return outcome(result());
  }

  void reset() {
    const BusyGuard guard(busy_);
    Servo::reset();
  }

  nb::object numbers_of_last_tick() const { return own_array(*snapshot()); }

 private:
  // The interpreter's lock may be released while the core works: a second thread could get here.
  class BusyGuard {
   public:
    explicit BusyGuard(bool& busy) : busy_(busy) {
      if (busy) throw std::runtime_error("this Servo is at work in another thread");
      busy = true;
    }
    ~BusyGuard() { busy_ = false; }
    BusyGuard(const BusyGuard&) = delete;

   private:
    bool& busy_;
  };

  // The field of a name; keywords are interned, so that pointers tell.
  const Field* find(PyObject* name) const {
    for (std::size_t i = 0; i < fields_.size(); ++i)
      if (names_[i].ptr() == name) return &fields_[i];
    return nullptr;
  }

  // Not by nanobind's arrays, which take 13 µs for one that is read-only.
  void write(nb::handle numbers) {
    std::copy_n(doubles(numbers, packed_size()), packed_size(), packed());
  }

  // Stages an array for its field; false unless it is a C-contiguous array of finite float64
  // numbers in the field's exact shape, or a float for a field of one number. By NumPy's own
  // interface: the general ones take longer than the Newton step.
  bool stage_array(PyObject* object, const Field& field) {
    if (field.axes == 0 && PyFloat_CheckExact(object)) {
      const double number = PyFloat_AS_DOUBLE(object);
      stage(&number, field.offset, 1);
      return true;
    }
    if (!PyArray_CheckExact(object)) return false;
    auto* array = reinterpret_cast<PyArrayObject*>(object);
    if (PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISCARRAY_RO(array) ||
        !matches(PyArray_NDIM(array), PyArray_DIMS(array), field))
      return false;
    stage(static_cast<const double*>(PyArray_DATA(array)), field.offset, field.size());
    return true;
  }

  static bool matches(int axes, const npy_intp* shape, const Field& field) {
    return axes == field.axes && field.size() > 0 && (axes < 1 || shape[0] == field.rows) &&
           (axes < 2 || shape[1] == field.columns);
  }

  const Result& solve() {
    const Release release(layout());
    return solve_staged();
  }

  Outcome outcome(const Result& result) const { return Outcome(engine(), result, snapshot()); }

  nb::object shape_;
  std::vector<nb::object> statuses_;
  nb::object refuse_, solution_;
  std::vector<Field> fields_;
  std::vector<nb::object> names_;  // interned
  std::array<const Field*, kFields> changed_;
  bool busy_ = false;
};

// PythonServo::step for the interpreter: nanobind's dispatch takes a good part of a tick.
inline PyObject* servo_step(PyObject* self, PyObject* changes) noexcept {
  if (!PyDict_Check(changes)) {
    PyErr_SetString(PyExc_TypeError, "step() takes a dict of the fields that changed");
    return nullptr;
  }
  try {
    return nb::inst_ptr<PythonServo>(self)->step(changes).release().ptr();
  } catch (nb::python_error& error) {
    error.restore();
  } catch (const std::exception& error) {
    PyErr_SetString(PyExc_RuntimeError, error.what());
  }
  return nullptr;
}

inline PyMethodDef servo_methods[] = {{"step", servo_step, METH_O, nullptr},
                                      {nullptr, nullptr, 0, nullptr}};
inline PyType_Slot servo_slots[] = {{Py_tp_methods, servo_methods}, {0, nullptr}};

}  // namespace graspforce
