// The rows of a batch: problems of one layout whose fields stand in arrays of their own, each with
// a step from row to row.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <string_view>

#include "graspforce/budget.hpp"
#include "graspforce/layout.hpp"

namespace graspforce {

// A field's numbers in the first row, and how far the next row's are (0: all rows share them).
struct Column {
  const double* first = nullptr;
  std::ptrdiff_t step = 0;
};

struct BatchRows {
  Layout layout;
  Settings settings;
  Fields<Column> fields;
  Column start;  // forces to start from; null: cold
  std::ptrdiff_t count = 0;

  // The fields of a row, read where they stand.
  Problem problem(std::ptrdiff_t row) const {
    Problem p;
#define GRASPFORCE_POINT(name, ...) p.name = fields.name.first + row * fields.name.step;
    GRASPFORCE_FIELDS(GRASPFORCE_POINT)
#undef GRASPFORCE_POINT
    return p;
  }
  const double* start_of(std::ptrdiff_t row) const {
    return start.first == nullptr ? nullptr : start.first + row * start.step;
  }

  // Copies a row into one buffer, as the engine reads it.
  void pack(std::ptrdiff_t row, double* to) const {
    const Layout& l = layout;
#define GRASPFORCE_COPY(name, type, rows, columns, ...) \
  to = std::copy_n(fields.name.first + row * fields.name.step, std::size_t(rows) * (columns), to);
    GRASPFORCE_FIELDS(GRASPFORCE_COPY)
#undef GRASPFORCE_COPY
  }

  // Whether all rows share the numbers of the first.
  static bool shared(std::initializer_list<Column> columns) {
    return std::all_of(columns.begin(), columns.end(), [](Column c) { return c.step == 0; });
  }
  // Those of all fields but W, f, J and the limits of the joints.
  bool share_coefficients() const {
    bool all = true;
#define GRASPFORCE_SHARED(name, ...) all &= !is_coefficient(#name) || fields.name.step == 0;
    GRASPFORCE_FIELDS(GRASPFORCE_SHARED)
#undef GRASPFORCE_SHARED
    return all;
  }

  // Whether a problem's numbers are in the ranges that find_flaw asks for, with every contact in
  // the grasp, and fields that the lanes know nothing of at their defaults. Of W, f and J a number
  // that is not finite comes through to the first step.
  bool torques_fit(const Problem& p) const {
    bool good = true;
    for (int j = 0; j < layout.joints; ++j)
      good &= (p.tau_lo[j] < p.tau_hi[j]) & (p.tau_lo[j] > -kInfinity) & (p.tau_hi[j] < kInfinity) &
              (std::abs(p.tau_bias[j]) < kInfinity);
    return good;
  }
  bool coefficients_fit(const Problem& p) const {
    bool good = *p.alpha > 0 && *p.alpha < kInfinity;
    for (int i = 0; i < layout.contacts(); ++i) {
      const double share = p.engagement[i];
      good &= (p.mu[i] > 0) & (p.mu[i] < kInfinity) & (p.gamma[i] > 0) & (p.gamma[i] < kInfinity);
      good &= layout.ceilings ? (share > kRemovalThreshold) & (share <= 1) : share == 1;
      if (layout.ceilings) good &= (p.c_max[i] > 0) & (p.c_max[i] < kInfinity);
      if (layout.floors) good &= (p.c_min[i] >= 0) & (p.c_min[i] < kInfinity);
      if (layout.ceilings && layout.floors) good &= p.c_min[i] <= p.c_max[i];
    }
    return good && others_at_default(p);
  }

 private:
  static constexpr bool is_coefficient(std::string_view name) {
    for (std::string_view other : {"W", "f", "J", "tau_lo", "tau_hi", "tau_bias"})
      if (name == other) return false;
    return true;
  }
  static constexpr bool known_to_lanes(std::string_view name) {
    for (std::string_view known : {"W", "f", "J", "tau_lo", "tau_hi", "tau_bias", "c_max", "c_min",
                                   "engagement", "mu", "gamma", "alpha"})
      if (name == known) return true;
    return false;
  }

  bool others_at_default(const Problem& p) const {
    const Layout& l = layout;
    bool all = true;
#define GRASPFORCE_DEFAULT(name, type, rows, columns, initial, ...)                         \
  if constexpr (!known_to_lanes(#name))                                                     \
    for (std::size_t i = 0, size = std::size_t(rows) * std::size_t(columns); i < size; ++i) \
      all &= p.name[i] == initial;
    GRASPFORCE_FIELDS(GRASPFORCE_DEFAULT)
#undef GRASPFORCE_DEFAULT
    return all;
  }
};

}  // namespace graspforce
