// The native half of graspforce.solve_batch.
#pragma once

#include <algorithm>
#include <chrono>
#include <memory>
#include <string>
#include <utility>

#include "graspforce/batch.hpp"
#include "graspforce/batch_derivatives.hpp"
#include "interpreter.hpp"

namespace graspforce {

// A field's rows, where they stand: an array of float64 of the field's shape, which all rows share,
// or with a leading axis of `count`, in whose rows the numbers lie side by side.
inline Column column_of(nb::handle object, int axes, std::size_t size, std::ptrdiff_t count,
                        const char* name) {
  const auto refuse = [name] {
    throw nb::value_error((std::string(name) + ": expected float64 rows side by side").c_str());
  };
  if (!PyArray_Check(object.ptr())) refuse();
  auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
  const int dims = PyArray_NDIM(array), leading = dims - axes;
  if (PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISBEHAVED_RO(array) || leading < 0 ||
      leading > 1 || (leading == 1 && PyArray_DIM(array, 0) != count))
    refuse();
  npy_intp numbers = 1;
  for (int axis = dims - 1; axis >= leading; --axis) {
    if (size > 0 && PyArray_DIM(array, axis) > 1 &&
        PyArray_STRIDE(array, axis) != numbers * npy_intp(sizeof(double)))
      refuse();
    numbers *= PyArray_DIM(array, axis);
  }
  const npy_intp step = leading == 1 ? PyArray_STRIDE(array, 0) : 0;
  if (std::size_t(numbers) != size || step % npy_intp(sizeof(double)) != 0) refuse();
  return {static_cast<const double*>(PyArray_DATA(array)),
          std::ptrdiff_t(step / npy_intp(sizeof(double)))};
}

// Asks the interpreter every 20 ms whether the user has pressed Ctrl-C.
class Interruption {
 public:
  bool go_on() {
    const auto now = Clock::now();
    if (now < next_) return !raised_;
    next_ = now + std::chrono::milliseconds(20);
    const nb::gil_scoped_acquire lock;
    raised_ = raised_ || PyErr_CheckSignals() != 0;
    return !raised_;
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point next_ = Clock::now() + std::chrono::milliseconds(20);
  bool raised_ = false;
};

using Numbers = nb::ndarray<double, nb::c_contig, nb::device::cpu>;
using Integers = nb::ndarray<int, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// The rows of a batch, whose fields stand in the order of the layout.
inline BatchRows rows_of(nb::handle tuple, std::ptrdiff_t count, nb::sequence fields) {
  BatchRows rows;
  rows.layout = make_layout(tuple);
  rows.count = count;
  std::vector<Field> order;
  each_field(rows.layout, [&](const Field& field) { order.push_back(field); });
  std::size_t next = 0;
#define GRASPFORCE_COLUMN(name, ...)                                                           \
  rows.fields.name =                                                                           \
      column_of(nb::object(fields[next]), order[next].axes, order[next].size(), count, #name); \
  ++next;
  GRASPFORCE_FIELDS(GRASPFORCE_COLUMN)
#undef GRASPFORCE_COLUMN
  return rows;
}

// An array that owns its numbers.
template <class T, class... Sizes>
nb::object own(std::unique_ptr<T[]> numbers, Sizes... sizes) {
  T* data = numbers.release();
  nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  using NumpyArray = nb::ndarray<nb::numpy, T, nb::ndim<sizeof...(Sizes)>>;
  return nb::cast(NumpyArray(data, {std::size_t(sizes)...}, owner));
}

using Truths = nb::ndarray<bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Answers that stand side by side, a row each.
inline const double* lines_of(nb::handle object, std::size_t size, std::ptrdiff_t count,
                              const char* name) {
  const Column column = column_of(object, 1, size, count, name);
  if (count > 1 && column.step != std::ptrdiff_t(size))
    throw nb::value_error((std::string(name) + ": expected rows side by side").c_str());
  return column.first;
}

// Runs work(poll) without the interpreter's lock; raises what the user's Ctrl-C does.
template <class Work>
void interruptible(Work work) {
  bool finished;
  {
    const nb::gil_scoped_release release;
    Interruption interruption;
    finished = work([&] { return interruption.go_on(); });
  }
  if (!finished) throw nb::python_error();
}

// Solves a batch into the arrays given; returns the infeasible rows and their certificates, each y
// then z.
inline nb::object solve_batch_of(nb::handle tuple, std::ptrdiff_t count, nb::sequence fields,
                                 nb::handle start, Numbers c, Numbers nu, Integers status,
                                 Integers newton_steps, Integers starts, Integers nearest,
                                 Numbers decrement, Numbers violation, double tol, int max_steps,
                                 double budget_us, int threads) {
  BatchRows rows = rows_of(tuple, count, fields);
  rows.settings = {tol, max_steps, budget_us};
  const std::size_t m = rows.layout.components(), k = rows.layout.wrench_rows;
  if (!start.is_none()) rows.start = column_of(start, 1, m, count, "start");
  const std::size_t entries = count;
  if (c.size() != entries * force_count(rows.layout) || nu.size() != entries * k ||
      status.size() != entries || newton_steps.size() != entries || starts.size() != entries ||
      decrement.size() != entries || violation.size() != entries || nearest.size() != entries)
    throw nb::value_error("outputs: expected arrays of one entry, or line, a row");
  std::optional<std::vector<BatchProof>> proofs;
  const BatchAnswers answers{c.data(),      nu.data(),      status.data(),    newton_steps.data(),
                             starts.data(), nearest.data(), decrement.data(), violation.data()};
  interruptible([&](auto poll) {
    proofs = solve_batch(rows, answers, threads, poll);
    return proofs.has_value();
  });
  const std::size_t found = proofs->size(), line = k + limit_count(rows.layout);
  auto of_rows = std::make_unique<std::int64_t[]>(found);
  auto numbers = std::make_unique<double[]>(found * line);
  for (std::size_t i = 0; i < found; ++i) {
    of_rows[i] = (*proofs)[i].row;
    std::copy_n((*proofs)[i].numbers.begin(), line, numbers.get() + i * line);
  }
  return nb::make_tuple(own(std::move(of_rows), found), own(std::move(numbers), found, line));
}

// Solves the KKT systems of a batch at forces c for a right-hand side a row, (B, m + r + k), in
// place; `wanted` tells of which rows, and afterwards which had forces strictly inside every limit.
inline void kkt_solve_batch(nb::handle tuple, std::ptrdiff_t count, nb::sequence fields,
                            nb::handle c, Truths wanted,
                            nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu> x,
                            int threads) {
  const BatchRows rows = rows_of(tuple, count, fields);
  const std::size_t line = force_count(rows.layout) + rows.layout.wrench_rows;
  if (wanted.size() != std::size_t(count) || x.shape(0) != std::size_t(count) || x.shape(1) != line)
    throw nb::value_error("x: expected count x (m + r + k)");
  const BatchOptima optima{lines_of(c, force_count(rows.layout), count, "c"), nullptr,
                           wanted.data()};
  interruptible([&](auto poll) { return solve_batch_kkt(rows, optima, x.data(), threads, poll); });
}

// Pulls the gradients of a number by the answers (c, internal forces, tau, Phi, friction margins,
// torque margins; None where it does not depend on them) back to the fields, into arrays of a row
// each in the order of the layout's fields, None where they are not wanted.
inline void pull_back_batch_of(nb::handle tuple, std::ptrdiff_t count, nb::sequence fields,
                               nb::handle c, nb::handle nu, Truths wanted, nb::sequence gradients,
                               nb::sequence out, int threads) {
  const BatchRows rows = rows_of(tuple, count, fields);
  const Layout& l = rows.layout;
  if (wanted.size() != std::size_t(count)) throw nb::value_error("wanted: expected a value a row");
  const BatchOptima optima{lines_of(c, force_count(l), count, "c"),
                           lines_of(nu, l.wrench_rows, count, "nu"), wanted.data()};
  BatchGradients given;
  const auto gradient = [&](int i, int axes, std::size_t size) {
    const nb::object array = gradients[i];
    return array.is_none() ? Column() : column_of(array, axes, size, count, "gradients");
  };
  given.c = gradient(0, 1, l.components());
  given.internal_forces = gradient(1, 1, l.internals);
  given.tau = gradient(2, 1, l.joints);
  given.phi = gradient(3, 0, 1);
  given.friction_margins = gradient(4, 1, l.contacts());
  given.torque_margins = gradient(5, 1, l.joints);
  std::size_t next = 0;
#define GRASPFORCE_TAKE(name, type, height, width, ...)                                  \
  given.fields.name = nullptr;                                                           \
  if (const nb::object array = out[next++]; !array.is_none()) {                          \
    const auto numbers = nb::cast<Numbers>(array, false);                                \
    if (numbers.size() != std::size_t(count) * std::size_t(height) * std::size_t(width)) \
      throw nb::value_error("out: expected arrays of a row each");                       \
    given.fields.name = numbers.data();                                                  \
  }
  GRASPFORCE_FIELDS(GRASPFORCE_TAKE)
#undef GRASPFORCE_TAKE
  interruptible([&](auto poll) { return pull_back_batch(rows, optima, given, threads, poll); });
}

}  // namespace graspforce
