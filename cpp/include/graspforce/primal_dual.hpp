// The primal–dual method: for the problems on which Newton's method on Phi alone is lost or slow.
//
// Next to the point c it carries multipliers z of the limits and y of W c = f, and aims at slacks
// s with s·z = w, a limit's weight in Phi (det-wise for the cones). Its step is Newton's with z/s
// in the place of w/s² (Nesterov–Todd scaling P s = z for the cones), which follows a curved cone
// along its boundary where Newton's own step is confined to a small ball. Two uses:
//
// `find_inside` is Phase 1 (Section III-C.5). One slack σ relaxes every limit by its own scale:
//     min σ   s.t.  W c = f,   s = b − A c + σ·scale ≥ 0,   (mu n + σ·scale, w t) in its cone.
// The point stays strictly feasible throughout. y·f − z·b bounds σ from below once the multipliers
// are dual feasible; when that is above zero they prove the grasp infeasible.
//
// `follow` then takes the weights of Phi themselves as the target and leads to where Newton's
// method on Phi converges quadratically.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/blocks.hpp"
#include "graspforce/budget.hpp"
#include "graspforce/certificate.hpp"
#include "graspforce/schur.hpp"

namespace graspforce {

struct PhaseOneResult {
  enum class End {
    Inside,      // strictly inside, well away from the boundary as far as there is room
    Infeasible,  // proved; the point violates the limits least
    Closest,     // σ's bounds agree on zero to rounding: no verdict
    Steps,
    Overflow,
  } end = End::Steps;
  double violation = 0;  // σ
};

class PrimalDual {
 public:
  explicit PrimalDual(const Blocks& blocks)
      : blocks_(blocks),
        sides_(2 * std::size_t(blocks.layout().joints + blocks.layout().inequalities +
                               blocks.layout().contacts())),
        cones_(blocks.layout().contacts()),
        arena_(blocks.layout().components() *
               (7 + largest_block(blocks.layout()) + blocks.layout().wrench_rows)),
        schur_(blocks.layout().wrench_rows),
        nu_(blocks.layout().wrench_rows),
        aim_(nu_),
        center_(nu_),
        bend_(nu_) {
    work_.reserve(blocks.layout().contacts());
  }

  // Makes the vectors that are kept by block; needed after Blocks::allot. Does not allocate.
  void allot() {
    const std::size_t k = blocks_.layout().wrench_rows;
    std::size_t total = 0;
    for (const Part& part : blocks_.parts()) total += part.q * (7 + part.q + k);
    arena_.reset(total);
    work_.clear();
    Side* sides = sides_.data();
    Lifted* cones = cones_.data();
    for (const Part& part : blocks_.parts()) {
      const std::size_t q = part.q;
      Work w;
      for (double** vector : {&w.c, &w.d, &w.g, &w.h, &w.u, &w.v, &w.x}) *vector = arena_.take(q);
      w.H = arena_.take(q * q);
      w.Z = arena_.take(q * k);
      w.hi = sides;
      w.lo = sides + part.rows;
      sides += 2 * part.rows;
      w.cones = cones;
      cones += part.tips.size();
      std::fill(w.hi, sides, Side{});
      work_.push_back(w);
    }
  }

