// The barrier function Phi on {W c = f} and its Newton step, block by block.
//
// In every block the Hessian H and the gradient g of Phi are dense and small; the blocks meet only
// in W c = f. With H = L Lᵀ, Z = L⁻¹ Wᵀ, u = L⁻¹ g the step of the whole problem is
//
//     (Σ ZᵀZ) ν = f − W c + Σ Zᵀu        k × k, whatever the number of contacts
//     d = L⁻ᵀ (Z ν − u)                  in each block
//     λ² = Σ ‖Z ν − u‖²                  the decrement, d's restoring part included
//
// so no null space is formed, and the residual f − W c is removed by the same step. Phase 1 has
// one variable more, the slack σ that relaxes every limit by its own scale; it borders the system
// by a column (`shift_gradient`). Phi is divided by min(1, alpha): each term is then standard
// self-concordant.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "graspforce/cone.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/linalg.hpp"
#include "graspforce/structure.hpp"

namespace graspforce {

enum class Barrier { Exact, Relaxed };  // Phi itself, or Phase 1's with every limit moved by σ

class System {
 public:
  explicit System(const Layout& layout)
      : layout_(layout), structure_(layout), k_(layout.wrench_rows) {
    rows_in_use_.resize(k_);
    f_.resize(k_);
    S_.resize(static_cast<std::size_t>(k_) * k_);
    nu_.resize(k_);
    nu_sigma_.resize(k_);
  }

  // ---- data ------------------------------------------------------------------------------

  void load(const Problem& p) {
    if (!structure_.holds(p)) {
      structure_.find(p);
      allot();
    }
    const double weakest = std::min(1.0, *p.alpha);
    cone_weight_ = 1 / weakest;
    limit_weight_ = *p.alpha / weakest;
    use_all_rows();
    std::copy(p.f, p.f + k_, f_.begin());
    for (Part& part : parts_) load_block(p, part);
    finish_scales();
  }

  // Keeps only the given rows of W c = f: an independent set when W is rank-deficient.
  void restrict_rows(const Problem& p, const std::vector<int>& rows) {
    k_ = static_cast<int>(rows.size());
    std::copy(rows.begin(), rows.end(), rows_in_use_.begin());
    for (int r = 0; r < k_; ++r) f_[r] = p.f[rows[r]];
    for (Part& part : parts_) load_wrench_rows(p, part);
  }

  bool empty() const { return parts_.empty(); }
  int wrench_rows() const { return k_; }
  // Terms of the barrier, a cone counting twice: its complexity parameter with unit weights.
  double complexity() const {
    double terms = 0;
    for (const Part& part : parts_) {
      for (const Tip& tip : part.tips)
        terms += 2 + (tip.ceiling < kInfinity) + (tip.floor > -kInfinity);
      for (int r = 0; r < part.rows; ++r)
        terms += (part.hi[r] < kInfinity) + (part.lo[r] > -kInfinity);
    }
    return terms;
  }

  // ---- the point ---------------------------------------------------------------------------

  void set_forces(const double* c) {
    for (Part& part : parts_)
      for (int i = 0; i < part.q; ++i) part.c[i] = c[part.block->components[i]];
  }

  // Writes c in the problem's order; contacts out of the grasp get zero.
  void get_forces(double* c) const {
    std::fill(c, c + layout_.components(), 0.0);
    for (const Part& part : parts_)
      for (int i = 0; i < part.q; ++i) c[part.block->components[i]] = part.c[i];
  }

  // Pure pushes, each `fraction` of its contact's reach.
  void set_pushes(double fraction) {
    for (Part& part : parts_) {
      std::fill(part.c, part.c + part.q, 0.0);
      for (const Tip& tip : part.tips) part.c[tip.first] = fraction * tip.reach;
    }
  }

  // W⁺ f with equal weights on all components (Eq. 17).
  void set_least_norm() {
    clear_schur();
    for (Part& part : parts_) {
      add_outer(part.Wt, part.q);
      std::fill(part.c, part.c + part.q, 0.0);
    }
    cholesky(S_.data(), k_);
    std::copy(f_.begin(), f_.begin() + k_, nu_.begin());
    solve_schur(nu_.data());
    for (Part& part : parts_)
      for (int i = 0; i < part.q; ++i) part.c[i] = dot(part.Wt + i * k_, nu_.data(), k_);
  }

