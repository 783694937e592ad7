// The shape of a force distribution problem and where its numbers stand in one flat buffer.
//
// The order of the fields is that of graspforce.problem.Layout in Python: whoever holds a packed
// buffer holds a whole problem, and taking a snapshot of it is one copy.
#pragma once

#include <cstddef>
#include <vector>

namespace graspforce {

// A contact model's value is its number of force components.
enum class Model : int { FPC = 1, PCWF = 3, SFC = 4 };

// A contact at or below this engagement is out of the grasp (end of Section III-C.3).
inline constexpr double kRemovalThreshold = 1e-6;

struct Layout {
  int wrench_rows = 6;        // k, rows of W
  std::vector<Model> models;  // n contacts
  int joints = 0;             // columns of J
  int inequalities = 0;       // rows of A
  bool ceilings = false;      // c_max given
  bool floors = false;        // c_min given

  int contacts() const { return static_cast<int>(models.size()); }
  int components() const {
    int m = 0;
    for (Model model : models) m += static_cast<int>(model);
    return m;
  }
};

// Rows of ForceProblem.linear_limits() before any are left out: torques above and below, ceilings,
// floors, inequalities.
inline int limit_count(const Layout& layout) {
  return 2 * layout.joints + layout.inequalities +
         layout.contacts() * (int(layout.ceilings) + int(layout.floors));
}

// Read access to a packed problem: pointers to its fields, row-major.
struct Problem {
  const double *W, *f, *J, *tau_lo, *tau_hi, *tau_bias, *c_max, *c_min, *engagement, *A, *b, *mu,
      *gamma, *alpha;
  std::size_t size;  // doubles in the buffer

  Problem(const Layout& layout, const double* packed) {
    const std::size_t k = layout.wrench_rows, n = layout.contacts(), m = layout.components();
    const std::size_t joints = layout.joints, rows = layout.inequalities;
    const double* next = packed;
    auto field = [&next](std::size_t count) {
      const double* here = next;
      next += count;
      return here;
    };
    W = field(k * m);
    f = field(k);
    J = field(m * joints);
    tau_lo = field(joints);
    tau_hi = field(joints);
    tau_bias = field(joints);
    c_max = field(layout.ceilings ? n : 0);
    c_min = field(layout.floors ? n : 0);
    engagement = field(n);
    A = field(rows * m);
    b = field(rows);
    mu = field(n);
    gamma = field(n);
    alpha = field(1);
    size = static_cast<std::size_t>(next - packed);
  }

  bool in_grasp(int contact) const { return engagement[contact] > kRemovalThreshold; }
};

}  // namespace graspforce
