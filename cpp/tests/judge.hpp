// An independent judge of an engine's verdicts: every residual and proof once more, in long double,
// from the problem's data alone and with none of the core's mathematics.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "graspforce/engine.hpp"

namespace graspforce {

using Real = long double;

class Judge {
 public:
  Judge(const Layout& layout, const double* packed)
      : layout_(layout),
        p_(layout, packed),
        m_(layout.components()),
        forces_(m_ + layout.internals) {
    for (int i = 0; i < layout.contacts(); ++i)
      contact_of_.insert(contact_of_.end(), static_cast<int>(layout.models[i]), i);
  }

  // What is wrong with a verdict; null when nothing is.
  const char* find_fault(const Engine& engine, const Result& result) const {
    const int status = static_cast<int>(result.status);
    if (status < 0 || status > 7) return "no such status";
    for (int i = 0; i < forces_; ++i)
      if (!std::isfinite(engine.forces()[i])) return "a force that is no number";
    for (int r = 0; r < layout_.wrench_rows; ++r)
      if (!std::isfinite(engine.multipliers()[r])) return "a multiplier that is no number";
    if (!(result.decrement >= 0)) return "a decrement that is no number";
    const bool none = result.status == Status::Infeasible || result.status == Status::Unbounded ||
                      result.status == Status::WrenchUnreachable || result.status == Status::OnEdge;
    if (none && result.decrement < kInfinity) return "no minimum, and a bound on the decrement";
    if (!(result.violation >= 0 && result.violation < kInfinity))
      return "a violation that is no number";
    if (result.status == Status::Solved) {
      if (!(result.decrement < 1)) return "solved without a bound on the decrement";
      if (slips(engine.forces())) return "solved, and a contact slips";
      if (passes_a_limit(engine.forces())) return "solved, and a limit is passed";
      if (!(wrench_error(engine.forces()) <= 1e-9L)) return "solved, and the wrench is another";
    }
    if (result.nearest) {
      if (!none || result.status == Status::Unbounded) return "a nearest wrench without need of it";
      if (slips(engine.forces())) return "the nearest wrench, and a contact slips";
      if (passes_a_limit(engine.forces())) return "the nearest wrench, and a limit is passed";
    }
    if (result.status == Status::OnEdge && !(wrench_error(engine.forces()) <= 1e-7L))
      return "on the edge, and the wrench is another";
    if (result.status == Status::Infeasible &&
        !proves_infeasible(engine.certificate_y(), engine.certificate_z()))
      return "infeasible without a proof";
    if (result.status == Status::WrenchUnreachable && !out_of_range())
      return "unreachable, and in the range of W";
    return nullptr;
  }

  // max |W c − f| of the exact rows relative to the wrenches that add up to f.
  Real wrench_error(const double* c) const {
    Real worst = 0, scale = 0;
    for (int r = 0; r < layout_.wrench_rows; ++r) {
      if (is_soft(r)) continue;
      Real sum = -Real(p_.f[r]), size = std::abs(Real(p_.f[r]));
      for (int i = 0; i < m_; ++i) {
        sum += Real(p_.W[r * m_ + i]) * c[i];
        size += std::abs(Real(p_.W[r * m_ + i])) * (std::abs(Real(c[i])) + shift(i));
      }
      worst = std::max(worst, std::abs(sum));
      scale = std::max(scale, size);
    }
    return worst > m_ * kLeast ? worst / scale : 0;  // but for what underflows in double
  }

 private:
  static constexpr long double kUnit = 4e-16L;  // of rounding, a term
  static constexpr long double kLeast = std::numeric_limits<double>::denorm_min();

  bool is_soft(int r) const { return layout_.soft_wrench && p_.f_soft[r] > 0; }

  bool slips(const double* c) const {
    for (int i = 0; i < layout_.contacts(); ++i) {
      if (!p_.in_grasp(i)) continue;
      const double* y = c + layout_.first(i);
      const Real preload = pull(i), height = Real(p_.mu[i]) * (y[0] + preload);
      const Real lost = Real(p_.mu[i]) * (std::abs(Real(y[0])) + preload) * (preload > 0);
      if (!(height > tangent(i, y) * (1 - 8 * kUnit) - 8 * (kUnit * lost + kLeast))) return true;
    }
    return false;
  }

  Real pull(int i) const { return layout_.pulls ? Real(p_.engagement[i]) * p_.pull[i] : 0; }

