// The compiled module graspforce._core: translation between Python and the core, nothing else.
// It is built once for each instruction set, under the name GRASPFORCE_MODULE.
#define NPY_NO_DEPRECATED_API NPY_2_0_API_VERSION
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>
#include <numpy/arrayobject.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "graspforce/engine.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace graspforce {
namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using NumpyVector = nb::ndarray<nb::numpy, const double, nb::ndim<1>>;

Layout make_layout(int wrench_rows, const std::vector<int>& dims, int joints, int inequalities,
                   bool ceilings, bool floors) {
  Layout layout;
  layout.wrench_rows = wrench_rows;
  for (int dim : dims) layout.models.push_back(static_cast<Model>(dim));
  layout.joints = joints;
  layout.inequalities = inequalities;
  layout.ceilings = ceilings;
  layout.floors = floors;
  return layout;
}

std::size_t packed_size(const Layout& layout) { return Offsets(layout).size; }

// Releases the interpreter's lock, unless the problem is so small that the core is done before
// another thread could take the lock; to hand it over and back costs a quarter of a small tick.
class Release {
 public:
  explicit Release(const Layout& layout) {
    if (layout.components() > kSmall) release_.emplace();
  }

 private:
  static constexpr int kSmall = 32;
  std::optional<nb::gil_scoped_release> release_;
};

// The numbers of one solve, copied out of the engine: forces, multipliers, certificate, and for a
// tick a snapshot of its problem. One allocation.
struct Outcome {
  Result result;
  std::size_t m, k, limits, packed;
  std::unique_ptr<double[]> data;

  Outcome(const Engine& engine, const Result& r, const double* snapshot, std::size_t size)
      : result(r),
        m(engine.layout().components()),
        k(engine.layout().wrench_rows),
        limits(r.status == Status::Infeasible ? engine.limits() : 0),
        packed(size) {
    const bool proof = limits > 0;
    data.reset(new double[m + k + (proof ? k + limits : 0) + packed]);
    double* next = data.get();
    next = std::copy_n(engine.forces(), m, next);
    next = std::copy_n(engine.multipliers(), k, next);
    if (proof) {
      next = std::copy_n(engine.certificate_y(), k, next);
      next = std::copy_n(engine.certificate_z(), limits, next);
    }
    if (snapshot != nullptr) std::copy_n(snapshot, packed, next);
  }

  const double* c() const { return data.get(); }
  const double* nu() const { return c() + m; }
  const double* y() const { return nu() + k; }
  const double* z() const { return y() + k; }
  const double* snapshot() const { return nu() + k + (limits > 0 ? k + limits : 0); }
};

// A read-only array that keeps its outcome alive.
NumpyVector view(nb::handle owner, const double* data, std::size_t size) {
  return NumpyVector(data, {size}, owner);
}