  double sigma = 0;  // Phase 1's slack

  // The least σ that admits the point; positive when it is outside the exact limits.
  double least_sigma() const {
    double least = -kInfinity;
    for (const Part& part : parts_) {
      for (const Tip& tip : part.tips) {
        const double* y = part.c + tip.first;
        least = std::max(least, -tip.cone.margin(y) / tip.cone_scale);
        least = std::max(least, std::max(y[0] - tip.ceiling, tip.floor - y[0]) / tip.reach);
      }
      for (int r = 0; r < part.rows; ++r) {
        const double t = dot(part.a + r * part.q, part.c, part.q);
        least = std::max(least, std::max(t - part.hi[r], part.lo[r] - t) / part.scale[r]);
      }
    }
    return least;
  }
  bool inside() const { return least_sigma() < 0; }

  double largest_reach() const {
    double largest = 0;
    for (const Part& part : parts_)
      for (const Tip& tip : part.tips) largest = std::max(largest, tip.reach);
    return largest;
  }

  double largest_force() const {
    double largest = 0;
    for (const Part& part : parts_)
      for (int i = 0; i < part.q; ++i) largest = std::max(largest, std::abs(part.c[i]));
    return largest;
  }

  // max |f − W c| over the rows in use, relative to the wrenches that add up to f.
  double relative_wrench_error() {
    double worst = 0, scale = 0;
    for (int r = 0; r < k_; ++r) {
      double sum = 0, size = 0;
      for (const Part& part : parts_)
        for (int i = 0; i < part.q; ++i) {
          const double wrench = part.Wt[i * k_ + r] * part.c[i];
          sum += wrench;
          size += std::abs(wrench);
        }
      worst = std::max(worst, std::abs(f_[r] - sum));
      scale = std::max(scale, std::max(size, std::abs(f_[r])));
    }
    return scale > 0 ? worst / scale : 0;
  }

  // ---- derivatives and the Newton step -------------------------------------------------------

  // Gradient and factored Hessian at the point; false when it is outside the limits.
  template <Barrier barrier>
  bool evaluate() {
    const double cone = barrier == Barrier::Exact ? cone_weight_ : 1;
    const double limit = barrier == Barrier::Exact ? limit_weight_ : 1;
    const double shift = barrier == Barrier::Exact ? 0 : sigma;
    sigma_gradient_ = sigma_hessian_ = 0;
    for (Part& part : parts_) {
      const int q = part.q;
      std::fill(part.g, part.g + q, 0.0);
      std::fill(part.H, part.H + q * q, 0.0);
      if (barrier == Barrier::Relaxed) std::fill(part.h, part.h + q, 0.0);
      for (const Tip& tip : part.tips)
        if (!add_tip<barrier>(part, tip, shift, cone, limit)) return false;
      for (int r = 0; r < part.rows; ++r)
        if (!add_row<barrier>(part, r, shift, limit)) return false;
    }
    return true;
  }

  // Newton step d from the evaluated point, with the multipliers ν; returns the decrement λ.
  double newton() {
    solve_blocks();
    double squared = 0;
    for (Part& part : parts_) {
      for (int i = 0; i < part.q; ++i) {
        part.d[i] = dot(part.Z + i * k_, nu_.data(), k_) - part.u[i];
        squared += part.d[i] * part.d[i];
      }
      back_substitute(part.H, part.q, part.d);
    }
    return std::sqrt(squared);
  }

