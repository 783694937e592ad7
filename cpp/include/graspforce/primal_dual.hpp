// The primal–dual method: for the problems on which Newton's method on Phi alone fails or is slow.
//
// Next to the point c it carries multipliers z of the limits and y of W c = f, and aims at slacks
// s with s·z = w, a limit's weight in Phi (det-wise for the cones). Its step is Newton's with z/s
// in the place of w/s² (Nesterov–Todd scaling V² s = z for the cones), which follows a curved cone
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
#include <utility>
#include <vector>

#include "graspforce/block_point.hpp"
#include "graspforce/budget.hpp"
#include "graspforce/certificate.hpp"
#include "graspforce/least_squares.hpp"

namespace graspforce {

struct PhaseOneResult {
  enum class End {
    Inside,      // strictly inside, well away from the boundary as far as there is room
    Infeasible,  // proved; the point violates the limits least
    Closest,     // σ's bounds agree on zero to rounding: no verdict
    Steps,
    Overflow,
  } end = End::Steps;
  double violation = 0;   // σ; below zero inside
  bool balanced = false;  // the point makes the wrench
};

class PrimalDual : public BlockPoint {
 public:
  PrimalDual(const Blocks& blocks, LeastSquares& least_squares)
      : BlockPoint(blocks),
        least_squares_(least_squares),
        sides_(2 * most_rows(blocks.layout())),
        cones_(blocks.layout().contacts()),
        arena_(largest_block(blocks.layout()) * (largest_block(blocks.layout()) + 2)),
        nu_(blocks.layout().wrench_rows),
        next_nu_(nu_),
        proof_y_(nu_),
        proof_z_(limit_count(blocks.layout())),
        best_(c_) {
    work_.reserve(most_blocks(blocks.layout()));
  }

  // Deals slacks and multipliers out to the blocks; needed after Blocks::allot. Does not allocate.
  void allot() {
    BlockPoint::allot();
    work_.clear();
    Side* sides = sides_.data();
    Lifted* cones = cones_.data();
    for (const BlockData& part : blocks_.parts()) {
      work_.push_back({sides, sides + part.rows, cones});
      sides += 2 * part.rows;
      cones += part.tips.size();
    }
    std::fill(sides_.data(), sides, Side{});
  }

  PhaseOneResult find_inside(const Problem& problem, Budget& budget, std::vector<double>& y,
                             std::vector<double>& z) {
    relax();
    PhaseOneResult result;
    bool proved = false, promising = false;
    for (bool first = true; budget.take(); first = false) {
      const double mu = complementarity();
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
        // Rounding dominates.
        result.end = proved  ? PhaseOneResult::End::Infeasible
                     : first ? PhaseOneResult::End::Overflow
                             : PhaseOneResult::End::Closest;
        break;
      }
      keep_best();

      const double bound = dual_bound(), gap = complementarity() * degree_;
      // Where the bound is lost in the rounding of large multipliers the gap still tells.
      const bool deep =
          sigma_ < 0.5 * bound || sigma_ < -kInteriorDepth || (sigma_ < -kShallow && gap < -sigma_);
      if (sigma_ < 0 && deep && balanced()) {
        result.end = PhaseOneResult::End::Inside;
        result.violation = sigma_;
        return result;
      }
      if (!proved && bound > 0) proved = prove(problem, y, z);
      promising = !proved && bound > 0 && !promising;
      if (gap < kClosest || (proved && std::max(gap, sigma_ - bound) < kLeast * sigma_)) {
        result.end = proved ? PhaseOneResult::End::Infeasible : PhaseOneResult::End::Closest;
        break;
      }
    }
    if (proved) prove(problem, y, z);  // the last multipliers bound σ best
    if (least_violation_ < kInfinity)
      c_ = best_;
    else
      restore_wrench();
    result.violation = std::max(0.0, violation());
    result.balanced = balanced();
    return result;
  }

