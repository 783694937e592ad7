// What "nearest" means for a wrench that cannot be had: the scale of each row of W c = f, in which
// the distance of W c from f is measured; and the projection of f onto the range of W.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/layout.hpp"
#include "graspforce/linalg.hpp"

namespace graspforce {

// How many rows of W are forces and how many torques: those of a body in space, with any further
// rows behind them, or of one in the plane. Rows of another number are not known to be either.
struct RowKinds {
  int forces, torques;

  explicit RowKinds(int rows)
      : forces(rows >= 6   ? 3
               : rows == 3 ? 2
                           : 0),
        torques(rows >= 6   ? 3
                : rows == 3 ? 1
                            : 0) {}
};

// The scale of every row (k), of the contacts in the grasp: 1 N for a force; for the torques, one
// for all of them, the grasp's size, the root mean square of the torque about the origin per newton
// of a contact's force; for any other row the root mean square of its length at a contact. 1 where
// that is zero. The definition in Python is ForceProblem.wrench_scales.
inline void wrench_scales(const Layout& layout, const Problem& p, double* scale) {
  const int k = layout.wrench_rows, m = layout.components();
  const RowKinds kinds(k);
  double forces = 0, torques = 0, contacts = 0;
  std::fill_n(scale, k, 0.0);
  for (int i = 0, first = 0; i < layout.contacts(); first += static_cast<int>(layout.models[i++])) {
    if (!p.in_grasp(i)) continue;
    contacts += 1;
    for (int d = 0; d < static_cast<int>(layout.models[i]); ++d)
      for (int r = 0; r < k; ++r) {
        const double entry = p.W[entry_at(r, first + d, m)];
        scale[r] += entry * entry;
        if (d == 3) continue;  // a torsion is no force
        if (r < kinds.forces) forces += entry * entry;
        if (r >= kinds.forces && r < kinds.forces + kinds.torques) torques += entry * entry;
      }
  }
  for (int r = 0; r < k; ++r) {
    const double squared = r < kinds.forces                   ? 1
                           : r < kinds.forces + kinds.torques ? torques / forces
                                                              : scale[r] / contacts;
    scale[r] = squared > 0 && squared < kInfinity ? std::sqrt(squared) : 1;
  }
}

// The wrench nearest to f in the range of W, and what finds it. Does not allocate.
class RangeProjection {
 public:
  explicit RangeProjection(const Layout& layout)
      : layout_(layout),
        columns_(std::size_t(layout.components()) * layout.wrench_rows),
        scale_(layout.wrench_rows),
        f_(layout.wrench_rows),
        left_(layout.wrench_rows) {}

  // Of the given rows, which have that rank; other rows of f stay as they are.
  const double* project(const Problem& p, const std::vector<int>& rows, int rank) {
    const int m = layout_.components(), k = static_cast<int>(rows.size());
    wrench_scales(layout_, p, scale_.data());
    std::copy_n(p.f, layout_.wrench_rows, f_.begin());
    for (int r = 0; r < k; ++r) left_[r] = p.f[rows[r]] / scale_[rows[r]];
    for (int i = 0, c = 0; i < layout_.contacts(); ++i)
      for (int d = 0; d < static_cast<int>(layout_.models[i]); ++d, ++c)
        for (int r = 0; r < k; ++r)
          column(c)[r] = p.in_grasp(i) ? p.W[entry_at(rows[r], c, m)] / scale_[rows[r]] : 0;
    // Gram-Schmidt with pivoting over the columns; what they take of f is taken out of it.
    for (int step = 0; step < rank; ++step) {
      int best = 0;
      for (int c = 1; c < m; ++c)
        if (dot(column(c), column(c), k) > dot(column(best), column(best), k)) best = c;
      const double length = std::sqrt(dot(column(best), column(best), k));
      if (!(length > 0)) break;
      for (int r = 0; r < k; ++r) direction()[r] = column(best)[r] / length;
      for (int pass = 0; pass < 2; ++pass) {
        add_scaled(-dot(left_.data(), direction(), k), direction(), k, left_.data());
        for (int c = 0; c < m; ++c)
          add_scaled(-dot(column(c), direction(), k), direction(), k, column(c));
      }
    }
    for (int r = 0; r < k; ++r) f_[rows[r]] -= left_[r] * scale_[rows[r]];
    return f_.data();
  }

 private:
  double* column(int c) { return columns_.data() + std::size_t(c) * layout_.wrench_rows; }
  double* direction() { return direction_.data(); }

  const Layout& layout_;
  std::vector<double> columns_, scale_, f_, left_, direction_ = std::vector<double>(f_.size());
};

}  // namespace graspforce