  // The same for κσ + Phi_relaxed, in (c, σ): the σ column is eliminated after the blocks.
  double newton_relaxed(double kappa) {
    solve_blocks();
    std::fill(nu_sigma_.begin(), nu_sigma_.end(), 0.0);
    for (Part& part : parts_) {
      std::copy(part.h, part.h + part.q, part.v);
      forward_substitute(part.H, part.q, part.v);
      for (int i = 0; i < part.q; ++i)
        for (int r = 0; r < k_; ++r) nu_sigma_[r] += part.Z[i * k_ + r] * part.v[i];
    }
    solve_schur(nu_sigma_.data());
    double slope = sigma_gradient_ + kappa, curvature = sigma_hessian_;
    for (Part& part : parts_)
      for (int i = 0; i < part.q; ++i) {
        part.d[i] = dot(part.Z + i * k_, nu_.data(), k_) - part.u[i];
        const double bend = dot(part.Z + i * k_, nu_sigma_.data(), k_) - part.v[i];
        slope += part.v[i] * part.d[i];
        curvature += part.v[i] * bend;
      }
    dsigma_ = -slope / std::max(curvature, 1e-15 * sigma_hessian_);
    double squared = sigma_hessian_ * dsigma_ * dsigma_;
    for (Part& part : parts_) {
      for (int i = 0; i < part.q; ++i) {
        const double bend = dot(part.Z + i * k_, nu_sigma_.data(), k_) - part.v[i];
        part.d[i] += dsigma_ * bend;
        squared += part.d[i] * (part.d[i] + 2 * dsigma_ * part.v[i]);
      }
      back_substitute(part.H, part.q, part.d);
    }
    for (int r = 0; r < k_; ++r) nu_[r] += dsigma_ * nu_sigma_[r];
    return std::sqrt(std::max(squared, 0.0));
  }

  // Pivot of the k × k system relative to its diagonal, from the last step: small when W has
  // dependent rows, or when the point is extremely close to the boundary.
  double smallest_pivot() const { return smallest_pivot_; }

  // ∇Phi·d at the evaluated point.
  double slope() const {
    double sum = 0;
    for (const Part& part : parts_) sum += dot(part.g, part.d, part.q);
    return sum;
  }

  // Largest t for which the point plus t d stays inside.
  template <Barrier barrier>
  double step_limit() const {
    const double shift = barrier == Barrier::Exact ? 0 : sigma;
    const double dshift = barrier == Barrier::Exact ? 0 : dsigma_;
    double limit = kInfinity;
    auto slack = [&limit](double room, double change) {
      if (change < 0) limit = std::min(limit, -room / change);
    };
    for (const Part& part : parts_) {
      for (const Tip& tip : part.tips) {
        const double *y = part.c + tip.first, *d = part.d + tip.first;
        limit = std::min(
            limit, tip.cone.step_limit(y, d, shift * tip.cone_scale, dshift * tip.cone_scale));
        const double room = shift * tip.reach, gain = dshift * tip.reach;
        slack(tip.ceiling - y[0] + room, gain - d[0]);
        slack(y[0] - tip.floor + room, gain + d[0]);
      }
      for (int r = 0; r < part.rows; ++r) {
        const double* a = part.a + r * part.q;
        const double t = dot(a, part.c, part.q), change = dot(a, part.d, part.q);
        const double room = shift * part.scale[r], gain = dshift * part.scale[r];
        slack(part.hi[r] - t + room, gain - change);
        slack(t - part.lo[r] + room, gain + change);
      }
    }
    return limit;
  }

  // Moves to the point at which the step was computed plus t d.
  void advance(double t) {
    for (Part& part : parts_)
      for (int i = 0; i < part.q; ++i) part.c[i] += t * part.d[i];
  }
  void advance_sigma(double t) { sigma += t * dsigma_; }

  // The multipliers of W c = f for Phi itself, in the problem's rows; unused rows get zero.
  void get_multipliers(double* nu) const {
    std::fill(nu, nu + layout_.wrench_rows, 0.0);
    for (int r = 0; r < k_; ++r) nu[rows_in_use_[r]] = nu_[r] / cone_weight_;
  }

