// Numbers side by side in a struct, with those operations of GCC's and Clang's vector extension
// that the kernels use, for compilers without it. See lanes.hpp.
#pragma once

#include <cstddef>
#include <cstdint>

namespace graspforce {

template <class T, int n>
struct alignas(n * sizeof(T)) PlainLanes {
  T lane[n];

  static PlainLanes all(T x) {
    PlainLanes same;
    for (T& own : same.lane) own = x;
    return same;
  }

  T& operator[](std::size_t i) { return lane[i]; }
  const T& operator[](std::size_t i) const { return lane[i]; }

  PlainLanes operator-() const {
    PlainLanes made;
    for (int i = 0; i < n; ++i) made.lane[i] = -lane[i];
    return made;
  }
  PlainLanes operator~() const {
    PlainLanes made;
    for (int i = 0; i < n; ++i) made.lane[i] = ~lane[i];
    return made;
  }

// Lane by lane, of x and y; a number by itself stands for the same in every lane.
#define GRASPFORCE_LANEWISE(Made, op, of_x_and_y)                    \
  friend Made operator op(PlainLanes a, PlainLanes b) {              \
    Made made;                                                       \
    for (int i = 0; i < n; ++i) {                                    \
      const T x = a.lane[i], y = b.lane[i];                          \
      made.lane[i] = of_x_and_y;                                     \
    }                                                                \
    return made;                                                     \
  }                                                                  \
  friend Made operator op(PlainLanes a, T b) { return a op all(b); } \
  friend Made operator op(T a, PlainLanes b) { return all(a) op b; }
#define GRASPFORCE_ARITHMETIC(op)             \
  GRASPFORCE_LANEWISE(PlainLanes, op, x op y) \
  template <class Other>                      \
  PlainLanes& operator op## = (Other b) {     \
    return *this = *this op b;                \
  }
// All bits set where it is true.
#define GRASPFORCE_COMPARISON(op) GRASPFORCE_LANEWISE(PlainMask, op, -std::int64_t(x op y))

  using PlainMask = PlainLanes<std::int64_t, n>;
  GRASPFORCE_ARITHMETIC(+)
  GRASPFORCE_ARITHMETIC(-)
  GRASPFORCE_ARITHMETIC(*)
  GRASPFORCE_ARITHMETIC(/)
  GRASPFORCE_ARITHMETIC(&)
  GRASPFORCE_ARITHMETIC(|)
  GRASPFORCE_COMPARISON(<)
  GRASPFORCE_COMPARISON(>)
  GRASPFORCE_COMPARISON(<=)
  GRASPFORCE_COMPARISON(>=)
  GRASPFORCE_COMPARISON(==)
  GRASPFORCE_COMPARISON(!=)
#undef GRASPFORCE_COMPARISON
#undef GRASPFORCE_ARITHMETIC
#undef GRASPFORCE_LANEWISE
};

}  // namespace graspforce