  Real tangent(int i, const double* y) const {
    Real sum = 0;
    for (int d = 1; d < static_cast<int>(layout_.models[i]); ++d) {
      const Real t = (d == 3 ? Real(p_.mu[i]) / p_.gamma[i] : 1) * y[d];
      sum += t * t;
    }
    return std::sqrt(sum);
  }

  bool passes_a_limit(const double* c) const {
    bool passed = false;
    each_limit([&](int, auto entry, Real bound, Real size) {
      Real room = bound;
      for (int i = 0; i < forces_; ++i) {
        room -= entry(i) * c[i];
        size += std::abs(entry(i)) * (std::abs(Real(c[i])) + shift(i));
      }
      passed |= !(room > -(forces_ + 4) * (kUnit * size + kLeast));
    });
    return passed;
  }

  // e = Aᵀz − Wᵀy in the dual cones, z ≥ 0, y·f > z·b: see graspforce.Certificate.
  bool proves_infeasible(const double* y, const double* z) const {
    std::vector<Real> e(forces_);
    Real gap = 0;
    bool sound = true;
    for (int r = 0; r < layout_.wrench_rows; ++r) {
      sound &= !is_soft(r) || y[r] == 0;
      gap += Real(y[r]) * p_.f[r];
      for (int i = 0; i < m_; ++i) e[i] -= Real(p_.W[r * m_ + i]) * y[r];
    }
    each_limit([&](int row, auto entry, Real bound, Real) {
      sound &= z[row] >= 0;
      gap -= z[row] * bound;
      for (int i = 0; i < forces_; ++i) e[i] += entry(i) * z[row];
    });
    for (int v = 0; v < layout_.internals; ++v) gap -= std::abs(e[m_ + v]) * most_internal(v);
    for (int i = 0; i < layout_.contacts(); ++i) {
      if (!p_.in_grasp(i)) continue;
      const Real* part = e.data() + layout_.first(i);
      gap -= pull(i) * part[0];  // the most that −e·c can be, at the apex of the shifted cone
      Real sum = 0;
      for (int d = 1; d < static_cast<int>(layout_.models[i]); ++d) {
        const Real t = (d == 3 ? Real(p_.gamma[i]) / p_.mu[i] : 1) * part[d];
        sum += t * t;
      }
      // The least double, a term: that much the core's own products lose when they underflow.
      const Real lost = (layout_.wrench_rows + limit_count(layout_)) * kLeast;
      sound &= part[0] + lost * (1 + p_.mu[i]) >= p_.mu[i] * std::sqrt(sum);
    }
    return sound && gap > 0;
  }

  // By how much the core's c is above a force: its rounding is that of the sum.
  Real shift(int force) const {
    if (force >= m_ || (force > 0 && contact_of_[force] == contact_of_[force - 1])) return 0;
    return pull(contact_of_[force]);
  }

  // The most that an internal force can be, by a motor that feels it alone; zero without
  // multipliers to count it with would not matter, so nothing is infinite.
  Real most_internal(int v) const {
    Real most = std::numeric_limits<double>::max();
    for (int j = 0; j < layout_.joints; ++j) {
      const Real arm = p_.internal[v * layout_.joints + j];
      int felt = 0;
      for (int i = 0; i < m_; ++i) felt += p_.J[i * layout_.joints + j] != 0;
      for (int w = 0; w < layout_.internals; ++w) felt += p_.internal[w * layout_.joints + j] != 0;
      if (arm == 0 || felt != 1) continue;
      const Real bias = p_.tau_bias[j];
      most = std::min(most, std::max(std::abs(p_.tau_lo[j] - bias), std::abs(p_.tau_hi[j] - bias)) /
                                std::abs(arm));
    }
    return most;
  }