  // The dual point that a relaxed Newton step with λ < 1 defines: y = ν, and for every limit
  // z = 1/r − dr/r². Stationarity of the linearised gradient makes it dual feasible to rounding.
  // z is ordered like the rows of ForceProblem.linear_limits() before any are left out.
  void get_dual(double* y, double* z) const {
    std::fill(y, y + layout_.wrench_rows, 0.0);
    for (int r = 0; r < k_; ++r) y[rows_in_use_[r]] = nu_[r];
    const int joints = layout_.joints, n = layout_.contacts();
    double *z_hi = z, *z_lo = z_hi + joints, *z_max = z_lo + joints,
           *z_min = z_max + (layout_.ceilings ? n : 0), *z_A = z_min + (layout_.floors ? n : 0);
    std::fill(z, z_A + layout_.inequalities, 0.0);
    auto multiplier = [](double room, double change) { return (1 - change / room) / room; };
    for (const Part& part : parts_) {
      for (std::size_t i = 0; i < part.tips.size(); ++i) {
        const Tip& tip = part.tips[i];
        const int contact = part.block->contacts[i];
        const double y0 = part.c[tip.first], d0 = part.d[tip.first];
        const double room = sigma * tip.reach, gain = dsigma_ * tip.reach;
        if (layout_.ceilings) z_max[contact] = multiplier(tip.ceiling - y0 + room, gain - d0);
        if (layout_.floors) z_min[contact] = multiplier(y0 - tip.floor + room, gain + d0);
      }
      const int block_joints = static_cast<int>(part.block->joints.size());
      for (int r = 0; r < part.rows; ++r) {
        const double* a = part.a + r * part.q;
        const double t = dot(a, part.c, part.q), change = dot(a, part.d, part.q);
        const double room = sigma * part.scale[r], gain = dsigma_ * part.scale[r];
        const double above = multiplier(part.hi[r] - t + room, gain - change);
        if (r < block_joints) {
          z_hi[part.block->joints[r]] = above;
          z_lo[part.block->joints[r]] = multiplier(t - part.lo[r] + room, gain + change);
        } else {
          z_A[part.block->inequalities[r - block_joints]] = above;
        }
      }
    }
  }

 private:
  struct Tip {  // one contact inside its block
    int first;  // its first component there
    Cone cone;
    double floor, ceiling;     // of the normal force; infinite where absent
    double reach, cone_scale;  // one unit of relative violation, see violation_scales
  };

  struct Part {  // a block's numbers; the pointers lead into arena_
    const Block* block;
    int q, rows;
    std::vector<Tip> tips;
    double *Wt, *a, *lo, *hi, *scale;  // q×k, rows×q, rows each
    double *c, *d, *g, *h, *u, *v, *H, *Z;
  };

  void allot() {
    parts_.clear();
    std::size_t total = 0;
    const std::size_t k = layout_.wrench_rows;
    for (const Block& block : structure_.blocks()) {
      const std::size_t q = block.components.size();
      const std::size_t rows = block.joints.size() + block.inequalities.size();
      total += 2 * q * k + rows * (q + 3) + 6 * q + q * q;
    }
    arena_.assign(total, 0.0);
    double* next = arena_.data();
    auto take = [&next](std::size_t count) {
      double* here = next;
      next += count;
      return here;
    };
    for (const Block& block : structure_.blocks()) {
      Part part;
      part.block = &block;
      const std::size_t q = block.components.size();
      const std::size_t rows = block.joints.size() + block.inequalities.size();
      part.q = static_cast<int>(q);
      part.rows = static_cast<int>(rows);
      int first = 0;
      for (int contact : block.contacts) {
        part.tips.push_back({first, {structure_.dim(contact), 1, 1}, -kInfinity, kInfinity, 1, 1});
        first += structure_.dim(contact);
      }
      part.Wt = take(q * k);
      part.a = take(rows * q);
      part.lo = take(rows);
      part.hi = take(rows);
      part.scale = take(rows);
      part.c = take(q);
      part.d = take(q);
      part.g = take(q);
      part.h = take(q);
      part.u = take(q);
      part.v = take(q);
      part.H = take(q * q);
      part.Z = take(q * k);
      parts_.push_back(std::move(part));
    }
  }

  void use_all_rows() {
    k_ = layout_.wrench_rows;
    for (int r = 0; r < k_; ++r) rows_in_use_[r] = r;
  }