// An array that owns its numbers.
nb::object own_array(std::vector<double> numbers) {
  auto* own = new std::vector<double>(std::move(numbers));
  nb::capsule owner(own, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
  return nb::cast(NumpyVector(own->data(), {own->size()}, owner));
}

// Getter of one of an outcome's arrays, and of one that is there only with a certificate.
auto field(const double* (Outcome::*data)() const, std::size_t Outcome::* size) {
  return [data, size](nb::handle_t<Outcome> self) {
    const Outcome& outcome = nb::cast<const Outcome&>(self);
    return view(self, (outcome.*data)(), outcome.*size);
  };
}
auto proof(const double* (Outcome::*data)() const, std::size_t Outcome::* size) {
  return [data, size](nb::handle_t<Outcome> self) -> std::optional<NumpyVector> {
    const Outcome& outcome = nb::cast<const Outcome&>(self);
    if (outcome.limits == 0) return std::nullopt;
    return view(self, (outcome.*data)(), outcome.*size);
  };
}

// A graspforce.Solution of an outcome and its problem (or layout), without the call of its
// __init__: that takes longer than a Newton step.
nb::object make_solution(nb::handle solution, const nb::object& outcome, nb::handle problem) {
  static PyObject* const outcome_name = PyUnicode_InternFromString("_outcome");
  static PyObject* const problem_name = PyUnicode_InternFromString("_problem");
  auto* type = reinterpret_cast<PyTypeObject*>(solution.ptr());
  nb::object made = nb::steal(type->tp_alloc(type, 0));
  if (!made.is_valid() || PyObject_GenericSetAttr(made.ptr(), outcome_name, outcome.ptr()) != 0 ||
      PyObject_GenericSetAttr(made.ptr(), problem_name, problem.ptr()) != 0)
    nb::raise_python_error();
  return made;
}

// The numbers of a plain float64 array of one axis.
const double* doubles(nb::handle object, std::size_t size) {
  auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
  if (!PyArray_Check(object.ptr()) || PyArray_TYPE(array) != NPY_DOUBLE ||
      !PyArray_ISCARRAY_RO(array) || PyArray_SIZE(array) != npy_intp(size))
    throw nb::value_error("expected a float64 array of the problem's size");
  return static_cast<const double*>(PyArray_DATA(array));
}

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
        now_(numbers_),
        next_(numbers_) {
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
      if (given[field] != Py_None) slots_[field].copy(next_, numbers_);
    return make_solution(solution_, nb::cast(outcome(solve())), shape_);
  }

  Outcome step_problem(Vector packed) {
    if (packed.size() != numbers_.size()) throw nb::value_error("packed: wrong size");
    const Turn turn(busy_);
    std::copy_n(packed.data(), packed.size(), next_.begin());
    numbers_ = next_;
    compare();
    return outcome(solve());
  }

  // What the last tick found, if there was one.
  std::optional<Outcome> last() const {
    if (!ticked_) return std::nullopt;
    return outcome(result_);
  }

  void reset() {
    const Turn turn(busy_);
    engine_.reset();
  }

  std::vector<double>& numbers() { return numbers_; }
  const Engine& engine() const { return engine_; }
  nb::object packed() const { return own_array(now_); }

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
  bool collect() { return copy_finite(numbers_.data(), next_.data(), numbers_.size()); }

  static bool copy_finite(const double* from, double* to, std::size_t count) {
    // In whole numbers, which may be compared in any order: a chain of sums would be the slowest
    // part of a tick. All bits of the exponent set means infinite or not a number.
    constexpr std::uint64_t kExponent = std::uint64_t{0x7ff} << 52;
    std::uint64_t infected = 0;
    for (std::size_t i = 0; i < count; ++i) {
      std::uint64_t bits;
      std::memcpy(&bits, from + i, sizeof bits);
      std::memcpy(to + i, &bits, sizeof bits);
      infected |= (bits & kExponent) == kExponent;
    }
    return infected == 0;
  }

  // Copies an array into its field of the next problem; false unless it is a C-contiguous array of
  // finite float64 numbers in the field's exact shape. By NumPy's own interface: the general ones
  // take longer than the Newton step.
  bool stage(PyObject* object, const Slot& slot) {
    if (!PyArray_CheckExact(object)) return false;
    auto* array = reinterpret_cast<PyArrayObject*>(object);
    return PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY_RO(array) &&
           matches(PyArray_NDIM(array), PyArray_DIMS(array), slot) &&
           copy_finite(static_cast<const double*>(PyArray_DATA(array)), next_.data() + slot.offset,
                       slot.size());
  }

  static bool matches(int axes, const npy_intp* shape, const Slot& slot) {
    if (slot.rows == 0 || axes != (slot.columns > 0 ? 2 : 1)) return false;
    return shape[0] == slot.rows && (axes == 1 || shape[1] == slot.columns);
  }

  bool differ(std::size_t begin, std::size_t end) const {
    return std::memcmp(now_.data() + begin, next_.data() + begin, (end - begin) * sizeof(double));
  }

  // Finds what differs from the last tick.
  void compare() {
    changed_ = (differ(0, at_.f) ? kChangedMap : 0u) |
               (differ(at_.J, at_.tau_lo) ? kChangedJacobian : 0u) |
               (differ(at_.tau_lo, at_.size) ? kChangedRest : 0u);
  }

  // The value checks of ForceProblem that what differs could fail.
  bool plausible() const {
    if (!(changed_ & kChangedRest)) return true;
    const Layout& layout = engine_.layout();
    const Problem p(at_, next_.data());
    bool fine = *p.alpha > 0;
    for (int j = 0; j < layout.joints; ++j) fine &= p.tau_lo[j] < p.tau_hi[j];
    for (int i = 0; i < layout.contacts(); ++i) {
      fine &= p.engagement[i] >= 0 && p.engagement[i] <= 1;
      fine &= layout.ceilings || p.engagement[i] == 1;
      if (layout.ceilings) fine &= p.c_max[i] > 0;
      if (layout.floors) fine &= p.c_min[i] >= 0;
      if (layout.ceilings && layout.floors) fine &= p.c_min[i] < p.c_max[i];
    }
    return fine;
  }

  // Solves the next problem, which is fine.
  const Result& solve() {
    now_.swap(next_);
    ticked_ = true;
    const Release release(engine_.layout());
    return result_ = engine_.tick(now_.data(), settings_, changed_);
  }

  Outcome outcome(const Result& result) const {
    return Outcome(engine_, result, now_.data(), now_.size());
  }

  Engine engine_;
  Offsets at_;
  Settings settings_;
  std::vector<nb::object> statuses_;
  nb::object refuse_, solution_, shape_;
  std::vector<double> numbers_;     // as Python sees and writes them
  std::vector<double> now_, next_;  // of the last tick, and of the one that is being made
  std::array<Slot, kAlpha> slots_;
  unsigned changed_ = kChangedAll;
  Result result_;
  bool ticked_ = false, busy_ = false;
};

