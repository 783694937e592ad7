// How far forces are from slipping and from their limits, recomputed from a problem's data alone:
// what a controller checks before it uses an answer that is not SOLVED.
#pragma once

#include <algorithm>
#include <cmath>

#include "graspforce/cone.hpp"
#include "graspforce/layout.hpp"

namespace graspforce {

struct Margins {
  double friction = kInfinity;  // least mu n − ‖w t‖ of a contact in the grasp [N]
  double torque = kInfinity;    // least distance of a joint torque to a limit [N·m]
  double limit = kInfinity;  // least slack of ceilings, floors, rates and A c ≤ b, in their units
  double wrench_error = 0;   // largest |W c − f| [N, N·m]

  // Strictly inside every limit, whatever the wrench.
  bool inside() const { return friction > 0 && torque > 0 && limit > 0; }
};

// Of contact forces c, and the internal ones behind them. Limits that touch only contacts out of
// the grasp have left with them.
inline Margins find_margins(const Layout& layout, const Problem& p, const double* c) {
  const int m = layout.components(), joints = layout.joints;
  Margins margins;
  // The sum of a row's products with c, and whether the row counts.
  auto along = [&](auto entry, bool& counts) {
    double sum = 0;
    bool touches = false;
    counts = false;
    for (int i = 0, j = 0; i < layout.contacts(); ++i)
      for (int end = j + static_cast<int>(layout.models[i]); j < end; ++j) {
        sum += entry(j) * c[j];
        touches |= entry(j) != 0;
        counts |= entry(j) != 0 && p.in_grasp(i);
      }
    counts |= !touches;
    return sum;
  };
  bool counts;
  for (int j = 0; j < joints; ++j) {
    double tau = along([&](int i) { return p.J[entry_at(i, j, joints)]; }, counts) + p.tau_bias[j];
    for (int i = m; i < force_count(layout); ++i) {
      const double arm = p.arm(i, j, m, joints);
      tau += arm * c[i];
      counts |= arm != 0;
    }
    if (counts) margins.torque = std::min({margins.torque, p.tau_hi[j] - tau, tau - p.tau_lo[j]});
  }
  for (int r = 0; r < layout.inequalities; ++r) {
    const double t = along([&](int i) { return p.A[entry_at(r, i, m)]; }, counts);
    if (counts) margins.limit = std::min(margins.limit, p.b[r] - t);
  }
  for (int i = 0, start = 0; i < layout.contacts(); start += static_cast<int>(layout.models[i++])) {
    if (!p.in_grasp(i)) continue;
    const Cone cone{static_cast<int>(layout.models[i]), p.mu[i], p.mu[i] / p.gamma[i]};
    const double preload = layout.pulls ? cone.mu * p.engagement[i] * p.pull[i] : 0;
    margins.friction = std::min(margins.friction, cone.margin(c + start) + preload);
    margins.limit = std::min({margins.limit, normal_ceiling(layout, p, i) - c[start],
                              c[start] - normal_floor(layout, p, i)});
    for (int j = start; layout.rate_limits && j < start + static_cast<int>(layout.models[i]); ++j)
      margins.limit = std::min(margins.limit, p.dc_max[j] - std::abs(c[j] - p.c_last[j]));
  }
  for (int r = 0; r < layout.wrench_rows; ++r) {
    const double w = along([&](int i) { return p.W[entry_at(r, i, m)]; }, counts);
    margins.wrench_error = std::max(margins.wrench_error, std::abs(w - p.f[r]));
  }
  return margins;
}

}  // namespace graspforce