  PhaseOneResult find_inside(const Problem& problem, Budget& budget, std::vector<double>& y,
                             std::vector<double>& z) {
    relax();
    PhaseOneResult result;
    bool proved = false, promising = false;
    for (bool first = true; budget.take(); first = false) {
      const double mu = complementarity();
      evaluate();
      factor();
      // The step is affine in the target τ of the complementarity: aim at τ = 0, see how far that
      // gets, and centre the more the less it does. Multipliers that promise a proof are centred
      // fully: such a step is taken whole, and a whole step leaves no dual residual.
      double centering = 1;
      if (!promising) {
        direction(0);
        const double lag = 1 - std::min(1.0, step_limit());
        centering = std::max(kLeastCentering, lag * lag * lag);
      }
      direction(centering * mu);
      const double step = std::min(1.0, 0.99 * step_limit());
      if (!std::isfinite(dsigma_) || step < kLeastStep || !advance(step)) {
        // Rounding has the upper hand.
        result.end = proved  ? PhaseOneResult::End::Infeasible
                     : first ? PhaseOneResult::End::Overflow
                             : PhaseOneResult::End::Closest;
        break;
      }

      const double bound = dual_bound();
      if (sigma_ < 0 && balanced() && (sigma_ < 0.5 * bound || sigma_ < -kRoomy)) {
        result.end = PhaseOneResult::End::Inside;
        return result;
      }
      if (!proved && bound > 0) {
        get_dual(y.data(), z.data());
        proved = proves_infeasible(blocks_.layout(), problem, y.data(), z.data());
      }
      promising = !proved && bound > 0 && !promising;
      const double gap = complementarity() * degree_;
      if (gap < kClosest || (proved && std::min(gap, sigma_ - bound) < kLeast * sigma_)) {
        result.end = proved ? PhaseOneResult::End::Infeasible : PhaseOneResult::End::Closest;
        break;
      }
    }
    result.violation = std::max(0.0, sigma_);
    restore_wrench();
    return result;
  }

  // Leads from the point that find_inside reached to the minimum of Phi. It sets out with all
  // weights equal, as the point was found, and lets the lighter ones down to their own as fast as
  // the steps allow: a target far off centre would only be crept to.
  void follow(double cone_weight, double limit_weight, Budget& budget) {
    sigma_ = dsigma_ = 0;
    relaxed_ = false;
    cone_weight_ = limit_weight_ = std::max(cone_weight, limit_weight);
    update_slacks();
    aim_at_center(1);
    bool feasible = false;  // y and z balance: true for good after a whole step
    for (;;) {
      const bool there = cone_weight_ == cone_weight && limit_weight_ == limit_weight;
      if (there && feasible && distance_to_target() < kClose) return;
      if (!budget.take()) return;
      evaluate();
      factor();
      direction(1);
      const double step = std::min(1.0, 0.99 * step_limit());
      if (!(step > kLeastStep) || !advance(step)) return;
      feasible = feasible || step == 1;
      const double descent = step > 0.9 ? kDescent : step > 0.5 ? std::sqrt(kDescent) : 1;
      cone_weight_ = std::max(cone_weight, descent * cone_weight_);
      limit_weight_ = std::max(limit_weight, descent * limit_weight_);
    }
  }

  // The force reached, in the problem's order; contacts out of the grasp get zero.
  void get_forces(double* c) const {
    std::fill(c, c + blocks_.layout().components(), 0.0);
    for (std::size_t b = 0; b < work_.size(); ++b)
      for (int i = 0; i < part(b).q; ++i) c[part(b).block->components[i]] = work_[b].c[i];
  }

 private:
  static constexpr double kLeastCentering = 1e-3;
  static constexpr double kRoomy = 0.1;   // a relative slack with which Newton starts well
  static constexpr double kLeast = 1e-6;  // relative accuracy of the least violation
  static constexpr double kClosest = 1e-13;
  static constexpr double kLeastStep = 1e-6;
  static constexpr double kDescent = 0.1;  // of a weight on its way down, after a good step
  static constexpr double kClose = 1e-2;   // squared distance to the target for Newton to take over

  struct Side {  // one side of a row: slack, multiplier, their steps
    double s = 0, z = 0, ds = 0, dz = 0;
  };
  struct Lifted {  // a contact's cone in Lorentz coordinates
    double s[4], z[4], ds[4], dz[4], P[16];
  };
  struct Work {
    double *c, *d, *g, *h, *u, *v;  // q: point, step, barrier gradient, σ column, L⁻¹ of both
    double* x;                      // q: the part of the step that σ multiplies
    double *H, *Z;                  // q × q, then its factor; q × k
    Side *hi, *lo;                  // rows
    Lifted* cones;                  // tips
  };

  const Part& part(std::size_t b) const { return blocks_.parts()[b]; }

