// The native half of graspforce.solve.
#pragma once

#include <algorithm>
#include <cmath>

#include "graspforce/workspace.hpp"
#include "outcome.hpp"
#include "solution.hpp"

namespace graspforce {

// Whether a graspforce._engine.layout.Layout, a tuple, describes a layout.
inline bool describes(nb::handle tuple, const Layout& layout) {
  const auto number = [](PyObject* items, int i) {
    return PyLong_AsLong(PyTuple_GET_ITEM(items, i));
  };
  PyObject *items = tuple.ptr(), *dims = PyTuple_GET_ITEM(items, 1);
  if (number(items, 0) != layout.wrench_rows || PyTuple_GET_SIZE(dims) != layout.contacts() ||
      number(items, 2) != layout.joints || number(items, 3) != layout.inequalities ||
      number(items, 4) != layout.ceilings || number(items, 5) != layout.floors ||
      number(items, 6) != layout.rate_limits || number(items, 7) != layout.soft_wrench ||
      number(items, 8) != layout.pulls || number(items, 9) != layout.internals ||
      number(items, 10) != layout.cone_weights)
    return false;
  for (int i = 0; i < layout.contacts(); ++i)
    if (number(dims, i) != static_cast<int>(layout.models[i])) return false;
  return true;
}

// Solves a graspforce.ForceProblem, given with its layout and its buffer, cold or from
// `start` (None, or m float64 forces); `solution` is graspforce.Solution, what comes back one of
// its objects, or None where the start is no plain array of finite numbers: Python then checks and
// converts.
inline nb::object solve(nb::handle solution, nb::handle problem, nb::handle layout,
                        nb::handle packed, nb::handle start, double tol, int max_steps,
                        double budget_us) {
  thread_local Workspace workspace;
  Engine& engine = workspace.engine([&](const Layout& kept) { return describes(layout, kept); },
                                    [&] { return make_layout(layout); });
  const double* numbers = doubles(packed, engine.packed_size());
  const double* forces = nullptr;
  if (!start.is_none()) {
    const std::size_t m = engine.layout().components();
    forces = find_doubles(start, m);
    if (forces == nullptr ||
        !std::all_of(forces, forces + m, [](double c) { return std::isfinite(c); }))
      return nb::none();
  }
  Result result;
  {
    const Release release(engine.layout());
    engine.forget_couplings();
    result = engine.solve(numbers, {tol, max_steps, budget_us}, forces);
  }
  return make_solution(solution, nb::cast(Outcome(engine, result, nullptr)), problem);
}

}  // namespace graspforce
