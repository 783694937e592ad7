// Times of the core alone, for benchmarks.
#pragma once

#include <algorithm>
#include <chrono>
#include <utility>
#include <vector>

#include "graspforce/engine.hpp"
#include "interpreter.hpp"

namespace graspforce {

// Time of every tick over a stream of problems that differ in W, f and J (T rows, `rounds` times;
// the first round warms up and is left out), or with `cold` of every solve of it, as a C++
// controller would see it [ns]. The clock's own time is taken off.
using Stream = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
inline nb::object time_ticks(nb::handle layout, Stream packed, int rounds, double tol,
                             int max_steps, bool cold) {
  using Clock = std::chrono::steady_clock;
  const auto nanoseconds = [](Clock::duration time) {
    return std::chrono::duration<double, std::nano>(time).count();
  };
  Engine engine(make_layout(layout));
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

}  // namespace graspforce