  // Every slack, multiplier and cone of the problem in turn.
  template <class Row, class Tips>
  void for_each(Row row, Tips tips) {
    for (std::size_t b = 0; b < work_.size(); ++b) {
      for (int r = 0; r < part(b).rows; ++r) {
        if (part(b).hi[r] < kInfinity) row(b, r, work_[b].hi[r], 1.0);
        if (part(b).lo[r] > -kInfinity) row(b, r, work_[b].lo[r], -1.0);
      }
      for (int i = 0; i < part(b).tips.size(); ++i) tips(b, part(b).tips[i], work_[b].cones[i]);
    }
  }

  // c = W⁺ f (Eq. 17), σ large enough to admit it, multipliers such that Σ scale·z = 1.
  void relax() {
    relaxed_ = true;
    cone_weight_ = limit_weight_ = 1;
    for (std::size_t b = 0; b < work_.size(); ++b) std::fill_n(work_[b].c, part(b).q, 0.0);
    restore_wrench();
    sigma_ = 0;
    update_slacks();
    double least = -kInfinity;
    degree_ = 0;
    for_each(
        [&](std::size_t b, int r, Side& side, double) {
          least = std::max(least, -side.s / part(b).scale[r]);
          degree_ += 1;
        },
        [&](std::size_t, const Tip& tip, Lifted& cone) {
          const double margin = cone.s[0] - lorentz::radius(cone.s, tip.cone.dim);
          least = std::max(least, -margin / tip.cone_scale);
          degree_ += 2;
        });
    sigma_ = 1.2 * std::max(0.0, least) + 0.1;
    update_slacks();
    aim_at_center(1);
    double weight = 0;
    for_each(
        [&](std::size_t b, int r, Side& side, double) { weight += part(b).scale[r] * side.z; },
        [&](std::size_t, const Tip& tip, Lifted& cone) { weight += tip.cone_scale * cone.z[0]; });
    aim_at_center(1 / weight);
    std::fill(nu_.begin(), nu_.end(), 0.0);
  }

  // The multipliers whose products with the slacks are τ times the weights.
  void aim_at_center(double tau) {
    for_each([&](std::size_t, int, Side& side, double) { side.z = tau * limit_weight_ / side.s; },
             [&](std::size_t, const Tip& tip, Lifted& cone) {
               const double twice =
                   2 * tau * cone_weight_ / lorentz::determinant(cone.s, tip.cone.dim);
               for (int i = 0; i < tip.cone.dim; ++i)
                 cone.z[i] = (i == 0 ? twice : -twice) * cone.s[i];
             });
  }

  // Squared distance of the products s·z from the weights, in the scaled coordinates: what the
  // barrier's centrality measures.
  double distance_to_target() {
    double sum = 0;
    for_each(
        [&](std::size_t, int, Side& side, double) {
          const double product = side.s * side.z, off = limit_weight_ - product;
          sum += off * off / product;
        },
        [&](std::size_t, const Tip& tip, Lifted& cone) {
          // ‖2w/λ − λ‖² for the scaled point λ with λ·λ = s·z and det λ = √(det s·det z).
          const int dim = tip.cone.dim;
          const double det =
              std::sqrt(lorentz::determinant(cone.s, dim) * lorentz::determinant(cone.z, dim));
          const double product = dot(cone.s, cone.z, dim), w = cone_weight_;
          sum += product + 4 * w * w * product / (det * det) - 4 * w;
        });
    return sum;
  }

  // Slacks follow exactly from (c, σ): the point stays feasible to the last digit.
  void update_slacks() {
    for_each(
        [&](std::size_t b, int r, Side& side, double sign) {
          const double t = dot(part(b).a + r * part(b).q, work_[b].c, part(b).q);
          const double room = sign > 0 ? part(b).hi[r] - t : t - part(b).lo[r];
          side.s = room + sigma_ * part(b).scale[r];
        },
        [&](std::size_t b, const Tip& tip, Lifted& cone) {
          tip.cone.lift(work_[b].c + tip.first, cone.s);
          cone.s[0] += sigma_ * tip.cone_scale;
        });
  }

