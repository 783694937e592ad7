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

// Share of a limit that the pushes of a cold start use up at most.
inline constexpr double kMostUsed = 0.9;

// Share of the wrenches that add up to f to which W c = f has to hold.
inline constexpr double kBalanced = 1e-10;

// Forces this many times as large as what the limits are made for mean that nothing holds them:
// what stops them there is rounding in the problem's numbers.
inline constexpr double kRunaway = 1e6;

struct Layout {
  int wrench_rows = 6;        // k, rows of W
  std::vector<Model> models;  // n contacts
  int joints = 0;             // columns of J
  int inequalities = 0;       // rows of A
  bool ceilings = false;      // c_max given
  bool floors = false;        // c_min given

  // Where a contact's components start in c.
  int first(int contact) const {
    int start = 0;
    for (int i = 0; i < contact; ++i) start += static_cast<int>(models[i]);
    return start;
  }
  int contacts() const { return static_cast<int>(models.size()); }
  int components() const {
    int m = 0;
    for (Model model : models) m += static_cast<int>(model);
    return m;
  }
};

// What may have changed since a problem's numbers were last loaded; f always counts as changed.
enum Changed : unsigned {
  kChangedMap = 1,       // W
  kChangedJacobian = 2,  // J
  kChangedRest = 4,      // anything else
  kChangedAll = 7,
};

// Rows of ForceProblem.linear_limits() before any are left out: torques above and below, ceilings,
// floors, inequalities.
inline int limit_count(const Layout& layout) {
  return 2 * layout.joints + layout.inequalities +
         layout.contacts() * (int(layout.ceilings) + int(layout.floors));
}

// Components of the largest block that the contacts may ever form: joints and inequalities can come
// to tie all of them into one; without any, each stays by itself.
inline std::size_t largest_block(const Layout& layout) {
  return layout.joints + layout.inequalities > 0 ? layout.components() : 4;
}

// Where the fields start in the buffer; W is the first. `size` is the whole, in doubles.
struct Offsets {
  std::size_t f, J, tau_lo, tau_hi, tau_bias, c_max, c_min, engagement, A, b, mu, gamma, alpha,
      size;

  explicit Offsets(const Layout& layout) {
    const std::size_t k = layout.wrench_rows, n = layout.contacts(), m = layout.components();
    const std::size_t joints = layout.joints, rows = layout.inequalities;
    f = k * m;
    J = f + k;
    tau_lo = J + m * joints;
    tau_hi = tau_lo + joints;
    tau_bias = tau_hi + joints;
    c_max = tau_bias + joints;
    c_min = c_max + (layout.ceilings ? n : 0);
    engagement = c_min + (layout.floors ? n : 0);
    A = engagement + n;
    b = A + rows * m;
    mu = b + rows;
    gamma = mu + n;
    alpha = gamma + n;
    size = alpha + 1;
  }
};

// Read access to a packed problem: pointers to its fields, row-major.
struct Problem {
  const double *W, *f, *J, *tau_lo, *tau_hi, *tau_bias, *c_max, *c_min, *engagement, *A, *b, *mu,
      *gamma, *alpha;

  Problem(const Layout& layout, const double* packed) : Problem(Offsets(layout), packed) {}
  Problem(const Offsets& at, const double* packed)
      : W(packed),
        f(packed + at.f),
        J(packed + at.J),
        tau_lo(packed + at.tau_lo),
        tau_hi(packed + at.tau_hi),
        tau_bias(packed + at.tau_bias),
        c_max(packed + at.c_max),
        c_min(packed + at.c_min),
        engagement(packed + at.engagement),
        A(packed + at.A),
        b(packed + at.b),
        mu(packed + at.mu),
        gamma(packed + at.gamma),
        alpha(packed + at.alpha) {}

  bool in_grasp(int contact) const { return engagement[contact] > kRemovalThreshold; }
};

}  // namespace graspforce
