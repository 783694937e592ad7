// What has changed in a stream's numbers, and whether they are valid: both are found
// before a tick, as the engine does not check its input.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "graspforce/layout.hpp"
#include "graspforce/structure.hpp"

namespace graspforce {

// Copies numbers; false unless all of them are finite.
inline bool copy_finite(const double* from, double* to, std::size_t count) {
  // In whole numbers, which may be compared in any order: a chain of sums would be the slowest part
  // of a tick. All bits of the exponent set means infinite or not a number.
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

// What differs between two packed problems, as Engine::tick wants to know it. `sparse` is the
// pattern of J where both are known to keep to a sparse one.
inline unsigned find_changes(const Offsets& at, const double* before, const double* now,
                             const Pattern* sparse = nullptr) {
  // Fields of one kind of change stand side by side: three comparisons are enough.
  auto differ = [&](std::size_t begin, std::size_t end) {
    return std::memcmp(before + begin, now + begin, (end - begin) * sizeof(double)) != 0;
  };
  const bool J_differs = sparse == nullptr ? differ(at.J, at.tau_lo)
                                           : !sparse->same_inside(before + at.J, now + at.J) ||
                                                 differ(at.internal, at.tau_lo);
  return (differ(0, at.f) ? kChangedMap : 0u) | (J_differs ? kChangedJacobian : 0u) |
         (differ(at.tau_lo, at.size) ? kChangedRest : 0u);
}

// What keeps numbers from making a problem.
struct Flaw {
  const char* field = nullptr;  // null: nothing does
  int axes = 0;                 // how many of row and column tell the entry
  int row = 0, column = 0;
  double got = 0;
  const char* expected = nullptr;

  explicit operator bool() const { return field != nullptr; }
};

// The first flaw of a problem's numbers: the one validation of values, for C++ and for Python.
// `finite` tells that all of them are known to be finite; fields that may be anything are then
// passed over.
inline Flaw find_flaw(const Layout& layout, const double* packed, bool finite = false) {
  Flaw flaw;
  each_field(layout, [&](const Field& field) {
    if (flaw || (finite && field.range == Range::Finite)) return;
    for (int row = 0; row < field.rows; ++row)
      for (int column = 0; column < field.columns; ++column) {
        const double x = packed[field.offset + std::size_t(row) * field.columns + column];
        const char* expected = nullptr;
        if (field.range == Range::Positive && !(x > 0)) expected = "more than 0";
        if (field.range == Range::NotNegative && !(x >= 0)) expected = "0 or more";
        if (field.range == Range::Share && !(x >= 0 && x <= 1)) expected = "0 to 1";
        if (!std::isfinite(x)) expected = "finite numbers everywhere";
        if (expected != nullptr && !flaw) flaw = {field.name, field.axes, row, column, x, expected};
      }
  });
  if (flaw) return flaw;
  const Problem p(layout, packed);
  for (int j = 0; j < layout.joints; ++j)
    if (!(p.tau_lo[j] < p.tau_hi[j])) return {"tau_lo", 1, j, 0, p.tau_lo[j], "less than tau_hi"};
  for (int i = 0; i < layout.contacts(); ++i) {
    if (!layout.ceilings && p.engagement[i] != 1)
      return {
          "engagement", 1, i, 0, p.engagement[i], "1 without c_max, the ceiling that it scales"};
    if (layout.ceilings && layout.floors && !(p.c_min[i] <= p.c_max[i]))
      return {"c_min", 1, i, 0, p.c_min[i], "at most c_max"};
  }
  return flaw;
}

}  // namespace graspforce