  // Removes what rounding has left of f − W c by the least change of the forces.
  void restore_wrench() {
    const int k = blocks_.k();
    std::copy(blocks_.f(), blocks_.f() + k, aim_.begin());
    schur_.clear(k);
    for (std::size_t b = 0; b < work_.size(); ++b) {
      schur_.add(part(b).Wt, part(b).q);
      for (int i = 0; i < part(b).q; ++i)
        for (int r = 0; r < k; ++r) aim_[r] -= part(b).Wt[i * k + r] * work_[b].c[i];
    }
    schur_.factor();
    schur_.solve(aim_.data());
    for (std::size_t b = 0; b < work_.size(); ++b)
      for (int i = 0; i < part(b).q; ++i) work_[b].c[i] += dot(part(b).Wt + i * k, aim_.data(), k);
  }

  double complementarity() {
    double sum = 0;
    for_each([&](std::size_t, int, Side& side, double) { sum += side.s * side.z; },
             [&](std::size_t, const Tip& tip, Lifted& cone) {
               sum += dot(cone.s, cone.z, tip.cone.dim);
             });
    return sum / degree_;
  }

  // Scaled Hessian, σ column, and the gradient of the relaxed barrier.
  void evaluate() {
    sigma_gradient_ = sigma_hessian_ = 0;
    for (const Work& w : work_) {
      const int q = static_cast<int>(w.d - w.c);
      std::fill(w.g, w.g + q, 0.0);
      std::fill(w.h, w.h + q, 0.0);
      std::fill(w.H, w.H + q * q, 0.0);
    }
    for_each(
        [&](std::size_t b, int r, Side& side, double sign) {
          const double inverse = 1 / side.s, weight = side.z * inverse, scale = part(b).scale[r];
          const double* a = part(b).a + r * part(b).q;
          add_scaled(sign * limit_weight_ * inverse, a, part(b).q, work_[b].g);
          add_outer(a, part(b).q, weight, work_[b].H);
          for (int i = 0; i < part(b).q; ++i) work_[b].h[i] -= sign * weight * scale * a[i];
          sigma_gradient_ -= scale * limit_weight_ * inverse;
          sigma_hessian_ += scale * scale * weight;
        },
        [&](std::size_t b, const Tip& tip, Lifted& cone) {
          const int dim = tip.cone.dim, q = part(b).q;
          lorentz::scaling(cone.s, cone.z, dim, cone.P);
          const double twice = 2 * cone_weight_ / lorentz::determinant(cone.s, dim);
          double *g = work_[b].g + tip.first, *h = work_[b].h + tip.first;
          double* H = work_[b].H + tip.first * (q + 1);
          for (int i = 0; i < dim; ++i) {
            const double weight = tip.cone.weight(i);
            g[i] += weight * twice * (i == 0 ? -cone.s[i] : cone.s[i]);
            h[i] += weight * cone.P[i] * tip.cone_scale;
            for (int j = 0; j <= i; ++j)
              H[i * q + j] += weight * tip.cone.weight(j) * cone.P[i * dim + j];
          }
          sigma_gradient_ -= tip.cone_scale * twice * cone.s[0];
          sigma_hessian_ += tip.cone_scale * tip.cone_scale * cone.P[0];
        });
  }

