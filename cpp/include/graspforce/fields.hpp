// The single list of a problem's fields: offsets, views, slots, defaults, the values that each may
// have and what a change of it means follow from it.
//
// A new field is a line here, where the buffer's order puts it; what else it takes stands in
// docs/engine.md. The same list in Python is graspforce._engine.layout.FIELDS, in the same order.
#pragma once

#include <cstddef>

#include "graspforce/span.hpp"

namespace graspforce {

// What may have changed since a problem's numbers were last loaded; f always counts as changed.
enum Changed : unsigned {
  kChangedNothing = 0,
  kChangedMap = 1,       // W
  kChangedJacobian = 2,  // J, internal
  kChangedRest = 4,      // anything else
  kChangedAll = 7,
  // With kChangedJacobian: J has no entry outside the blocks of the last tick, as the caller knows.
  // Without it every entry is read to see so.
  kJacobianKept = 8,
};

// What the numbers of a field may be.
enum class Range { Finite, Positive, NotNegative, Share };

// FIELD(name, type, rows, columns, default, range, changed), with the layout `l`. Fields of one
// kind of change stand side by side.
#define GRASPFORCE_FIELDS(FIELD)                                                                  \
  FIELD(W, Matrix, l.wrench_rows, l.components(), 0, Finite, kChangedMap)                         \
  FIELD(f, Span<double>, l.wrench_rows, 1, 0, Finite, kChangedNothing)                            \
  FIELD(J, Matrix, l.components(), l.joints, 0, Finite, kChangedJacobian)                         \
  FIELD(internal, Matrix, l.internals, l.joints, 0, Finite, kChangedJacobian)                     \
  FIELD(tau_lo, Span<double>, l.joints, 1, 0, Finite, kChangedRest)                               \
  FIELD(tau_hi, Span<double>, l.joints, 1, 0, Finite, kChangedRest)                               \
  FIELD(tau_bias, Span<double>, l.joints, 1, 0, Finite, kChangedRest)                             \
  FIELD(c_max, Span<double>, l.ceilings ? l.contacts() : 0, 1, 0, Positive, kChangedRest)         \
  FIELD(c_min, Span<double>, l.floors ? l.contacts() : 0, 1, 0, NotNegative, kChangedRest)        \
  FIELD(engagement, Span<double>, l.contacts(), 1, 1, Share, kChangedRest)                        \
  FIELD(pull, Span<double>, l.pulls ? l.contacts() : 0, 1, 0, NotNegative, kChangedRest)          \
  FIELD(f_soft, Span<double>, l.soft_wrench ? l.wrench_rows : 0, 1, 0, NotNegative, kChangedRest) \
  FIELD(c_last, Span<double>, l.rate_limits ? l.components() : 0, 1, 0, Finite, kChangedRest)     \
  FIELD(dc_max, Span<double>, l.rate_limits ? l.components() : 0, 1, 0, Positive, kChangedRest)   \
  FIELD(A, Matrix, l.inequalities, l.components(), 0, Finite, kChangedRest)                       \
  FIELD(b, Span<double>, l.inequalities, 1, 0, Finite, kChangedRest)                              \
  FIELD(mu, Span<double>, l.contacts(), 1, 1, Positive, kChangedRest)                             \
  FIELD(gamma, Span<double>, l.contacts(), 1, 1, Positive, kChangedRest)                          \
  FIELD(cone_weight, Span<double>, l.cone_weights ? l.contacts() : 0, 1, 1, Positive,             \
        kChangedRest)                                                                             \
  FIELD(alpha, Scalar, 1, 1, 5, Positive, kChangedRest)

// How many indices an entry of a field has.
inline constexpr int axes(Matrix*) { return 2; }
inline constexpr int axes(Span<double>*) { return 1; }
inline constexpr int axes(Scalar*) { return 0; }

#define GRASPFORCE_COUNT(...) +1
inline constexpr int kFields = GRASPFORCE_FIELDS(GRASPFORCE_COUNT);
#undef GRASPFORCE_COUNT

// What is known of a field in a layout.
struct Field {
  const char* name;
  int axes, rows, columns;
  Range range;
  std::size_t offset;  // in the buffer

  std::size_t size() const { return std::size_t(rows) * std::size_t(columns); }
};

// Something of type T for each field, under its name.
template <class T>
struct Fields {
#define GRASPFORCE_MEMBER(name, ...) T name;
  GRASPFORCE_FIELDS(GRASPFORCE_MEMBER)
#undef GRASPFORCE_MEMBER
};

}  // namespace graspforce
