// NumPy's arrays as the core takes them: looked at in place, and made.
#pragma once

#include <algorithm>
#include <initializer_list>
#include <tuple>

#include "graspforce/contact.hpp"
#include "interpreter.hpp"

namespace graspforce {

using Shape = std::initializer_list<std::size_t>;

// The numbers of a plain array of that type and shape; null where it is another object.
template <class T>
const T* find_entries(nb::handle object, char kind, Shape shape) {
  auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
  const auto same = [](npy_intp a, std::size_t b) { return std::size_t(a) == b; };
  if (!PyArray_Check(object.ptr()) || PyArray_DESCR(array)->kind != kind ||
      PyArray_ITEMSIZE(array) != sizeof(T) || !PyArray_ISCARRAY_RO(array) ||
      !std::equal(PyArray_DIMS(array), PyArray_DIMS(array) + PyArray_NDIM(array), shape.begin(),
                  shape.end(), same))
    return nullptr;
  return static_cast<const T*>(PyArray_DATA(array));
}
template <class T>
const T* entries(nb::handle object, char kind, Shape shape) {
  const T* const found = find_entries<T>(object, kind, shape);
  if (found == nullptr) throw nb::value_error("expected a plain array of the right type and shape");
  return found;
}
inline const double* reals(nb::handle object, Shape shape) {
  return entries<double>(object, 'f', shape);
}
inline const npy_intp* indices(nb::handle object, std::size_t size) {
  return entries<npy_intp>(object, 'i', {size});
}

// Rows of plain numbers, which may stand apart, as in a list of structs.
class Rows {
 public:
  Rows(nb::handle object, std::size_t columns) {
    auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
    if (!PyArray_Check(object.ptr()) || PyArray_TYPE(array) != NPY_DOUBLE ||
        PyArray_NDIM(array) != 2 || std::size_t(PyArray_DIM(array, 1)) != columns ||
        PyArray_STRIDE(array, 1) != sizeof(double) || !PyArray_ISBEHAVED_RO(array))
      throw nb::value_error("expected rows of numbers");
    first_ = PyArray_BYTES(array);
    apart_ = PyArray_STRIDE(array, 0);
    count_ = PyArray_DIM(array, 0);
  }
  std::size_t count() const { return count_; }
  const double* operator[](std::size_t i) const {
    return reinterpret_cast<const double*>(first_ + apart_ * npy_intp(i));
  }

 private:
  const char* first_;
  npy_intp apart_;
  std::size_t count_;
};

inline Matrix matrix(double* first, std::size_t rows, std::size_t columns) {
  return {first, static_cast<int>(rows), static_cast<int>(columns)};
}
// Read, though a Matrix could be written.
inline Matrix matrix(nb::handle object, std::size_t rows, std::size_t columns) {
  return matrix(const_cast<double*>(reals(object, {rows, columns})), rows, columns);
}
inline std::size_t count(nb::handle object, int axis = 0) {
  auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
  if (!PyArray_Check(object.ptr()) || PyArray_NDIM(array) <= axis)
    throw nb::value_error("expected an array with more axes");
  return PyArray_DIM(array, axis);
}
inline Vector3 vector(const double* first) { return {first[0], first[1], first[2]}; }
inline Matrix3 matrix3(const double* first) {
  return {vector(first), vector(first + 3), vector(first + 6)};
}

using Two = std::tuple<nb::object, nb::object>;

// A new array.
struct Made {
  explicit Made(Shape shape, int type = NPY_DOUBLE)
      : object(nb::steal(PyArray_SimpleNew(
            static_cast<int>(shape.size()),
            reinterpret_cast<npy_intp*>(const_cast<std::size_t*>(shape.begin())), type))) {
    if (!object.is_valid()) nb::raise_python_error();
  }
  void* data() const { return PyArray_DATA(reinterpret_cast<PyArrayObject*>(object.ptr())); }
  double* reals() const { return static_cast<double*>(data()); }

  nb::object object;
};

}  // namespace graspforce