  void load_wrench_rows(const Problem& p, Part& part) {
    const int m = layout_.components();
    for (int i = 0; i < part.q; ++i)
      for (int r = 0; r < k_; ++r)
        part.Wt[i * k_ + r] = p.W[rows_in_use_[r] * m + part.block->components[i]];
  }

  void load_block(const Problem& p, Part& part) {
    const Block& block = *part.block;
    load_wrench_rows(p, part);
    int r = 0;
    for (int joint : block.joints) {
      double* a = part.a + r * part.q;
      for (int i = 0; i < part.q; ++i) a[i] = p.J[block.components[i] * layout_.joints + joint];
      part.lo[r] = p.tau_lo[joint] - p.tau_bias[joint];
      part.hi[r] = p.tau_hi[joint] - p.tau_bias[joint];
      part.scale[r] = 0.5 * (p.tau_hi[joint] - p.tau_lo[joint]);
      ++r;
    }
    for (int row : block.inequalities) {
      double* a = part.a + r * part.q;
      for (int i = 0; i < part.q; ++i) a[i] = p.A[row * layout_.components() + block.components[i]];
      part.lo[r] = -kInfinity;
      part.hi[r] = p.b[row];
      ++r;
    }
    for (std::size_t i = 0; i < part.tips.size(); ++i) {
      Tip& tip = part.tips[i];
      const int contact = block.contacts[i];
      tip.cone.mu = p.mu[contact];
      tip.cone.torsion = p.mu[contact] / p.gamma[contact];
      const double share = p.engagement[contact];
      tip.ceiling = layout_.ceilings ? share * p.c_max[contact] : kInfinity;
      tip.floor = layout_.floors ? share * p.c_min[contact] : -kInfinity;
    }
    scale_violations(part);
  }

  // What one unit of relative violation means; the definition is reference.violation_scales.
  void scale_violations(Part& part) {
    const int torque_rows = static_cast<int>(part.block->joints.size());
    for (Tip& tip : part.tips) {
      tip.reach = tip.ceiling;
      for (int r = 0; r < torque_rows; ++r) {
        const double lever = std::abs(part.a[r * part.q + tip.first]);
        if (lever > 0) tip.reach = std::min(tip.reach, 2 * part.scale[r] / lever);
      }
    }
  }

  // Completes the violation scales once all blocks are loaded: contacts whose reach nothing
  // limits take the largest reach of the others, or else the size of f.
  void finish_scales() {
    double known = 0, wrench = 0;
    for (const Part& part : parts_)
      for (const Tip& tip : part.tips)
        if (tip.reach < kInfinity) known = std::max(known, tip.reach);
    for (int r = 0; r < k_ && known == 0; ++r) wrench = std::max(wrench, std::abs(f_[r]));
    const double fallback = known > 0 ? known : wrench > 0 ? wrench : 1;
    for (Part& part : parts_) {
      for (Tip& tip : part.tips) {
        if (!(tip.reach < kInfinity)) tip.reach = fallback;
        tip.cone_scale = tip.cone.mu * tip.reach;
      }
      for (int r = static_cast<int>(part.block->joints.size()); r < part.rows; ++r) {
        double own = 0;
        for (const Tip& tip : part.tips)
          for (int i = 0; i < tip.cone.dim; ++i)
            own += std::abs(part.a[r * part.q + tip.first + i]) * tip.reach;
        part.scale[r] = own > 0 ? own : std::max(std::abs(part.hi[r]), fallback);
      }
    }
  }

