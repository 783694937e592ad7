// The barrier of barrier.hpp for grasps in which no two contacts share a block: four contacts at a
// time, one a lane, with everything of a contact's size fixed when compiled.
//
// The same mathematics with the same names; the kernels are in lane_group.hpp. Q is the largest
// number of components that a contact of the grasp may have. With no more than four contacts the
// compiler keeps a step's numbers in registers. W c = f has at most six rows, and rows that are
// missing or not in use are rows of zeros with a one on the diagonal of the 6 × 6 system. A
// soft wrench has its slacks in wrench_slacks.hpp.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "graspforce/lane_group.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/structure.hpp"
#include "graspforce/wrench_slacks.hpp"

namespace graspforce {

// Which grasps a barrier is compiled for.
enum class Grasps {
  Plain,  // at most four contacts, no rate limits, no soft wrench: a tick 4 % shorter than by Small
  Soft,   // at most four contacts, no rate limits, a soft wrench
  Small,  // at most four contacts
  Any,
};

template <int Q, Grasps grasps>
class LaneBarrier {
  static constexpr bool single = grasps != Grasps::Any;  // one group
  static constexpr bool unrated = grasps == Grasps::Plain || grasps == Grasps::Soft;

 public:
  explicit LaneBarrier(const Layout& layout) : layout_(layout) {
    if (layout.wrench_rows > kWrench) return;  // never fits
    if (!single) groups_.resize((layout.contacts() + kLanes - 1) / kLanes);
    rows_.resize(layout.joints + layout.inequalities);  // no limit stands in two groups
  }

  // Whether the kernels fit a structure.
  static bool fits(const Layout& layout, const Structure& structure) {
    if (layout.wrench_rows > kWrench || structure.blocks().empty()) return false;
    // Internal forces tie all contacts together; weights are of patches, whose contacts share a
    // block.
    if (layout.internals > 0 || layout.cone_weights) return false;
    if (single && structure.blocks().size() > kLanes) return false;
    if (unrated && layout.rate_limits) return false;
    if (grasps == (layout.soft_wrench ? Grasps::Plain : Grasps::Soft)) return false;
    for (const Block& block : structure.blocks())
      if (block.contacts.size() > 1 || block.components.size() > Q) return false;
    return true;
  }

  // Sorts the contacts into groups. Does not allocate.
  void allot(const Structure& structure) {
    const std::vector<Block>& blocks = structure.blocks();
    members_ = static_cast<int>(blocks.size());
    settled_ = false;
    const int groups = (members_ + kLanes - 1) / kLanes;
    if (!single) end_ = groups_.data() + groups;
    LaneRow<Q>* row = rows_.data();
    for (Group& group : *this) {
      const int first = static_cast<int>(&group - begin()) * kLanes;
      const int members = std::min(kLanes, members_ - first);
      int joints = 0, inequalities = 0;
      for (int l = 0; l < members; ++l) {
        joints = std::max(joints, blocks[first + l].joints.size());
        inequalities = std::max(inequalities, blocks[first + l].inequalities.size());
      }
      group.clear(members, {row, joints + inequalities}, joints);
      row += joints + inequalities;
      for (int l = 0; l < kLanes; ++l)
        group.place(l, blocks[first + std::min(l, group.members - 1)], layout_);
      group.settle();
    }
  }

  // Takes what has changed of a problem's numbers.
  void load(const Problem& p, unsigned changed) {
    const bool reduced = k_ < layout_.wrench_rows;
    if (reduced) {
      k_ = layout_.wrench_rows;
      for (int r = 0; r < kWrench; ++r) row_[r] = r < k_ ? r : 0;
    }
    if (reduced || changed & kChangedMap) load_map(p);
    if (changed & kChangedJacobian)
      for (Group& group : *this) group.load_jacobian(p.J, layout_.joints);
    if (changed & kChangedRest) load_limits(p);
    if (reduced || (changed & kChangedRest && is_soft())) load_softness(p);
    if (reduced) settled_ = false;
    load_wrench(p);
  }

  // Keeps only the given rows of W c = f: an independent set when W is rank-deficient.
  void restrict_rows(const Problem& p, const std::vector<int>& rows) {
    k_ = static_cast<int>(rows.size());
    std::fill_n(row_, kWrench, 0);
    std::copy(rows.begin(), rows.end(), row_);
    load_softness(p);
    settled_ = false;
    load_wrench(p);
    load_map(p);
  }

  double cone_weight() const { return cone_weight_; }
  double limit_weight() const { return limit_weight_; }

  // ---- the point ---------------------------------------------------------------------------

  void set_forces(const double* c) {
    for (Group& group : *this) group.set_forces(c);
    if (is_soft()) settle();
  }

  // c ← 2 last − before. Slacks stay what the last optimum made them.
  void extrapolate(const double* last, const double* before) {
    for (Group& group : *this) group.extrapolate(last, before);
    if (is_soft() && !settled_) settle();
  }