// Servo.step for the interpreter, called with an array of its arguments: nanobind's dispatch of
// twelve of them takes as long as the tick itself.
PyObject* servo_step(PyObject* self, PyObject* const* arguments, Py_ssize_t count) noexcept {
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

PyMethodDef servo_methods[] = {
    {"step", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(servo_step)), METH_FASTCALL,
     nullptr},
    {nullptr, nullptr, 0, nullptr}};
PyType_Slot servo_slots[] = {{Py_tp_methods, servo_methods}, {0, nullptr}};

// The engines that a thread keeps for its cold solves, the last used first: set-up allocates.
class KeptEngines {
 public:
  // `layout` is a graspforce.problem.Layout.
  Engine& find(nb::handle layout) {
    auto found = std::find_if(engines_.begin(), engines_.end(),
                              [&](auto& engine) { return describes(layout, engine->layout()); });
    if (found == engines_.end()) {
      if (engines_.size() == kMost) engines_.pop_back();
      const auto [wrench_rows, dims, joints, inequalities, ceilings, floors] =
          nb::cast<std::tuple<int, std::vector<int>, int, int, bool, bool>>(layout);
      engines_.push_back(std::make_unique<Engine>(
          make_layout(wrench_rows, dims, joints, inequalities, ceilings, floors)));
      found = engines_.end() - 1;
    }
    std::rotate(engines_.begin(), found, found + 1);
    return *engines_.front();
  }

 private:
  static constexpr std::size_t kMost = 16;

  static bool describes(nb::handle tuple, const Layout& layout) {
    const auto number = [](PyObject* items, int i) {
      return PyLong_AsLong(PyTuple_GET_ITEM(items, i));
    };
    PyObject *items = tuple.ptr(), *dims = PyTuple_GET_ITEM(items, 1);
    if (number(items, 0) != layout.wrench_rows || PyTuple_GET_SIZE(dims) != layout.contacts() ||
        number(items, 2) != layout.joints || number(items, 3) != layout.inequalities ||
        number(items, 4) != layout.ceilings || number(items, 5) != layout.floors)
      return false;
    for (int i = 0; i < layout.contacts(); ++i)
      if (number(dims, i) != static_cast<int>(layout.models[i])) return false;
    return true;
  }

  std::vector<std::unique_ptr<Engine>> engines_;
};

// Solves a graspforce.ForceProblem, given with its layout and its buffer, from nothing or from
// `start` (None, or m float64 forces); `solution` is graspforce.Solution, what comes back one of
// its objects.
nb::object solve(nb::handle solution, nb::handle problem, nb::handle layout, nb::handle packed,
                 nb::handle start, double tol, int max_steps, double budget_us) {
  thread_local KeptEngines engines;
  Engine& engine = engines.find(layout);
  const double* numbers = doubles(packed, packed_size(engine.layout()));
  const double* forces = start.is_none() ? nullptr : doubles(start, engine.layout().components());
  Result result;
  {
    const Release release(engine.layout());
    result = engine.solve(numbers, {tol, max_steps, budget_us}, forces);
  }
  return make_solution(solution, nb::cast(Outcome(engine, result, nullptr, 0)), problem);
}

// Time of every tick over a stream of problems that differ in W, f and J (T rows, `rounds` times;
// the first round warms up and is left out), or with `cold` of every solve of it, as a C++
// controller would see it [ns]. The clock's own time is taken off.
using Stream = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
nb::object time_ticks(int wrench_rows, const std::vector<int>& dims, int joints, int inequalities,
                      bool ceilings, bool floors, Stream packed, int rounds, double tol,
                      int max_steps, bool cold) {
  using Clock = std::chrono::steady_clock;
  const auto nanoseconds = [](Clock::duration time) {
    return std::chrono::duration<double, std::nano>(time).count();
  };
  Engine engine(make_layout(wrench_rows, dims, joints, inequalities, ceilings, floors));
  if (packed.shape(1) != packed_size(engine.layout())) throw nb::value_error("packed: wrong size");
  std::vector<double> empty(1001), times;
  times.reserve(packed.shape(0) * std::size_t(rounds));
  for (double& time : empty) {
    const Clock::time_point start = Clock::now();
    time = nanoseconds(Clock::now() - start);
  }
  std::nth_element(empty.begin(), empty.begin() + 500, empty.end());
  const Settings settings{tol, max_steps};
  for (int round = 0; round <= rounds; ++round) {
    for (std::size_t tick = 0; tick < packed.shape(0); ++tick) {
      const double* problem = packed.data() + tick * packed.shape(1);
      const unsigned changed = round == 0 ? kChangedAll : kChangedMap | kChangedJacobian;
      const Clock::time_point start = Clock::now();
      if (cold)
        engine.solve(problem, settings);
      else
        engine.tick(problem, settings, changed);
      const Clock::time_point end = Clock::now();
      if (round > 0) times.push_back(nanoseconds(end - start) - empty[500]);
    }
  }
  return own_array(std::move(times));
}

}  // namespace
}  // namespace graspforce