  // Leads from the point that find_inside reached, with no row exact, to the forces whose wrench is
  // nearest to f: the slacks s of the softened rows, of which f has the size 1, then cost ½ s², and
  // the weights, in the given ratio, go down until they no longer count. Of all forces that make
  // that wrench these are the ones that the weights would choose. False, at the best point inside,
  // where the budget runs out or rounding stops it.
  bool approach(double cone_weight, double limit_weight, Budget& budget) {
    sigma_ = dsigma_ = 0;
    relaxed_ = false;
    slack_weight_ = 1;
    own_cone_weight_ = cone_weight;
    own_limit_weight_ = limit_weight;
    settle();
    auto [least, most] = own_weights();
    level_ = std::max(slack_cost(), 1.0);
    for (double* weight : {&own_cone_weight_, &own_limit_weight_, &least}) *weight *= level_ / most;
    update_slacks();
    aim_at_center(1);
    double unbalanced = 1;  // share of what y and z lacked at first of being dual feasible
    for (;;) {
      const double gap = degree_ * complementarity();
      const bool in_ratio = level_ <= least, known = in_ratio && unbalanced < kBalance;
      if (known && near(gap, kNearest)) return true;
      if (!budget.take()) return false;
      best_ = c_;
      factor();
      direction(1);
      const double step = std::min(1.0, 0.99 * step_limit());
      if (!(step > kLeastStep) || !advance(step)) {
        c_ = best_;
        return known && near(gap, kNearly);
      }
      unbalanced *= 1 - step;
      const double descent = step > 0.9 ? kDescent : step > 0.5 ? std::sqrt(kDescent) : 1;
      for (double* weight : {&own_cone_weight_, &own_limit_weight_, &least})
        if (in_ratio) *weight *= descent;
      level_ *= descent;
    }
  }

  // Leads from the point that find_inside reached to the minimum of Phi. It sets out with all
  // weights equal, as the point was found, and lets their common level down, each to its own, as
  // fast as the steps allow: a target far off centre would only be crept to.
  void follow(double cone_weight, double limit_weight, Budget& budget) {
    sigma_ = dsigma_ = 0;
    relaxed_ = false;
    slack_weight_ = own_cone_weight_ = cone_weight;
    own_limit_weight_ = limit_weight;
    settle();
    const auto [least, most] = own_weights();
    level_ = std::max(most, slack_cost());
    update_slacks();
    aim_at_center(1);
    bool feasible = false;  // y and z balance: true for good after a whole step
    for (;;) {
      if (level_ <= least && feasible && distance_to_target() < kClose) return;
      if (!budget.take()) return;
      factor();
      direction(1);
      const double step = std::min(1.0, 0.99 * step_limit());
      if (!(step > kLeastStep) || !advance(step)) return;
      feasible = feasible || step == 1;
      level_ *= step > 0.9 ? kDescent : step > 0.5 ? std::sqrt(kDescent) : 1;
    }
  }

 private:
  static constexpr double kLeastCentering = 1e-3;
  static constexpr double kInteriorDepth = 0.1;  // a relative slack with which Newton starts well
  static constexpr double kShallow = 1e-11;      // one that is more than rounding
  static constexpr double kLeast = 1e-7;         // relative accuracy of the least violation
  static constexpr double kClosest = 1e-13;
  static constexpr double kBalance = 1e-12;  // of multipliers dual feasible but for rounding
  static constexpr double kLeastStep = 1e-6;
  static constexpr double kDescent = 0.1;  // of a weight on its way down, after a good step
  static constexpr double kClose = 1e-2;   // squared distance to the target for Newton to take over

  struct Side {  // one side of a row: slack, multiplier, their steps
    double s = 0, z = 0, ds = 0, dz = 0;
  };
  struct Lifted {  // a contact's cone in Lorentz coordinates
    double s[4], z[4], ds[4], dz[4];
    double V[16], scaled[4], gamma[4];  // lorentz::scale; the scaled gradient of its barrier
  };
  struct Work {
    Side *hi, *lo;  // rows
    Lifted* cones;  // tips
  };

