// A problem's numbers by name, in one flat buffer that the engine reads.
#pragma once

#include <algorithm>
#include <cassert>
#include <vector>

#include "graspforce/layout.hpp"
#include "graspforce/span.hpp"

namespace graspforce {

// Owns the numbers; the fields are views of them and are written in place. They mean what the
// arguments of graspforce.ForceProblem mean in Python. A new one has engagement, mu and gamma 1,
// alpha 5 and zeros elsewhere. Fields that the layout does not have are empty.
class ProblemData {
  std::vector<double> numbers_;

 public:
  Matrix W;                               // k × m
  Span<double> f;                         // k
  Matrix J;                               // m × joints
  Span<double> tau_lo, tau_hi, tau_bias;  // joints
  Span<double> c_max, c_min;              // contacts
  Span<double> engagement;                // contacts
  Matrix A;                               // inequalities × m
  Span<double> b;                         // inequalities
  Span<double> mu, gamma;                 // contacts
  double& alpha;

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
  ProblemData(const Layout& layout, const Offsets& at)
      : numbers_(at.size, 0.0),
        W(packed(), layout.wrench_rows, layout.components()),
        f(packed() + at.f, layout.wrench_rows),
        J(packed() + at.J, layout.components(), layout.joints),
        tau_lo(packed() + at.tau_lo, layout.joints),
        tau_hi(packed() + at.tau_hi, layout.joints),
        tau_bias(packed() + at.tau_bias, layout.joints),
        c_max(packed() + at.c_max, layout.ceilings ? layout.contacts() : 0),
        c_min(packed() + at.c_min, layout.floors ? layout.contacts() : 0),
        engagement(packed() + at.engagement, layout.contacts()),
        A(packed() + at.A, layout.inequalities, layout.components()),
        b(packed() + at.b, layout.inequalities),
        mu(packed() + at.mu, layout.contacts()),
        gamma(packed() + at.gamma, layout.contacts()),
        alpha(packed()[at.alpha]) {
    std::fill(engagement.begin(), engagement.end(), 1.0);
    std::fill(mu.begin(), mu.end(), 1.0);
    std::fill(gamma.begin(), gamma.end(), 1.0);
    alpha = 5;
  }
};

}  // namespace graspforce
