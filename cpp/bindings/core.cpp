// The compiled module graspforce._core: translation between Python and the core, nothing else.
// It is built once for each instruction set, under the name GRASPFORCE_MODULE.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <cmath>
#include <memory>
#include <optional>
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

// Keyword fields of a tick, in the order of Servo.step.
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
  Servo(int wrench_rows, const std::vector<int>& dims, int joints, int inequalities, bool ceilings,
        bool floors, Vector packed, double tol, int max_steps)
      : engine_(make_layout(wrench_rows, dims, joints, inequalities, ceilings, floors)),
        tol_(tol),
        max_steps_(max_steps),
        now_(packed.data(), packed.data() + packed.size()),
        next_(now_) {
    const Layout& layout = engine_.layout();
    const Offsets at(layout);
    const int n = layout.contacts(), m = layout.components(), k = wrench_rows;
    auto place = [&](Field field, std::size_t offset, int rows, int columns) {
      slots_[field] = {offset, rows, columns};
    };
    place(kF, at.f, k, 0);
    place(kW, 0, k, m);
    place(kJ, at.J, m, joints);
    place(kTauLo, at.tau_lo, joints, 0);
    place(kTauHi, at.tau_hi, joints, 0);
    place(kTauBias, at.tau_bias, joints, 0);
    place(kCMax, at.c_max, ceilings ? n : 0, 0);
    place(kCMin, at.c_min, floors ? n : 0, 0);
    place(kEngagement, at.engagement, n, 0);
    place(kA, at.A, inequalities, m);
    place(kB, at.b, inequalities, 0);
  }

  // Takes changed fields that are plainly fine and solves; None, with nothing changed, when any
  // is not a float64 array of the field's shape or might not be valid: Python looks closer.
  std::optional<Outcome> step(nb::object f, nb::object W, nb::object J, nb::object tau_lo,
                              nb::object tau_hi, nb::object tau_bias, nb::object c_max,
                              nb::object c_min, nb::object engagement, nb::object A, nb::object b,
                              nb::object alpha) {
    const nb::object* given[kFields] = {&f,     &W,     &J,          &tau_lo, &tau_hi, &tau_bias,
                                        &c_max, &c_min, &engagement, &A,      &b,      &alpha};
    bool fine = alpha.is_none();
    unsigned changed = 0;
    for (int field = 0; field < kAlpha && fine; ++field) {
      if (given[field]->is_none()) continue;
      fine = stage(*given[field], slots_[field]);
      changed |= field == kF   ? 0u
                 : field == kW ? kChangedMap
                 : field == kJ ? kChangedJacobian
                               : kChangedRest;
    }
    if (!fine || (changed & kChangedRest && !plausible())) {
      std::copy(now_.begin(), now_.end(), next_.begin());
      return std::nullopt;
    }
    return solve(changed);
  }

  Outcome step_problem(Vector packed) {
    if (packed.size() != now_.size()) throw nb::value_error("packed: wrong size");
    std::copy_n(packed.data(), packed.size(), next_.begin());
    return solve(kChangedAll);
  }

  void reset() { engine_.reset(); }

  NumpyVector packed() const {
    auto* copy = new std::vector<double>(now_);
    nb::capsule owner(copy, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
    return NumpyVector(copy->data(), {copy->size()}, owner);
  }

 private:
  struct Slot {
    std::size_t offset = 0;
    int rows = 0, columns = 0;  // columns 0: a vector
  };

  // Copies an array into its field of the next problem; false unless it is a C-contiguous array of
  // finite float64 numbers in the field's exact shape. By the buffer protocol: it takes a quarter
  // of the time that a conversion to an nb::ndarray does.
  bool stage(const nb::object& object, const Slot& slot) {
    Py_buffer array;
    if (PyObject_GetBuffer(object.ptr(), &array, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
      PyErr_Clear();
      return false;
    }
    const bool fits = matches(array, slot);
    double infected = 0;  // 0·x is 0 for every finite x, and NaN otherwise
    if (fits) {
      const std::size_t count = array.len / sizeof(double);
      const double* source = static_cast<const double*>(array.buf);
      double* target = next_.data() + slot.offset;
      for (std::size_t i = 0; i < count; ++i) {
        target[i] = source[i];
        infected += 0 * source[i];
      }
    }
    PyBuffer_Release(&array);
    return fits && infected == 0;
  }

  static bool matches(const Py_buffer& array, const Slot& slot) {
    if (array.format == nullptr || array.format[0] != 'd' || array.format[1] != 0) return false;
    const int axes = slot.columns > 0 ? 2 : 1;
    if (slot.rows == 0 || array.ndim != axes || array.shape[0] != slot.rows) return false;
    return axes == 1 || array.shape[1] == slot.columns;
  }

  // The value checks of ForceProblem that a changed number could fail.
  bool plausible() const {
    const Layout& layout = engine_.layout();
    const Problem p(layout, next_.data());
    bool fine = true;
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

  Outcome solve(unsigned changed) {
    now_.swap(next_);
    Result result;
    {
      nb::gil_scoped_release release;
      result = engine_.tick(now_.data(), tol_, max_steps_, changed);
      std::copy(now_.begin(), now_.end(), next_.begin());
    }
    return Outcome(engine_, result, now_.data(), now_.size());
  }

  Engine engine_;
  double tol_;
  int max_steps_;
  std::vector<double> now_, next_;
  std::array<Slot, kAlpha> slots_;
};

class Solver {
 public:
  Solver(int wrench_rows, const std::vector<int>& dims, int joints, int inequalities, bool ceilings,
         bool floors)
      : engine_(make_layout(wrench_rows, dims, joints, inequalities, ceilings, floors)) {}

  Outcome solve(Vector packed, double tol, int max_steps, std::optional<Vector> start) {
    if (packed.size() != packed_size(engine_.layout())) throw nb::value_error("packed: wrong size");
    if (start && int(start->size()) != engine_.layout().components())
      throw nb::value_error("start: wrong size");
    Result result;
    {
      nb::gil_scoped_release release;
      result = engine_.solve(packed.data(), tol, max_steps, start ? start->data() : nullptr);
    }
    return Outcome(engine_, result, nullptr, 0);
  }

 private:
  Engine engine_;
};

}  // namespace
}  // namespace graspforce