NB_MODULE(GRASPFORCE_MODULE, module) {
  if (PyArray_ImportNumPyAPI() < 0) nb::raise_python_error();
  using graspforce::field;
  using graspforce::Outcome;
  using graspforce::proof;
  using graspforce::Servo;
  module.doc() = "The compiled core of graspforce; see graspforce._engine.";

  module.def(
      "has_avx2",
      [] {
#if defined(__x86_64__)
        return bool(__builtin_cpu_supports("avx2")) && bool(__builtin_cpu_supports("fma"));
#else
        return false;
#endif
      },
      "Whether this processor runs the module built for AVX2 and FMA.");

  module.def("solve", &graspforce::solve, "solution"_a, "problem"_a, "layout"_a, "packed"_a,
             "start"_a.none(), "tol"_a, "max_steps"_a, "budget_us"_a,
             "Solves a ForceProblem; what comes back is a `solution`.");

  module.def("time_ticks", &graspforce::time_ticks, "wrench_rows"_a, "dims"_a, "joints"_a,
             "inequalities"_a, "ceilings"_a, "floors"_a, "packed"_a, "rounds"_a, "tol"_a,
             "max_steps"_a, "cold"_a,
             "Times of warm ticks, or of cold solves, without Python in between [ns].");

  nb::class_<Outcome>(module, "Outcome", nb::pooled())
      .def_prop_ro("status", [](const Outcome& o) { return static_cast<int>(o.result.status); })
      .def_prop_ro("newton_steps", [](const Outcome& o) { return o.result.newton_steps; })
      .def_prop_ro("decrement", [](const Outcome& o) { return o.result.decrement; })
      .def_prop_ro("violation", [](const Outcome& o) { return o.result.violation; })
      .def_prop_ro("start", [](const Outcome& o) { return static_cast<int>(o.result.start); })
      .def_prop_ro("elapsed_us", [](const Outcome& o) { return o.result.elapsed_us; })
      .def_prop_ro("c", field(&Outcome::c, &Outcome::m))
      .def_prop_ro("nu", field(&Outcome::nu, &Outcome::k))
      .def_prop_ro("y", proof(&Outcome::y, &Outcome::k))
      .def_prop_ro("z", proof(&Outcome::z, &Outcome::limits))
      .def_prop_ro("packed", field(&Outcome::snapshot, &Outcome::packed));

  using Numbers = nb::ndarray<nb::numpy, double, nb::ndim<1>>;
  nb::class_<Servo>(module, "Servo", nb::type_slots(graspforce::servo_slots))
      .def(nb::init<int, std::vector<int>, int, int, bool, bool, graspforce::Vector, double, int,
                    double, std::vector<nb::object>, nb::object, nb::object, nb::object>(),
           "wrench_rows"_a, "dims"_a, "joints"_a, "inequalities"_a, "ceilings"_a, "floors"_a,
           "packed"_a, "tol"_a, "max_steps"_a, "budget_us"_a, "statuses"_a, "refuse"_a,
           "solution"_a, "shape"_a)
      .def("tick", &Servo::tick)
      .def("step_problem", &Servo::step_problem, "packed"_a)
      .def("last", &Servo::last)
      .def("reset", &Servo::reset)
      .def_prop_ro("packed", &Servo::packed)
      .def_prop_ro("numbers",
                   [](nb::handle_t<Servo> self) {
                     std::vector<double>& numbers = nb::cast<Servo&>(self).numbers();
                     return Numbers(numbers.data(), {numbers.size()}, self);
                   })
      .def_prop_ro("c",
                   [](nb::handle_t<Servo> self) {
                     const graspforce::Engine& engine = nb::cast<Servo&>(self).engine();
                     return graspforce::view(self, engine.forces(), engine.layout().components());
                   })
      .def_prop_ro("nu", [](nb::handle_t<Servo> self) {
        const graspforce::Engine& engine = nb::cast<Servo&>(self).engine();
        return graspforce::view(self, engine.multipliers(), engine.layout().wrench_rows);
      });
}
