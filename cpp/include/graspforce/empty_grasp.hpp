// The answer for a grasp without contacts: solvable only where the exact rows of W c = f and every
// limit hold at c = 0.
#pragma once

#include <algorithm>
#include <cmath>

#include "graspforce/answer.hpp"
#include "graspforce/certificate.hpp"
#include "graspforce/layout.hpp"

namespace graspforce {

inline void answer_empty_grasp(const Layout& layout, const Problem& p, Answer& answer) {
  const auto is_soft = [&](int r) { return layout.soft_wrench && p.f_soft[r] > 0; };
  for (int r = 0; r < layout.wrench_rows; ++r)
    if (p.f[r] != 0 && !is_soft(r)) return answer.clear(Status::WrenchUnreachable);
  answer.clear(Status::Solved);
  answer.result.decrement = 0;
  for (int r = 0; r < layout.wrench_rows; ++r)
    if (is_soft(r)) answer.nu[r] = p.f[r] / p.f_soft[r] / p.f_soft[r];
  if (!answer.finite()) return answer.clear(Status::InvalidNumbers);
  std::fill(answer.y.begin(), answer.y.end(), 0.0);
  std::fill(answer.z.begin(), answer.z.end(), 0.0);
  const int m = layout.components(), joints = layout.joints;
  // A limit 0 ≤ room that does not hold, on a row without entries, is its own proof. The row's
  // entries are `stride` apart.
  auto check = [&](int limit, double room, double scale, const double* row, int stride) {
    Result& result = answer.result;
    if (room > 0 || result.status != Status::Solved) return;
    for (int c = 0; c < m; ++c)
      if (row[std::size_t(c) * stride] != 0) return;
    answer.z[limit] = 1;
    const bool proved = proves_infeasible(layout, p, answer.y.data(), answer.z.data());
    result.status = proved ? Status::Infeasible : Status::Stalled;
    result.decrement = kInfinity;
    if (proved && scale > 0) result.violation = -room / scale;
  };
  for (int j = 0; j < joints; ++j) {
    const double half = 0.5 * (p.tau_hi[j] - p.tau_lo[j]);
    check(j, p.tau_hi[j] - p.tau_bias[j], half, p.J + j, joints);
    check(joints + j, p.tau_bias[j] - p.tau_lo[j], half, p.J + j, joints);
  }
  for (int r = 0, first = limit_count(layout) - layout.inequalities; r < layout.inequalities; ++r)
    check(first + r, p.b[r], std::abs(p.b[r]), p.A + std::size_t(r) * m, 1);
}

}  // namespace graspforce