NB_MODULE(GRASPFORCE_MODULE, module) {
  using graspforce::field;
  using graspforce::Outcome;
  using graspforce::proof;
  using graspforce::Servo;
  using graspforce::Solver;
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

  nb::class_<Outcome>(module, "Outcome")
      .def_prop_ro("status", [](const Outcome& o) { return static_cast<int>(o.result.status); })
      .def_prop_ro("newton_steps", [](const Outcome& o) { return o.result.newton_steps; })
      .def_prop_ro("decrement", [](const Outcome& o) { return o.result.decrement; })
      .def_prop_ro("violation", [](const Outcome& o) { return o.result.violation; })
      .def_prop_ro("c", field(&Outcome::c, &Outcome::m))
      .def_prop_ro("nu", field(&Outcome::nu, &Outcome::k))
      .def_prop_ro("y", proof(&Outcome::y, &Outcome::k))
      .def_prop_ro("z", proof(&Outcome::z, &Outcome::limits))
      .def_prop_ro("packed", field(&Outcome::snapshot, &Outcome::packed));

  nb::class_<Solver>(module, "Solver")
      .def(nb::init<int, std::vector<int>, int, int, bool, bool>(), "wrench_rows"_a, "dims"_a,
           "joints"_a, "inequalities"_a, "ceilings"_a, "floors"_a)
      .def("solve", &Solver::solve, "packed"_a, "tol"_a, "max_steps"_a, "start"_a.none());

  nb::class_<Servo>(module, "Servo")
      .def(nb::init<int, std::vector<int>, int, int, bool, bool, graspforce::Vector, double, int>(),
           "wrench_rows"_a, "dims"_a, "joints"_a, "inequalities"_a, "ceilings"_a, "floors"_a,
           "packed"_a, "tol"_a, "max_steps"_a)
      .def("step", &Servo::step, "f"_a.none(), "W"_a.none(), "J"_a.none(), "tau_lo"_a.none(),
           "tau_hi"_a.none(), "tau_bias"_a.none(), "c_max"_a.none(), "c_min"_a.none(),
           "engagement"_a.none(), "A"_a.none(), "b"_a.none(), "alpha"_a.none())
      .def("step_problem", &Servo::step_problem, "packed"_a)
      .def("reset", &Servo::reset)
      .def_prop_ro("packed", &Servo::packed, nb::rv_policy::automatic);
}
