// What the bindings share: arrays to and from NumPy, layouts, the interpreter's lock.
#pragma once

#define NPY_NO_DEPRECATED_API NPY_2_0_API_VERSION
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>
#include <numpy/arrayobject.h>

#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "graspforce/layout.hpp"

namespace nb = nanobind;

namespace graspforce {

using NumpyVector = nb::ndarray<nb::numpy, const double, nb::ndim<1>>;

// The layout that a graspforce._engine.layout.Layout, a tuple, describes.
inline Layout make_layout(nb::handle tuple) {
  const auto [wrench_rows, dims, joints, inequalities, ceilings, floors, rate_limits, soft_wrench,
              pulls, internals, cone_weights] =
      nb::cast<
          std::tuple<int, std::vector<int>, int, int, bool, bool, bool, bool, bool, int, bool>>(
          tuple);
  Layout layout;
  layout.wrench_rows = wrench_rows;
  for (int dim : dims) layout.models.push_back(static_cast<Model>(dim));
  layout.joints = joints;
  layout.inequalities = inequalities;
  layout.ceilings = ceilings;
  layout.floors = floors;
  layout.rate_limits = rate_limits;
  layout.soft_wrench = soft_wrench;
  layout.pulls = pulls;
  layout.internals = internals;
  layout.cone_weights = cone_weights;
  return layout;
}

inline std::size_t packed_size(const Layout& layout) { return Offsets(layout).size; }

// A read-only array that keeps its outcome alive.
inline NumpyVector view(nb::handle owner, const double* data, std::size_t size) {
  return NumpyVector(data, {size}, owner);
}

// An array that owns its numbers.
inline nb::object own_array(std::vector<double> numbers) {
  auto* own = new std::vector<double>(std::move(numbers));
  nb::capsule owner(own, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
  return nb::cast(NumpyVector(own->data(), {own->size()}, owner));
}

// The numbers of a plain float64 array of one axis and that size; null where it is another object.
inline const double* find_doubles(nb::handle object, std::size_t size) {
  if (!PyArray_CheckExact(object.ptr())) return nullptr;
  auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
  if (PyArray_TYPE(array) != NPY_DOUBLE || !PyArray_ISCARRAY_RO(array) ||
      PyArray_NDIM(array) != 1 || PyArray_SIZE(array) != npy_intp(size))
    return nullptr;
  return static_cast<const double*>(PyArray_DATA(array));
}
inline const double* doubles(nb::handle object, std::size_t size) {
  const double* numbers = find_doubles(object, size);
  if (numbers == nullptr) throw nb::value_error("expected a float64 array of the problem's size");
  return numbers;
}

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

}  // namespace graspforce
