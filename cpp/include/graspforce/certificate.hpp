// Check of a proof of infeasibility, from the problem's numbers alone; the same arithmetic as
// graspforce.check_certificate, with the same allowance for rounding.
#pragma once

#include <algorithm>
#include <cmath>

#include "graspforce/cone.hpp"
#include "graspforce/layout.hpp"

namespace graspforce {

// True when y (k) and z (all linear limits, order of ForceProblem.linear_limits) prove that no
// admissible c has W c = f: e = Aᵀz − Wᵀy lies in the dual cones and y·f > z·b.
inline bool proves_infeasible(const Layout& layout, const Problem& p, const double* y,
                              const double* z) {
  const int k = layout.wrench_rows, n = layout.contacts(), m = layout.components();
  const int joints = layout.joints, rows = layout.inequalities;
  const double *z_hi = z, *z_lo = z_hi + joints, *z_max = z_lo + joints,
               *z_min = z_max + (layout.ceilings ? n : 0), *z_up = z_min + (layout.floors ? n : 0),
               *z_down = z_up + (layout.rate_limits ? m : 0), *z_A = z + limit_count(layout) - rows;
  const int count = limit_count(layout);
  const double unit = 1e-14 * (k + count);

  double gap = 0, size = 0;
  auto add = [&gap, &size](double value) {
    gap += value;
    size += std::abs(value);
  };
  for (int r = 0; r < k; ++r) {
    if (layout.soft_wrench && p.f_soft[r] > 0 && y[r] != 0) return false;  // excludes no c
    add(y[r] * p.f[r]);
  }
  for (int j = 0; j < joints; ++j) {
    add(-z_hi[j] * (p.tau_hi[j] - p.tau_bias[j]));
    add(-z_lo[j] * (p.tau_bias[j] - p.tau_lo[j]));
  }
  for (int i = 0; i < n && layout.ceilings; ++i) add(-z_max[i] * normal_ceiling(layout, p, i));
  for (int i = 0; i < n && layout.floors; ++i) add(z_min[i] * normal_floor(layout, p, i));
  for (int i = 0; i < m && layout.rate_limits; ++i) {
    add(-z_up[i] * (p.c_last[i] + p.dc_max[i]));
    add(-z_down[i] * (p.dc_max[i] - p.c_last[i]));
  }
  for (int r = 0; r < rows; ++r) add(-z_A[r] * p.b[r]);
  for (int i = 0; i < count; ++i)
    if (!(z[i] >= 0)) return false;
  // An internal force v of the motors is free but for their limits, so that e_v has to vanish; what
  // rounding leaves of it counts with the most that v can be, by a motor that feels v alone.
  for (int i = 0; i < layout.internals; ++i) {
    double e = 0, slop = 0, most = kInfinity;
    for (int j = 0; j < joints; ++j) {
      const double arm = p.internal[entry_at(i, j, joints)];
      e += arm * (z_hi[j] - z_lo[j]);
      slop += unit * std::abs(arm) * (z_hi[j] + z_lo[j]);
      bool alone = arm != 0;
      for (int c = 0; c < m + layout.internals && alone; ++c)
        alone = c == m + i || p.arm(c, j, m, joints) == 0;
      const double bias = p.tau_bias[j];
      if (alone)
        most = std::min(most, std::max(std::abs(p.tau_hi[j] - bias), std::abs(p.tau_lo[j] - bias)) /
                                  std::abs(arm));
    }
    if (std::abs(e) + slop > 0) add(-(std::abs(e) + slop) * most);
  }
  if (!(gap > unit * size)) return false;

  for (int i = 0, start = 0; i < n; start += static_cast<int>(layout.models[i]), ++i) {
    if (!p.in_grasp(i)) continue;
    const int dim = static_cast<int>(layout.models[i]);
    const Cone cone{dim, p.mu[i], p.mu[i] / p.gamma[i]};
    double e[4] = {}, slop[4] = {};
    for (int c = 0; c < dim; ++c) {
      auto term = [&](double value) {
        e[c] += value;
        slop[c] += unit * std::abs(value);
      };
      for (int j = 0; j < joints; ++j) {
        const double moment_arm = p.J[entry_at(start + c, j, joints)];
        term(moment_arm * z_hi[j]);
        term(-moment_arm * z_lo[j]);
      }
      if (c == 0 && layout.ceilings) term(z_max[i]);
      if (c == 0 && layout.floors) term(-z_min[i]);
      if (layout.rate_limits) term(z_up[start + c]), term(-z_down[start + c]);
      for (int r = 0; r < rows; ++r) term(p.A[entry_at(r, start + c, m)] * z_A[r]);
      for (int r = 0; r < k; ++r) term(-p.W[entry_at(r, start + c, m)] * y[r]);
    }
    // Not by squares, which underflow for small multipliers: the check is scale-free.
    double tangent = 0, radius = 0;
    for (int c = 1; c < dim; ++c) {
      tangent = std::hypot(tangent, e[c] / cone.weight(c));
      radius = std::hypot(radius, slop[c] / cone.weight(c));
    }
    if (!(e[0] - cone.mu * tangent >= slop[0] + cone.mu * radius)) return false;
  }
  return true;
}

}  // namespace graspforce