  // Factors the blocks and the k × k system, and prepares the three right-hand sides: `aim_` for
  // f − W c, `center_` for the barrier's gradient, `bend_` for the σ column.
  void factor() {
    const int k = blocks_.k();
    schur_.clear(k);
    std::copy(blocks_.f(), blocks_.f() + k, aim_.begin());
    std::fill(center_.begin(), center_.end(), 0.0);
    std::fill(bend_.begin(), bend_.end(), 0.0);
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const Work& w = work_[b];
      const int q = part(b).q;
      cholesky(w.H, q);
      std::copy(part(b).Wt, part(b).Wt + q * k, w.Z);
      std::copy(w.g, w.g + q, w.u);
      std::copy(w.h, w.h + q, w.v);
      forward_substitute(w.H, q, w.Z, k);
      forward_substitute(w.H, q, w.u);
      forward_substitute(w.H, q, w.v);
      schur_.add(w.Z, q);
      for (int i = 0; i < q; ++i)
        for (int r = 0; r < k; ++r) {
          aim_[r] -= part(b).Wt[i * k + r] * w.c[i];
          center_[r] += w.Z[i * k + r] * w.u[i];
          bend_[r] += w.Z[i * k + r] * w.v[i];
        }
    }
    schur_.factor();
    schur_.solve(aim_.data());
    schur_.solve(center_.data());
    schur_.solve(bend_.data());
    // In L's coordinates the step is Z(aim + τ center) − τ u + dσ (Z bend − v).
    curvature_ = sigma_hessian_;
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const Work& w = work_[b];
      for (int i = 0; i < part(b).q; ++i) {
        w.x[i] = dot(w.Z + i * k, bend_.data(), k) - w.v[i];
        curvature_ += w.v[i] * w.x[i];
      }
    }
    curvature_ = std::max(curvature_, 1e-15 * sigma_hessian_);
  }

  // The step towards complementarity τ, with the multipliers it leads to in nu_next_.
  void direction(double tau) {
    const int k = blocks_.k();
    double slope = 1 + tau * sigma_gradient_;
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const Work& w = work_[b];
      for (int i = 0; i < part(b).q; ++i) {
        const double* z = w.Z + i * k;
        w.d[i] = dot(z, aim_.data(), k) + tau * (dot(z, center_.data(), k) - w.u[i]);
        slope += w.v[i] * w.d[i];
      }
    }
    dsigma_ = relaxed_ ? -slope / curvature_ : 0;
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const Work& w = work_[b];
      for (int i = 0; i < part(b).q; ++i) w.d[i] += dsigma_ * w.x[i];
      back_substitute(w.H, part(b).q, w.d);
    }
    tau_ = tau;
    for_each(
        [&](std::size_t b, int r, Side& side, double sign) {
          const double change = dot(part(b).a + r * part(b).q, work_[b].d, part(b).q);
          side.ds = dsigma_ * part(b).scale[r] - sign * change;
          side.dz = (tau * limit_weight_ - side.z * side.ds) / side.s - side.z;
        },
        [&](std::size_t b, const Tip& tip, Lifted& cone) {
          const int dim = tip.cone.dim;
          tip.cone.lift(work_[b].d + tip.first, cone.ds);
          cone.ds[0] += dsigma_ * tip.cone_scale;
          const double twice = 2 * tau * cone_weight_ / lorentz::determinant(cone.s, dim);
          for (int i = 0; i < dim; ++i)
            cone.dz[i] = (i == 0 ? twice : -twice) * cone.s[i] - cone.z[i] -
                         dot(cone.P + i * dim, cone.ds, dim);
        });
  }

  double step_limit() {
    double limit = kInfinity;
    auto bound = [&limit](double value, double change) {
      if (change < 0) limit = std::min(limit, -value / change);
    };
    for_each(
        [&](std::size_t, int, Side& side, double) {
          bound(side.s, side.ds);
          bound(side.z, side.dz);
        },
        [&](std::size_t, const Tip& tip, Lifted& cone) {
          limit = std::min(limit, lorentz::step_limit(cone.s, cone.ds, tip.cone.dim));
          limit = std::min(limit, lorentz::step_limit(cone.z, cone.dz, tip.cone.dim));
        });
    return limit;
  }

  // False when rounding has put a slack or a multiplier on its boundary.
  bool advance(double step) {
    for (std::size_t b = 0; b < work_.size(); ++b)
      for (int i = 0; i < part(b).q; ++i) work_[b].c[i] += step * work_[b].d[i];
    sigma_ += step * dsigma_;
    for (int r = 0; r < blocks_.k(); ++r)
      nu_[r] += step * (aim_[r] + tau_ * center_[r] + dsigma_ * bend_[r] - nu_[r]);
    for_each([&](std::size_t, int, Side& side, double) { side.z += step * side.dz; },
             [&](std::size_t, const Tip& tip, Lifted& cone) {
               for (int i = 0; i < tip.cone.dim; ++i) cone.z[i] += step * cone.dz[i];
             });
    update_slacks();
    bool inside = true;
    for_each([&](std::size_t, int, Side& side, double) { inside &= side.s > 0 && side.z > 0; },
             [&](std::size_t, const Tip& tip, Lifted& cone) {
               const int dim = tip.cone.dim;
               inside &= lorentz::inside(cone.s, dim) && lorentz::inside(cone.z, dim);
             });
    return inside;
  }

  // y·f − z·b: a lower bound on σ once the multipliers are dual feasible.
  double dual_bound() {
    double bound = dot(nu_.data(), blocks_.f(), blocks_.k());
    for_each([&](std::size_t b, int r, Side& side,
                 double sign) { bound -= side.z * (sign > 0 ? part(b).hi[r] : -part(b).lo[r]); },
             [](std::size_t, const Tip&, Lifted&) {});
    return bound;
  }

  // The multipliers as a certificate. What still keeps e = Aᵀz − Wᵀy out of a contact's dual cone
  // is pushed back by raising the multipliers of the rows that add up to the missing normal force.
  void get_dual(double* y, double* z) {
    std::fill(y, y + blocks_.layout().wrench_rows, 0.0);
    for (int r = 0; r < blocks_.k(); ++r) y[blocks_.row(r)] = nu_[r];
    std::fill(z, z + limit_count(blocks_.layout()), 0.0);
    for_each([&](std::size_t b, int r, Side& side, double sign) { z[limit(b, r, sign)] = side.z; },
             [](std::size_t, const Tip&, Lifted&) {});
    for (std::size_t b = 0; b < work_.size(); ++b) {
      const Work& w = work_[b];  // g and u serve as scratch here
      const int q = part(b).q;
      std::fill(w.u, w.u + q, 0.0);
      bool outside = false;
      for (int i = 0; i < q; ++i) {
        w.g[i] = -dot(part(b).Wt + i * blocks_.k(), nu_.data(), blocks_.k());
        for (int r = 0; r < part(b).rows; ++r)
          w.g[i] += part(b).a[r * q + i] * (w.hi[r].z - w.lo[r].z);
      }
      for (const Tip& tip : part(b).tips) {
        const double margin = tip.cone.dual_margin(w.g + tip.first);
        const double safe = 1e-12 * std::abs(w.g[tip.first]);
        if (margin < safe) {
          w.u[tip.first] = 2 * (safe - margin);
          outside = true;
        }
      }
      if (!outside) continue;
      std::fill(w.H, w.H + q * q, 0.0);
      double size = 0;
      for (int r = 0; r < part(b).rows; ++r) {
        add_outer(part(b).a + r * q, q, 1, w.H);
        size += dot(part(b).a + r * q, part(b).a + r * q, q);
      }
      for (int i = 0; i < q; ++i) w.H[i * (q + 1)] += 1e-13 * size;  // rows may be too few
      cholesky(w.H, q);
      forward_substitute(w.H, q, w.u);
      back_substitute(w.H, q, w.u);
      for (int r = 0; r < part(b).rows; ++r) {
        const double more = dot(part(b).a + r * q, w.u, q);
        const double sign = more > 0 ? 1 : -1;
        const bool there = (more > 0 ? part(b).hi[r] : -part(b).lo[r]) < kInfinity;
        if (there) z[limit(b, r, sign)] += std::abs(more);
      }
    }
  }

  int limit(std::size_t b, int r, double sign) const {
    const auto [above, below] = blocks_.limit_indices(part(b), r);
    return sign > 0 ? above : below;
  }

  bool balanced() const {
    return relative_wrench_error(blocks_, [this](std::size_t b) { return work_[b].c; }) < 1e-9;
  }

  const Blocks& blocks_;
  std::vector<Work> work_;
  std::vector<Side> sides_;
  std::vector<Lifted> cones_;
  Arena arena_;
  Schur schur_;
  std::vector<double> nu_, aim_, center_, bend_;
  bool relaxed_ = true;
  double cone_weight_ = 1, limit_weight_ = 1;
  double sigma_ = 0, dsigma_ = 0, tau_ = 0, degree_ = 0;
  double sigma_gradient_ = 0, sigma_hessian_ = 0, curvature_ = 0;
};

}  // namespace graspforce