  // Whether f is away from the span of W's columns: what is left of it once everything along an
  // orthonormal basis of the rows, in units of their lengths, has been accounted for.
  bool out_of_range() const {
    const int k = layout_.wrench_rows;
    std::vector<std::vector<Real>> rows(k, std::vector<Real>(m_));
    std::vector<Real> f(k), length(k), size(k);
    std::vector<char> used(k);
    for (int r = 0; r < k; ++r) {
      for (int i = 0; i < m_; ++i)
        if (p_.in_grasp(contact_of_[i])) rows[r][i] = p_.W[r * m_ + i];
      length[r] = std::sqrt(product(rows[r], rows[r]));
      if (length[r] == 0) length[r] = 1;
      for (Real& entry : rows[r]) entry /= length[r];
      f[r] = p_.f[r] / length[r];
      size[r] = std::abs(f[r]);
      used[r] = is_soft(r);
    }
    for (;;) {
      int best = -1;
      Real most = 1e-8L;  // forces that a direction this weak would take are none
      for (int r = 0; r < k; ++r) {
        const Real left = used[r] ? 0 : std::sqrt(product(rows[r], rows[r]));
        if (left > most * (1 + 1e-12L)) best = r, most = left;
      }
      if (best < 0) break;
      used[best] = 1;
      for (Real& entry : rows[best]) entry /= most;
      f[best] /= most;
      size[best] /= most;
      for (int r = 0; r < k; ++r)
        for (int pass = 0; pass < 2 && !used[r]; ++pass) {
          const Real along = product(rows[r], rows[best]);
          for (int i = 0; i < m_; ++i) rows[r][i] -= along * rows[best][i];
          f[r] -= along * f[best];
          size[r] += std::abs(along) * size[best];
        }
    }
    Real c = 0;  // along the basis
    for (int r = 0; r < k; ++r)
      if (used[r] && !is_soft(r)) c = std::max(c, std::abs(f[r]));
    for (int r = 0; r < k; ++r)
      if (!used[r] && std::abs(f[r]) > 1e-10L * std::max(size[r], c)) return true;
    return false;
  }

  static Real product(const std::vector<Real>& a, const std::vector<Real>& b) {
    Real sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
  }

  // Calls work(row, entry, bound, size) for every limit entry·c ≤ bound that counts; `size` is what
  // the bound has been computed from.
  template <class Work>
  void each_limit(Work work) const {
    const int n = layout_.contacts(), joints = layout_.joints;
    int row = 0;
    auto offer = [&](auto entry, Real bound, Real size) {
      bool touches = false, counts = false;
      auto takes_part = [&](int i) { return i >= m_ || p_.in_grasp(contact_of_[i]); };
      for (int i = 0; i < forces_; ++i) {
        touches |= entry(i) != 0;
        counts |= entry(i) != 0 && takes_part(i);
      }
      if (counts || !touches) {
        auto present = [&](int i) { return takes_part(i) ? entry(i) : 0; };
        work(row, present, bound, size);
      }
      ++row;
    };
    for (int side : {1, -1})
      for (int j = 0; j < joints; ++j) {
        const Real limit = side > 0 ? p_.tau_hi[j] : p_.tau_lo[j], bias = p_.tau_bias[j];
        offer(
            [&, side, j](int i) {
              const double* arms = i < m_ ? p_.J + i * joints : p_.internal + (i - m_) * joints;
              return side * Real(arms[j]);
            },
            side * (limit - bias), std::abs(limit) + std::abs(bias));
      }
    for (int side : {1, -1}) {
      if (!(side > 0 ? layout_.ceilings : layout_.floors)) continue;
      for (int i = 0; i < n; ++i) {
        const int normal = layout_.first(i);
        // A floor at the ceiling leaves 1e-9 of it to either side, a pull counted in.
        const Real more = layout_.pulls ? p_.pull[i] : 0;
        Real force = (side > 0 ? p_.c_max : p_.c_min)[i] + more;
        if (side > 0 && layout_.floors) force = std::max(force, (1 + 1e-9L) * (p_.c_min[i] + more));
        if (side < 0 && layout_.ceilings)
          force = std::min(force, (1 - 1e-9L) * (p_.c_max[i] + more));
        const Real bound = Real(p_.engagement[i]) * (force - more);
        offer([normal, side](int c) { return c == normal ? Real(side) : 0; }, side * bound, bound);
      }
    }
    for (int side : {1, -1})
      for (int i = 0; layout_.rate_limits && i < m_; ++i)
        offer([i, side](int c) { return c == i ? Real(side) : 0; },
              Real(p_.dc_max[i]) + side * Real(p_.c_last[i]),
              std::abs(Real(p_.dc_max[i])) + std::abs(Real(p_.c_last[i])));
    for (int r = 0; r < layout_.inequalities; ++r)
      offer([&, r](int i) { return i < m_ ? Real(p_.A[r * m_ + i]) : 0; }, p_.b[r],
            std::abs(Real(p_.b[r])));
  }

  const Layout& layout_;
  Problem p_;
  int m_, forces_;  // of contacts, and the internal ones behind them
  std::vector<int> contact_of_;
};

}  // namespace graspforce
