// The shape of a force distribution problem and where its numbers stand in one flat buffer.
//
// The order of the fields is that of graspforce._engine.layout.FIELDS in Python: a packed buffer is
// a whole problem, and a snapshot of it is one copy.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <tuple>
#include <vector>

#include "graspforce/fields.hpp"

namespace graspforce {

// A contact model's value is its number of force components.
enum class Model : int { FPC = 1, PCWF = 3, SFC = 4 };

// A contact at or below this engagement is out of the grasp (end of Section III-C.3).
inline constexpr double kRemovalThreshold = 1e-6;

// Share of a limit that the pushes of a cold start use up at most.
inline constexpr double kMostUsed = 0.9;

// Share of the wrenches that add up to f to which W c = f has to hold.
inline constexpr double kBalanced = 1e-10;

// A normal force whose floor is its ceiling, a set squeeze, keeps to this share of it.
inline constexpr double kSqueeze = 1e-9;

// Forces this many times as large as what the limits are made for mean that nothing holds them:
// what stops them there is rounding in the problem's numbers.
inline constexpr double kRunaway = 1e6;

// Where an entry of a row-major matrix of so many columns stands.
inline std::size_t entry_at(int row, int column, int columns) {
  return static_cast<std::size_t>(row) * columns + column;
}

struct Layout {
  int wrench_rows = 6;        // k, rows of W
  std::vector<Model> models;  // n contacts
  int joints = 0;             // columns of J
  int inequalities = 0;       // rows of A
  bool ceilings = false;      // c_max given
  bool floors = false;        // c_min given
  bool rate_limits = false;   // c_last and dc_max given
  bool soft_wrench = false;   // f_soft given
  bool pulls = false;         // pull given
  int internals = 0;          // rows of internal
  bool cone_weights = false;  // cone_weight given

  bool operator==(const Layout& other) const {
    const auto sizes = [](const Layout& l) {
      return std::tie(l.wrench_rows, l.models, l.joints, l.inequalities, l.ceilings, l.floors,
                      l.rate_limits, l.soft_wrench, l.pulls, l.internals, l.cone_weights);
    };
    return sizes(*this) == sizes(other);
  }

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

// Rows of ForceProblem.linear_limits() before any are left out: torques above and below, ceilings,
// floors, rates above and below, inequalities.
inline int limit_count(const Layout& layout) {
  return 2 * layout.joints + layout.inequalities +
         layout.contacts() * (int(layout.ceilings) + int(layout.floors)) +
         2 * layout.components() * int(layout.rate_limits);
}

// Rows lo ≤ a·c ≤ hi of all blocks together, for any partition.
inline std::size_t most_rows(const Layout& layout) {
  return layout.joints + layout.inequalities + layout.contacts() +
         (layout.rate_limits ? layout.components() : 0);
}

// What an answer holds: the contact forces, then the internal ones of the motors.
inline int force_count(const Layout& layout) { return layout.components() + layout.internals; }

// Most unknowns of the general kernels: the forces, and the slack of each row that is soft or is
// made so to find the nearest wrench.
inline std::size_t unknowns(const Layout& layout) {
  return force_count(layout) + layout.wrench_rows;
}
inline std::size_t most_blocks(const Layout& layout) {
  return layout.contacts() + layout.internals + layout.wrench_rows;
}

// Components of the largest block that the contacts may ever form: joints and inequalities can come
// to tie all of them into one; without any, each stays by itself.
inline std::size_t largest_block(const Layout& layout) {
  return layout.joints + layout.inequalities > 0 ? force_count(layout) : 4;
}

// Where the fields start in the buffer, in doubles, and how large the whole is.
struct Offsets : Fields<std::size_t> {
  std::size_t size = 0;

  explicit Offsets(const Layout& l) {
#define GRASPFORCE_PLACE(name, type, rows, columns, ...) \
  name = size;                                           \
  size += std::size_t(rows) * std::size_t(columns);
    GRASPFORCE_FIELDS(GRASPFORCE_PLACE)
#undef GRASPFORCE_PLACE
  }
};

// Calls visit(field) for every field of a layout, in the order of the buffer.
template <class Visit>
void each_field(const Layout& l, Visit visit) {
  std::size_t offset = 0;
#define GRASPFORCE_VISIT(name, type, rows, columns, initial, range, ...)                          \
  {                                                                                               \
    const Field field{                                                                            \
        #name, axes(static_cast<type*>(nullptr)), int(rows), int(columns), Range::range, offset}; \
    visit(field);                                                                                 \
    offset += field.size();                                                                       \
  }
  GRASPFORCE_FIELDS(GRASPFORCE_VISIT)
#undef GRASPFORCE_VISIT
}

// Read access to a packed problem: pointers to its fields, row-major.
struct Problem : Fields<const double*> {
  Problem() = default;
  Problem(const Layout& layout, const double* packed) : Problem(Offsets(layout), packed) {}
  Problem(const Offsets& at, const double* packed) {
#define GRASPFORCE_POINT(name, ...) name = packed + at.name;
    GRASPFORCE_FIELDS(GRASPFORCE_POINT)
#undef GRASPFORCE_POINT
  }

  bool in_grasp(int contact) const { return engagement[contact] > kRemovalThreshold; }
  // What a joint's torque has of one of the m contact forces, or of the internal force behind them.
  double arm(int force, int joint, int m, int joints) const {
    return force < m ? J[entry_at(force, joint, joints)]
                     : internal[entry_at(force - m, joint, joints)];
  }
};

// Between what a contact's normal force has to stay; infinite where there is no such limit. A floor
// at the ceiling leaves a band about both, by what the cone bears, the contact's pull included.
inline double normal_ceiling(const Layout& layout, const Problem& p, int contact) {
  if (!layout.ceilings) return std::numeric_limits<double>::infinity();
  const double pull = layout.pulls ? p.pull[contact] : 0;
  const double least = layout.floors ? (1 + kSqueeze) * (p.c_min[contact] + pull) : 0;
  return p.engagement[contact] * (std::max(p.c_max[contact] + pull, least) - pull);
}
inline double normal_floor(const Layout& layout, const Problem& p, int contact) {
  if (!layout.floors) return -std::numeric_limits<double>::infinity();
  const double pull = layout.pulls ? p.pull[contact] : 0, least = p.c_min[contact] + pull;
  const double most = layout.ceilings ? (1 - kSqueeze) * (p.c_max[contact] + pull) : least;
  return p.engagement[contact] * (std::min(least, most) - pull);
}

// What Phi is divided by, so that each of its terms is standard self-concordant: the least of their
// weights, and 1.
inline double barrier_unit(const Layout& layout, const Problem& p) {
  double unit = *p.alpha < 1 ? *p.alpha : 1;
  for (int i = 0; i < layout.contacts() && layout.cone_weights; ++i)
    if (p.in_grasp(i) && p.cone_weight[i] < unit) unit = p.cone_weight[i];
  return unit;
}

}  // namespace graspforce