  void get_forces(double* c) const {
    if (members_ < layout_.contacts()) std::fill_n(c, components_, 0.0);
    for (const Group& group : *this) group.get_forces(c);
  }

  // Pure pushes, each `fraction` of its contact's reach or what the limits leave of that.
  void set_pushes(double fraction) {
    double known = 0;
    for (const Group& group : *this) {
      const Lanes reach = group.reach();
      for (int l = 0; l < group.members; ++l)
        if (reach[l] < kInfinity) known = std::max(known, reach[l]);
    }
    const Lanes fallback = splat(known > 0 ? known : largest_f_ > 0 ? largest_f_ : 1);
    for (Group& group : *this) group.push(fraction * min(group.reach(), fallback), layout_);
    if (is_soft()) settle();
  }

  bool inside() const {
    Lanes worst = splat(kInfinity);
    for (const Group& group : *this) worst = min(worst, group.slack(layout_));
    return all_positive(worst);
  }

  // Whether W c = f holds to rounding.
  bool balanced() const {
    // Nearly always f alone is yardstick enough.
    Lanes high, low;
    errors(high, low);
    const Lanes room = splat(kBalanced * largest_exact_f_);
    return (all_positive(room - high) && all_positive(room - low)) || wrench_error() < kBalanced;
  }

  // max |f − W c| of the exact rows relative to the wrenches that add up to f.
  double wrench_error() const {
    double size = 0;
    for (int r = 0; r < kWrench; ++r) {
      if (slacks_.is_soft(r)) continue;
      Lanes part = {};
      for (const Group& group : *this)
        for (int i = 0; i < Q; ++i) part += abs(group.W[r][i] * group.c[i]);
      size = std::max(size, std::abs(f_[r]) + sum(part));
    }
    if (!(size < kInfinity)) return kInfinity;
    Lanes high, low;
    errors(high, low);
    return size > 0 ? std::max(0.0, greatest(max(high, low))) / size : 0;
  }