  template <Barrier barrier>
  bool add_tip(Part& part, const Tip& tip, double shift, double cone, double limit) {
    const double* y = part.c + tip.first;
    double gradient[4] = {}, hessian[16] = {};
    if (!tip.cone.add_derivatives(y, shift * tip.cone_scale, cone, gradient, hessian, 4))
      return false;
    if (barrier == Barrier::Relaxed) {
      // The cone sees mu n + scale σ: a derivative in σ is one in n, times scale/mu.
      const double ratio = tip.cone_scale / tip.cone.mu;
      for (int i = 0; i < tip.cone.dim; ++i) part.h[tip.first + i] += ratio * hessian[i * 4];
      sigma_gradient_ += ratio * gradient[0];
      sigma_hessian_ += ratio * ratio * hessian[0];
    }
    const double room = shift * tip.reach;
    const double above = tip.ceiling - y[0] + room, below = y[0] - tip.floor + room;
    if (!(above > 0) || !(below > 0)) return false;
    const double up = 1 / above, down = 1 / below;
    gradient[0] += limit * (up - down);
    hessian[0] += limit * (up * up + down * down);
    if (barrier == Barrier::Relaxed) add_slack_terms(part.h[tip.first], tip.reach, up, down);
    for (int i = 0; i < tip.cone.dim; ++i) {
      part.g[tip.first + i] += gradient[i];
      for (int j = 0; j <= i; ++j)
        part.H[(tip.first + i) * part.q + tip.first + j] += hessian[i * 4 + j];
    }
    return true;
  }

  template <Barrier barrier>
  bool add_row(Part& part, int r, double shift, double limit) {
    const int q = part.q;
    const double* a = part.a + r * q;
    const double t = dot(a, part.c, q), room = shift * part.scale[r];
    const double above = part.hi[r] - t + room, below = t - part.lo[r] + room;
    if (!(above > 0) || !(below > 0)) return false;
    const double up = 1 / above, down = 1 / below;
    const double first = limit * (up - down), second = limit * (up * up + down * down);
    double mixed = 0;
    if (barrier == Barrier::Relaxed) add_slack_terms(mixed, part.scale[r], up, down);
    for (int i = 0; i < q; ++i) {
      part.g[i] += first * a[i];
      if (barrier == Barrier::Relaxed) part.h[i] += mixed * a[i];
      const double scaled = second * a[i];
      if (scaled == 0) continue;
      for (int j = 0; j <= i; ++j) part.H[i * q + j] += scaled * a[j];
    }
    return true;
  }

  // Derivatives that involve σ of −ln(above) − ln(below), both of which grow by scale·σ.
  void add_slack_terms(double& mixed, double scale, double up, double down) {
    mixed += scale * (down * down - up * up);
    sigma_gradient_ -= scale * (up + down);
    sigma_hessian_ += scale * scale * (up * up + down * down);
  }

  void clear_schur() { std::fill(S_.begin(), S_.end(), 0.0); }

  void add_outer(const double* Z, int q) {  // S += Zᵀ Z, lower triangle
    for (int i = 0; i < q; ++i) {
      const double* z = Z + i * k_;
      for (int r = 0; r < k_; ++r)
        for (int s = 0; s <= r; ++s) S_[r * k_ + s] += z[r] * z[s];
    }
  }

  void solve_schur(double* x) const {
    forward_substitute(S_.data(), k_, x);
    back_substitute(S_.data(), k_, x);
  }

  // Factors every block and the k × k system, and solves it for ν.
  void solve_blocks() {
    clear_schur();
    std::copy(f_.begin(), f_.begin() + k_, nu_.begin());
    for (Part& part : parts_) {
      cholesky(part.H, part.q);
      std::copy(part.Wt, part.Wt + part.q * k_, part.Z);
      std::copy(part.g, part.g + part.q, part.u);
      forward_substitute(part.H, part.q, part.Z, k_);
      forward_substitute(part.H, part.q, part.u);
      add_outer(part.Z, part.q);
      for (int i = 0; i < part.q; ++i) {
        const double *w = part.Wt + i * k_, *z = part.Z + i * k_;
        for (int r = 0; r < k_; ++r) nu_[r] += z[r] * part.u[i] - w[r] * part.c[i];
      }
    }
    smallest_pivot_ = cholesky(S_.data(), k_);
    solve_schur(nu_.data());
  }

  const Layout& layout_;
  Structure structure_;
  int k_;
  std::vector<int> rows_in_use_;
  std::vector<Part> parts_;
  std::vector<double> arena_;
  std::vector<double> f_, S_, nu_, nu_sigma_;
  double cone_weight_ = 1, limit_weight_ = 1;
  double sigma_gradient_ = 0, sigma_hessian_ = 0, dsigma_ = 0, smallest_pivot_ = 1;
};

}  // namespace graspforce
