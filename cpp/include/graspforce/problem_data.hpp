// A problem's numbers by name, in one flat buffer that the engine reads.
#pragma once

#include <algorithm>
#include <cassert>
#include <vector>

#include "graspforce/layout.hpp"

namespace graspforce {

// Owns the numbers; the fields are views of them and are written in place. They mean what the
// arguments of graspforce.ForceProblem mean in Python. A new one has engagement, mu and gamma 1,
// alpha 5 and zeros elsewhere. Fields that the layout does not have are empty.
class ProblemData {
  std::vector<double> numbers_;

 public:
#define GRASPFORCE_VIEW(name, type, ...) type name;
  GRASPFORCE_FIELDS(GRASPFORCE_VIEW)
#undef GRASPFORCE_VIEW

  explicit ProblemData(const Layout& layout) : ProblemData(layout, Offsets(layout)) {}
  ProblemData(const ProblemData&) = delete;
  // Takes over the numbers of another problem of the same layout.
  ProblemData& operator=(const ProblemData& other) {
    assert(other.numbers_.size() == numbers_.size());
    std::copy(other.numbers_.begin(), other.numbers_.end(), numbers_.begin());
    return *this;
  }

  const double* packed() const { return numbers_.data(); }
  double* packed() { return numbers_.data(); }
  std::size_t packed_size() const { return numbers_.size(); }

 private:
  ProblemData(const Layout& l, const Offsets& at)
      : numbers_(at.size)
#define GRASPFORCE_VIEW(name, type, rows, columns, ...) \
  , name(view(packed() + at.name, rows, columns, static_cast<type*>(nullptr)))
            GRASPFORCE_FIELDS(GRASPFORCE_VIEW)
#undef GRASPFORCE_VIEW
  {
#define GRASPFORCE_FILL(name, type, rows, columns, initial, ...) \
  std::fill_n(packed() + at.name, std::size_t(rows) * std::size_t(columns), initial);
    GRASPFORCE_FIELDS(GRASPFORCE_FILL)
#undef GRASPFORCE_FILL
  }

  static Matrix view(double* first, int rows, int columns, Matrix*) {
    return {first, rows, columns};
  }
  static Span<double> view(double* first, int rows, int, Span<double>*) { return {first, rows}; }
  static Scalar view(double* first, int, int, Scalar*) { return Scalar(first); }
};

}  // namespace graspforce