  // Whether the forces are out of all proportion to the limits.
  bool runaway() const {
    Lanes force = {}, size = {};
    for (const Group& group : *this) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i) force = max(force, group.mask[i] * abs(group.c[i]));
    }
    const double largest = greatest(force);
    if (largest <= 1e-3 * kRunaway * largest_f_) return false;  // nearly always
    for (const Group& group : *this) size = max(size, group.size(layout_));
    return largest > kRunaway * std::max(greatest(size), largest_f_);
  }

  // ---- derivatives and the Newton step -------------------------------------------------------

  bool evaluate() { return evaluate<true>(); }

  double newton() { return newton(f_); }

  double newton_from_multipliers() {
    double last_nu[kWrench];
    std::copy_n(nu_, kWrench, last_nu);
    for (Group& group : *this) group.subtract_wrench(last_nu);
    const double lambda = is_soft() ? newton_of_slacks(last_nu) : newton(f_);
    for (int r = 0; r < kWrench; ++r) nu_[r] += last_nu[r];
    return lambda;
  }

  // False when the last step's system was nearly singular.
  bool sound() const { return sound_; }

  double slope() const {
    Lanes total = {};
    for (const Group& group : *this)
      for (int i = 0; i < Q; ++i) total += group.g[i] * group.d[i];
    if (is_soft()) total += slacks_.slope();
    return sum(total);
  }

  double step_limit() const {
    Lanes worst = {};
    for (const Group& group : *this) worst = max(worst, group.inverse_limit(layout_));
    const double inverse = -least(-worst);
    return inverse > 0 ? 1 / inverse : kInfinity;
  }

  void advance(double t) {
    for (Group& group : *this) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < Q; ++i) group.c[i] += t * group.d[i];
    }
    if (is_soft()) slacks_.advance(t);
  }

  void get_multipliers(double* nu) const {
    if (k_ == kWrench) {
      GRASPFORCE_UNROLL
      for (int r = 0; r < kWrench; ++r) nu[r] = nu_[r] * inverse_cone_weight_;
      return;
    }
    std::fill_n(nu, layout_.wrench_rows, 0.0);
    for (int r = 0; r < k_; ++r) nu[row_[r]] = nu_[r] * inverse_cone_weight_;
  }

  double decrement_bound(double lambda) {
    if (!evaluate<false>()) return kInfinity;
    Lanes rhs[kWrench] = {};
    for (Group& group : *this) group.template add_gradient<false>(rhs, group.H, group.inverse);
    Lanes high = sums(rhs[0], rhs[1], rhs[2], rhs[3]), low = sums(rhs[4], rhs[5], Lanes{}, Lanes{});
    if (is_soft()) slacks_.pull(high, low);
    std::memcpy(nu_, &high, sizeof high);
    std::memcpy(nu_ + kLanes, &low, sizeof low);
    system_.solve(nu_);
    Lanes squared = {};
    if (is_soft()) squared += slacks_.step(nu_);
    for (const Group& group : *this) {
      Lanes left[Q];
      squared += group.residual(nu_, left, group.H, group.inverse);
    }
    return std::sqrt(sum(squared)) / (1 - lambda);
  }

 private:
  using Group = LaneGroup<Q, unrated>;

  bool is_soft() const { return unrated ? grasps == Grasps::Soft : layout_.soft_wrench; }

  // The groups in use.
  Group* begin() { return single ? &only_ : groups_.data(); }
  Group* end() { return single ? &only_ + 1 : end_; }
  const Group* begin() const { return single ? &only_ : groups_.data(); }
  const Group* end() const { return single ? &only_ + 1 : end_; }

  // From f, less what multipliers that are taken for granted make of it.
  double newton(const double* f) {
    WrenchSums total;
    GRASPFORCE_UNROLL
    for (int r = 0; r < kWrench; ++r) total.rhs()[r] = Lanes{f[r]};
    Group* group = begin();
    group->template add<true>(total);
    while (++group != end()) group->template add<false>(total);
    sound_ = system_.solve(total, nu_);
    Lanes squared = {};
    for (Group& each : *this) squared += each.step(nu_);
    if (is_soft()) squared += slacks_.step(nu_);
    return std::sqrt(sum(squared));
  }

  double newton_of_slacks(const double* last_nu) {
    double f[kWrench];
    std::copy_n(f_, kWrench, f);
    slacks_.subtract(last_nu, f);
    const double lambda = newton(f);
    slacks_.restore(last_nu);
    return lambda;
  }

  // Gives the slack of every soft row what the forces leave of it.
  void settle() {
    settled_ = true;
    Lanes missing[2];
    missing_wrench(missing[0], missing[1]);
    slacks_.settle(missing);
  }

  template <bool with_hessian>
  bool evaluate() {
    Lanes worst = splat(kInfinity);
    for (Group& group : *this)
      worst =
          min(worst, group.template evaluate<with_hessian>(cone_weight_, limit_weight_, layout_));
    return all_positive(worst);
  }

  // |f − W c| of the exact rows, rows 0 to 3 and the others.
  GRASPFORCE_INLINE void errors(Lanes& high, Lanes& low) const {
    missing_wrench(high, low);
    high = abs(high);
    low = abs(low);
    if (is_soft()) slacks_.mask(high, low);
  }
  // f − W c.
  GRASPFORCE_INLINE void missing_wrench(Lanes& high, Lanes& low) const {
    Lanes parts[kWrench] = {};
    for (const Group& group : *this) {
      GRASPFORCE_UNROLL
      for (int r = 0; r < kWrench; ++r) parts[r] += group.wrench(r, group.c);
    }
    high = four_at(f_) - sums(parts[0], parts[1], parts[2], parts[3]);
    low = four_at(f_ + kLanes) - sums(parts[4], parts[5], Lanes{}, Lanes{});
  }

  void load_wrench(const Problem& p) {
    if (k_ == kWrench)
      std::copy_n(p.f, kWrench, f_);
    else
      for (int r = 0; r < kWrench; ++r) f_[r] = r < k_ ? p.f[row_[r]] : 0;
    Lanes high = abs(four_at(f_)), low = abs(four_at(f_ + kLanes));
    largest_f_ = largest_exact_f_ = greatest(max(high, low));
    if (!is_soft()) return;
    slacks_.mask(high, low);
    largest_exact_f_ = std::max(0.0, greatest(max(high, low)));
  }
  void load_map(const Problem& p) {
    for (Group& group : *this) group.load_map(p.W, components_, row_, k_);
  }

  void load_limits(const Problem& p) {
    inverse_cone_weight_ = std::min(1.0, *p.alpha);
    cone_weight_ = 1 / inverse_cone_weight_;
    limit_weight_ = *p.alpha * cone_weight_;
    for (Group& group : *this) group.load_limits(p, layout_);
  }

  void load_softness(const Problem& p) {
    slacks_.load(is_soft() ? p.f_soft : nullptr, row_, k_, cone_weight_);
    system_.set_diagonal(slacks_.diagonal());
  }

  const Layout& layout_;
  const int components_ = layout_.components();
  Group only_;                 // with a single group; else
  std::vector<Group> groups_;  // all of them
  std::vector<LaneRow<Q>> rows_;
  Group* end_ = nullptr;
  WrenchSystem system_;
  int members_ = 0;  // contacts in the grasp
  int k_ = 0, row_[kWrench] = {};
  double f_[2 * kLanes] = {}, nu_[2 * kLanes] = {};  // zeros behind the last row
  double largest_f_ = 0, largest_exact_f_ = 0;       // of all rows, and of those that are not soft
  WrenchSlacks slacks_;
  bool settled_ = false;  // the slacks belong to the forces of this or of the last tick
  double cone_weight_ = 1, limit_weight_ = 1, inverse_cone_weight_ = 1;
  bool sound_ = true;
};

}  // namespace graspforce
