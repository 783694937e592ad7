// The native half of graspforce.solve.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "outcome.hpp"

namespace graspforce {

// The engines that a thread keeps for its cold solves, the last used first: set-up allocates.
class EngineCache {
 public:
  // `layout` is a graspforce.problem.Layout.
  Engine& find(nb::handle layout) {
    auto found = std::find_if(engines_.begin(), engines_.end(),
                              [&](auto& engine) { return describes(layout, engine->layout()); });
    if (found == engines_.end()) {
      if (engines_.size() == kMost) engines_.pop_back();
      engines_.push_back(std::make_unique<Engine>(make_layout(layout)));
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
        number(items, 4) != layout.ceilings || number(items, 5) != layout.floors ||
        number(items, 6) != layout.rate_limits || number(items, 7) != layout.soft_wrench)
      return false;
    for (int i = 0; i < layout.contacts(); ++i)
      if (number(dims, i) != static_cast<int>(layout.models[i])) return false;
    return true;
  }

  std::vector<std::unique_ptr<Engine>> engines_;
};

// Solves a graspforce.ForceProblem, given with its layout and its buffer, from nothing or from
// `start` (None, or m float64 forces); `solution` is graspforce.Solution, what comes back one of
// its objects, or None where the start is no plain array of finite numbers: Python looks closer.
inline nb::object solve(nb::handle solution, nb::handle problem, nb::handle layout,
                        nb::handle packed, nb::handle start, double tol, int max_steps,
                        double budget_us) {
  thread_local EngineCache engines;
  Engine& engine = engines.find(layout);
  const double* numbers = doubles(packed, packed_size(engine.layout()));
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
    result = engine.solve(numbers, {tol, max_steps, budget_us}, forces);
  }
  return make_solution(solution, nb::cast(Outcome(engine, result, nullptr)), problem);
}

}  // namespace graspforce
