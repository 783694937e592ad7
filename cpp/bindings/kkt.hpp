// The KKT system of graspforce/factor.hpp for Python: the base of derivatives.
#pragma once

#include <algorithm>
#include <memory>

#include "graspforce/factor.hpp"
#include "interpreter.hpp"

namespace graspforce {

using Columns = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using NumpyMatrix = nb::ndarray<nb::numpy, double, nb::ndim<2>>;

// Solves for all columns of `rhs`, (m + r + k) × n, at forces c strictly inside every limit.
inline NumpyMatrix kkt_solve(nb::handle tuple, nb::handle packed, nb::handle c, Columns rhs) {
  const Layout layout = make_layout(tuple);
  const std::size_t rows = force_count(layout) + layout.wrench_rows, columns = rhs.shape(1);
  const double* numbers = doubles(packed, packed_size(layout));
  const double* forces = doubles(c, force_count(layout));
  if (rhs.shape(0) != rows) throw nb::value_error("rhs: expected m + r + k rows");
  auto solutions = std::make_unique<double[]>(rows * columns);
  std::copy_n(rhs.data(), rows * columns, solutions.get());
  {
    const Release release(layout);
    Factor factor(layout);
    if (!factor.at(numbers, forces))
      throw nb::value_error("c: expected forces strictly inside every cone and limit");
    factor.solve(solutions.get(), static_cast<int>(columns));
  }
  double* data = solutions.get();
  nb::capsule owner(solutions.release(),
                    [](void* p) noexcept { delete[] static_cast<double*>(p); });
  return NumpyMatrix(data, {rows, columns}, owner);
}

}  // namespace graspforce