  double limit_weight() const { return std::max(level_, own_limit_weight_); }
  double weight(const Tip& tip) const { return std::max(level_, own_cone_weight_ * tip.weight); }

  // The least and the greatest weight of limits and cones.
  std::pair<double, double> own_weights() {
    double least = own_limit_weight_, most = own_limit_weight_;
    for_each([](int, int, Side&, double) {},
             [&](int, const Tip& tip, Lifted&) {
               least = std::min(least, own_cone_weight_ * tip.weight);
               most = std::max(most, own_cone_weight_ * tip.weight);
             });
    return {least, most};
  }

  // Every slack, multiplier and cone of the problem in turn.
  template <class Row, class Tips>
  void for_each(Row row, Tips tips) {
    for (int b = 0; b < count(); ++b) {
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
    level_ = slack_weight_ = 1;
    own_cone_weight_ = own_limit_weight_ = 0;
    std::fill(c_.begin(), c_.end(), 0.0);
    least_violation_ = kInfinity;
    restore_wrench();
    degree_ = 0;
    for_each([&](int, int, Side&, double) { degree_ += 1; },
             [&](int, const Tip&, Lifted&) { degree_ += 2; });
    sigma_ = 1.2 * std::max(0.0, violation()) + 0.1;
    update_slacks();
    aim_at_center(1);
    double weight = 0;
    for_each([&](int b, int r, Side& side, double) { weight += part(b).scale[r] * side.z; },
             [&](int, const Tip& tip, Lifted& cone) { weight += tip.cone_scale * cone.z[0]; });
    aim_at_center(1 / weight);
    std::fill(nu_.begin(), nu_.end(), 0.0);
  }

  // The σ that c needs.
  double violation() {
    sigma_ = 0;
    update_slacks();
    double least = -kInfinity;
    for_each([&](int b, int r, Side& side,
                 double) { least = std::max(least, -side.s / part(b).scale[r]); },
             [&](int, const Tip& tip, Lifted& cone) {
               const double margin = cone.s[0] - lorentz::radius(cone.s, tip.cone.dim);
               least = std::max(least, -margin / tip.cone_scale);
             });
    return least;
  }

  // Remembers the point if it balances the wrench and needs less σ than those before.
  void keep_best() {
    if (!(sigma_ < least_violation_) || !balanced()) return;
    least_violation_ = sigma_;
    best_ = c_;
  }

  // The multipliers whose products with the slacks are τ times the weights.
  void aim_at_center(double tau) {
    for_each([&](int, int, Side& side, double) { side.z = tau * limit_weight() / side.s; },
             [&](int, const Tip& tip, Lifted& cone) {
               lorentz::center(cone.s, tip.cone.dim, tau * weight(tip), cone.z);
             });
  }

  // What ends an approach, where the size of f is 1.
  struct Nearness {
    double share;     // of the squared distance to f
    double rounding;  // of the distance
    double floor;
  };
  static constexpr Nearness kNearest{1e-11, 2e-13, 1e-16};
  static constexpr Nearness kNearly{1e-9, 1e-9, 1e-13};  // where rounding ends it

  // Whether what is left to gain is nothing beside the squared distance to f.
  bool near(double gap, const Nearness& most) const {
    const double cost = slack_cost();
    return gap < std::max({most.share * cost, most.rounding * std::sqrt(cost), most.floor});
  }

  // What the soft rows' slacks cost.
  double slack_cost() const {
    double sum = 0;
    for (int b = 0; b < count(); ++b)
      if (part(b).slack_row >= 0) sum += 0.5 * slack_weight_ * c(b)[0] * c(b)[0];
    return sum;
  }

  // Squared distance of the products s·z from the weights, in the scaled coordinates: what the
  // barrier's centrality measures.
  double distance_to_target() {
    double sum = 0;
    for_each(
        [&](int, int, Side& side, double) {
          const double product = side.s * side.z, off = limit_weight() - product;
          sum += off * off / product;
        },
        [&](int, const Tip& tip, Lifted& cone) {
          // ‖2w/λ − λ‖² for the scaled point λ with λ·λ = s·z and det λ = √(det s·det z).
          const int dim = tip.cone.dim;
          const double det =
              std::sqrt(lorentz::determinant(cone.s, dim) * lorentz::determinant(cone.z, dim));
          const double product = dot(cone.s, cone.z, dim), w = weight(tip);
          sum += product + 4 * w * w * product / (det * det) - 4 * w;
        });
    return sum;
  }

  // Slacks follow exactly from (c, σ): the point stays feasible to the last digit.
  void update_slacks() {
    for_each(
        [&](int b, int r, Side& side, double sign) {
          const double t = dot(part(b).a + r * part(b).q, c(b), part(b).q);
          const double room = sign > 0 ? part(b).hi[r] - t : t - part(b).lo[r];
          side.s = room + sigma_ * part(b).scale[r];
        },
        [&](int b, const Tip& tip, Lifted& cone) {
          tip.cone.lift(c(b) + tip.first, cone.s);
          cone.s[0] += sigma_ * tip.cone_scale;
        });
  }

  // Removes what is missing of f by the least change of the forces.
  void restore_wrench() {
    missing_wrench(missing_.data());
    least_squares_.set_least_norm(missing_.data());
    least_squares_.least_norm_step(d_.data());
    BlockPoint::advance(1);
  }

  double complementarity() {
    double sum = 0;
    for_each([&](int, int, Side& side, double) { sum += side.s * side.z; },
             [&](int, const Tip& tip, Lifted& cone) { sum += dot(cone.s, cone.z, tip.cone.dim); });
    return sum / degree_;
  }

  // Sets the step up: the rows of G, √(z/s) a for a limit and V for a cone, each with its scaled
  // gradient and its part of the σ column.
  void factor() {
    least_squares_.clear();
    for (int b = 0; b < count(); ++b) {
      const int q = part(b).q;
      if (part(b).slack_row >= 0) {
        double* row = least_squares_.row(b, 0);
        row[0] = std::sqrt(slack_weight_);
        row[1] = row[0] * c(b)[0];
      }
      for (int i = 0; i < part(b).tips.size(); ++i) {
        const Tip& tip = part(b).tips[i];
        Lifted& cone = work_[b].cones[i];
        const int dim = tip.cone.dim;
        lorentz::scale(cone.s, cone.z, dim, cone.V, cone.scaled);
        lorentz::center(cone.scaled, dim, weight(tip), cone.gamma);
        for (int r = 0; r < dim; ++r) {
          double* row = least_squares_.row(b, tip.first + r);
          for (int j = 0; j < dim; ++j)
            row[tip.first + j] = cone.V[r * dim + j] * tip.cone.weight(j);
          row[q] = cone.gamma[r] = -cone.gamma[r];
          row[q + 1] = cone.V[r * dim] * tip.cone_scale;
        }
      }
      for (int r = 0; r < part(b).rows; ++r) {
        // The two sides as one row, and one that no step reaches.
        const Side &hi = work_[b].hi[r], &lo = work_[b].lo[r];
        const bool above = part(b).hi[r]<kInfinity, below = part(b).lo[r]> - kInfinity;
        const double up = above ? std::sqrt(hi.z / hi.s) : 0;
        const double down = below ? std::sqrt(lo.z / lo.s) : 0;
        const double size = std::hypot(up, down);
        if (!(size > 0)) continue;
        const double cosine = up / size, sine = down / size, scale = part(b).scale[r];
        const double up_gamma = above ? limit_weight() / std::sqrt(hi.s * hi.z) : 0;
        const double down_gamma = below ? limit_weight() / std::sqrt(lo.s * lo.z) : 0;
        double* row = least_squares_.row(b, q + r);
        add_scaled(size, part(b).a + r * q, q, row);
        row[q] = cosine * up_gamma - sine * down_gamma;
        row[q + 1] = (sine * down - cosine * up) * scale;
        least_squares_.add_row(sine * up_gamma + cosine * down_gamma, -2 * sine * up * scale);
      }
    }
    missing_wrench(missing_.data());
    least_squares_.factor(missing_.data());
  }

  // The step towards complementarity τ, with the multipliers it leads to in next_nu_.
  void direction(double tau) {
    dsigma_ = relaxed_ ? least_squares_.slack_step(tau) : 0;
    least_squares_.step(tau, dsigma_, d_.data());
    least_squares_.multipliers(tau, dsigma_, next_nu_.data());
    for_each(
        [&](int b, int r, Side& side, double sign) {
          const double change = dot(part(b).a + r * part(b).q, d(b), part(b).q);
          side.ds = dsigma_ * part(b).scale[r] - sign * change;
          side.dz = (tau * limit_weight() - side.z * side.ds) / side.s - side.z;
        },
        [&](int b, const Tip& tip, Lifted& cone) {
          const int dim = tip.cone.dim;
          tip.cone.lift(d(b) + tip.first, cone.ds);
          cone.ds[0] += dsigma_ * tip.cone_scale;
          double residual[4];
          for (int i = 0; i < dim; ++i)
            residual[i] = tau * cone.gamma[i] + dot(cone.V + i * dim, cone.ds, dim);
          for (int i = 0; i < dim; ++i)
            cone.dz[i] = -dot(cone.V + i * dim, residual, dim) - cone.z[i];
        });
  }

  double step_limit() {
    double limit = kInfinity;
    auto bound = [&limit](double value, double change) {
      if (change < 0) limit = std::min(limit, -value / change);
    };
    for_each(
        [&](int, int, Side& side, double) {
          bound(side.s, side.ds);
          bound(side.z, side.dz);
        },
        [&](int, const Tip& tip, Lifted& cone) {
          limit = std::min(limit, lorentz::step_limit(cone.s, cone.ds, tip.cone.dim));
          limit = std::min(limit, lorentz::step_limit(cone.z, cone.dz, tip.cone.dim));
        });
    return limit;
  }

  // False when rounding has put a slack or a multiplier on its boundary.
  bool advance(double step) {
    BlockPoint::advance(step);
    sigma_ += step * dsigma_;
    for (int r = 0; r < blocks_.k(); ++r) nu_[r] += step * (next_nu_[r] - nu_[r]);
    for_each([&](int, int, Side& side, double) { side.z += step * side.dz; },
             [&](int, const Tip& tip, Lifted& cone) {
               add_scaled(step, cone.dz, tip.cone.dim, cone.z);
             });
    update_slacks();
    bool inside = true;
    for_each([&](int, int, Side& side, double) { inside &= side.s > 0 && side.z > 0; },
             [&](int, const Tip& tip, Lifted& cone) {
               const int dim = tip.cone.dim;
               inside &= lorentz::inside(cone.s, dim) && lorentz::inside(cone.z, dim);
             });
    return inside;
  }

  // y·f − z·b: a lower bound on σ once the multipliers are dual feasible.
  double dual_bound() {
    double bound = dot(nu_.data(), blocks_.f(), blocks_.k());
    for_each([&](int b, int r, Side& side,
                 double sign) { bound -= side.z * (sign > 0 ? part(b).hi[r] : -part(b).lo[r]); },
             [](int, const Tip&, Lifted&) {});
    return bound;
  }

  // Whether the multipliers prove the problem infeasible; if so they become y and z.
  bool prove(const Problem& problem, std::vector<double>& y, std::vector<double>& z) {
    get_dual(proof_y_.data(), proof_z_.data());
    if (!proves_infeasible(blocks_.layout(), problem, proof_y_.data(), proof_z_.data()))
      return false;
    y.swap(proof_y_);
    z.swap(proof_z_);
    return true;
  }

  // The multipliers as a certificate. What still keeps e = Aᵀz − Wᵀy out of a contact's dual cone
  // is pushed back by raising the multipliers of the rows that add up to the missing normal force.
  void get_dual(double* y, double* z) {
    std::fill(y, y + blocks_.layout().wrench_rows, 0.0);
    for (int r = 0; r < blocks_.k(); ++r) y[blocks_.row(r)] = nu_[r];
    std::fill(z, z + limit_count(blocks_.layout()), 0.0);
    for_each([&](int b, int r, Side& side, double sign) { z[limit(b, r, sign)] = side.z; },
             [](int, const Tip&, Lifted&) {});
    for (int b = 0; b < count(); ++b) {
      const int q = part(b).q;
      arena_.reset(std::size_t(q) * (q + 2));
      double *e = arena_.take(q), *missing = arena_.take(q), *H = arena_.take(std::size_t(q) * q);
      bool outside = false;
      for (int i = 0; i < q; ++i) {
        e[i] = -dot(part(b).Wt + i * blocks_.k(), nu_.data(), blocks_.k());
        for (int r = 0; r < part(b).rows; ++r)
          e[i] += part(b).a[r * q + i] * (work_[b].hi[r].z - work_[b].lo[r].z);
      }
      for (const Tip& tip : part(b).tips) {
        const double margin = tip.cone.dual_margin(e + tip.first);
        const double safe = 1e-12 * std::abs(e[tip.first]);
        if (margin < safe) {
          missing[tip.first] = 2 * (safe - margin);
          outside = true;
        }
      }
      for (int i = 0; i < part(b).components.size(); ++i)
        if (part(b).components[i] >= blocks_.layout().components() && e[i] != 0) {
          missing[i] = -e[i];  // an internal force is free
          outside = true;
        }
      if (!outside) continue;
      double size = 0;
      for (int r = 0; r < part(b).rows; ++r) {
        add_outer(part(b).a + r * q, q, 1, H);
        size += dot(part(b).a + r * q, part(b).a + r * q, q);
      }
      for (int i = 0; i < q; ++i) H[i * (q + 1)] += 1e-13 * size;  // rows may be too few
      cholesky(H, q);
      forward_substitute(H, q, missing);
      back_substitute(H, q, missing);
      for (int r = 0; r < part(b).rows; ++r) {
        const double more = dot(part(b).a + r * q, missing, q);
        const double sign = more > 0 ? 1 : -1;
        const bool there = (more > 0 ? part(b).hi[r] : -part(b).lo[r]) < kInfinity;
        if (there) z[limit(b, r, sign)] += std::abs(more);
      }
    }
  }

  int limit(int b, int r, double sign) const {
    const auto [above, below] = blocks_.limit_indices(part(b), r);
    return sign > 0 ? above : below;
  }

  LeastSquares& least_squares_;
  std::vector<Work> work_;
  std::vector<Side> sides_;
  std::vector<Lifted> cones_;
  Arena arena_;  // scratch
  std::vector<double> nu_, next_nu_, proof_y_, proof_z_;
  std::vector<double> best_;  // the balanced point of least violation so far
  double least_violation_ = kInfinity;
  bool relaxed_ = true;
  // Of limits, and of cones of weight 1. Until the common level has come down to a term's own
  // weight, that is the level; Phase 1, whose own weights are zero, stays at it.
  double level_ = 1, own_limit_weight_ = 0, own_cone_weight_ = 0;
  double slack_weight_ = 1;
  double sigma_ = 0, dsigma_ = 0, degree_ = 0;
};

}  // namespace graspforce
