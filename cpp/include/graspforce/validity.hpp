// What has changed in a stream's numbers, and whether they make a problem at all: what has to be
// known before a tick, since the engine takes what it gets.
#pragma once

#include <cstdint>
#include <cstring>

#include "graspforce/layout.hpp"

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

// What differs between two packed problems, as Engine::tick wants to know it.
inline unsigned find_changes(const Offsets& at, const double* before, const double* now) {
  auto differ = [&](std::size_t begin, std::size_t end) {
    return std::memcmp(before + begin, now + begin, (end - begin) * sizeof(double)) != 0;
  };
  return (differ(0, at.f) ? kChangedMap : 0u) | (differ(at.J, at.tau_lo) ? kChangedJacobian : 0u) |
         (differ(at.tau_lo, at.size) ? kChangedRest : 0u);
}

// The first thing that keeps finite numbers from making a problem, null when there is none: the
// checks of values of ForceProblem. W, f and J may be anything.
inline const char* find_flaw(const Layout& layout, const Problem& p) {
  if (!(*p.alpha > 0)) return "alpha: expected more than 0";
  for (int j = 0; j < layout.joints; ++j)
    if (!(p.tau_lo[j] < p.tau_hi[j])) return "tau_lo: expected less than tau_hi";
  for (int i = 0; i < layout.contacts(); ++i) {
    if (!(p.engagement[i] >= 0 && p.engagement[i] <= 1)) return "engagement: expected 0 to 1";
    if (!layout.ceilings && p.engagement[i] != 1)
      return "engagement: expected 1 without c_max, the ceiling that it scales";
    if (layout.ceilings && !(p.c_max[i] > 0)) return "c_max: expected more than 0";
    if (layout.floors && !(p.c_min[i] >= 0)) return "c_min: expected 0 or more";
    if (layout.ceilings && layout.floors && !(p.c_min[i] < p.c_max[i]))
      return "c_min: expected less than c_max";
    if (!(p.mu[i] > 0)) return "mu: expected more than 0";
    if (!(p.gamma[i] > 0)) return "gamma: expected more than 0";
  }
  return nullptr;
}

}  // namespace graspforce
