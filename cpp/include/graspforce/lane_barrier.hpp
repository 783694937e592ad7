// The barrier of barrier.hpp for grasps in which no two contacts share a block: four contacts at a
// time, one a lane, with everything of a contact's size fixed when compiled.
//
// The same mathematics with the same names; the kernels are in lane_group.hpp. Q is the largest
// number of components that a contact of the grasp may have. W c = f has at most six rows, and rows
// that are missing or not in use are rows of zeros with a one on the diagonal of the 6 × 6 system.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/lane_group.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/structure.hpp"

namespace graspforce {

template <int Q>
class LaneBarrier {
 public:
  explicit LaneBarrier(const Layout& layout) : layout_(layout) {}

  // Whether the kernels fit a structure.
  static bool fits(const Layout& layout, const Structure& structure) {
    if (layout.wrench_rows > kWrench || structure.blocks().empty()) return false;
    for (const Block& block : structure.blocks())
      if (block.contacts.size() > 1 || block.components.size() > Q) return false;
    return true;
  }

  // Sorts the contacts into groups. Once it was called with every contact in the grasp, leaving
  // some out does not allocate.
  void allot(const Structure& structure) {
    const std::vector<Block>& blocks = structure.blocks();
    members_ = static_cast<int>(blocks.size());
    const int groups = (members_ + kLanes - 1) / kLanes;
    if (groups_.size() < std::size_t(groups)) groups_.resize(groups);
    end_ = groups_.data() + groups;
    int joints = 0, inequalities = 0;
    for (const Block& block : blocks) {
      joints = std::max(joints, block.joints.size());
      inequalities = std::max(inequalities, block.inequalities.size());
    }
    for (Group& group : *this) {
      const int first = static_cast<int>(&group - begin()) * kLanes;
      group.clear(std::min(kLanes, members_ - first));
      group.rows.reserve(joints + inequalities + structure.unattached());
      for (int l = 0; l < group.members; ++l)
        group.two_sided = std::max(group.two_sided, blocks[first + l].joints.size());
      for (int l = 0; l < kLanes; ++l)
        group.place(l, blocks[first + std::min(l, group.members - 1)], layout_);
    }
  }

  // Takes what has changed of a problem's numbers.
  void load(const Problem& p, unsigned changed) {
    if (changed & kChangedMap || k_ < layout_.wrench_rows) {
      if (k_ < layout_.wrench_rows) {
        k_ = layout_.wrench_rows;
        for (int r = 0; r < kWrench; ++r) row_[r] = r < k_ ? r : 0;
      }
      load_wrench_rows(p);
    }
    load_wrench(p);
    if (changed & kChangedJacobian)
      for (Group& group : *this) group.load_jacobian(p.J);
    if (changed & kChangedRest) load_limits(p);
  }

  // Keeps only the given rows of W c = f: an independent set when W is rank-deficient.
  void restrict_rows(const Problem& p, const std::vector<int>& rows) {
    k_ = static_cast<int>(rows.size());
    std::fill_n(row_, kWrench, 0);
    std::copy(rows.begin(), rows.end(), row_);
    load_wrench(p);
    load_wrench_rows(p);
  }

  double cone_weight() const { return cone_weight_; }
  double limit_weight() const { return limit_weight_; }

  // ---- the point ---------------------------------------------------------------------------

  void set_forces(const double* c) {
    for (Group& group : *this) group.set_forces(c);
  }

  // c ← 2 last − before.
  void extrapolate(const double* last, const double* before) {
    for (Group& group : *this) group.extrapolate(last, before);
  }

  void get_forces(double* c) const {
    if (members_ < layout_.contacts()) std::fill_n(c, components_, 0.0);
    for (const Group& group : *this) group.get_forces(c);
  }

  // Pure pushes, each `fraction` of its contact's reach or what the limits leave of that.
  void set_pushes(double fraction) {
    double known = 0, wrench = 0;
    for (const Group& group : *this) {
      const Lanes reach = group.reach();
      for (int l = 0; l < group.members; ++l)
        if (reach[l] < kInfinity) known = std::max(known, reach[l]);
    }
    for (const Lanes& half : f_) wrench = std::max(wrench, greatest(abs(half)));
    const Lanes fallback = splat(known > 0 ? known : wrench > 0 ? wrench : 1);
    for (Group& group : *this) group.push(fraction * min(group.reach(), fallback));
  }

  bool inside() const {
    Lanes worst = splat(kInfinity);
    for (const Group& group : *this) worst = min(worst, group.slack());
    return least(worst) > 0;
  }

  // max |f − W c| relative to the wrenches that add up to f.
  double wrench_error() const {
    Lanes parts[kHalves * kLanes] = {};
    for (const Group& group : *this) {
      GRASPFORCE_UNROLL
      for (int r = 0; r < kWrench; ++r)
        parts[r] =
            &group == begin() ? group.wrench(r, group.c) : parts[r] + group.wrench(r, group.c);
    }
    Lanes worst = {}, scale = {};
    GRASPFORCE_UNROLL
    for (int half = 0; half < kHalves; ++half) {
      const Lanes* four = parts + half * kLanes;
      const Lanes error = abs(f_[half] - sums(four[0], four[1], four[2], four[3]));
      worst = error <= worst ? worst : error;  // NaN stays
      scale = max(scale, abs(f_[half]));
    }
    const double error = greatest(worst);
    double size = greatest(scale);
    if (error < 1e-12 * size) return error / size;  // the sizes of the parts only add to that
    for (const Group& group : *this) {
      for (int r = 0; r < kWrench; ++r) {
        Lanes part = {};
        for (int i = 0; i < Q; ++i) part += abs(group.W[r][i] * group.c[i]);
        size = std::max(size, sum(part));
      }
    }
    return size > 0 ? error / size : 0;
  }

  double largest_force() const {
    double largest = 0;
    for (const Group& group : *this)
      for (int i = 0; i < Q; ++i)
        for (int l = 0; l < group.members; ++l)
          largest = std::max(largest, std::abs(group.c[i][l]));
    return largest;
  }

  // ---- derivatives and the Newton step -------------------------------------------------------

  bool evaluate() { return evaluate<true>(); }

  double newton() {
    WrenchSums total;
    total.v[WrenchSums::kSize - 1] = Lanes{};
    Group* group = begin();
    group->template add<true>(total);
    while (++group != end()) group->template add<false>(total);
    sound_ = system_.factor(total, nu_);
    GRASPFORCE_UNROLL
    for (int r = 0; r < kWrench; ++r) nu_[r] += f_[r / kLanes][r % kLanes];
    system_.solve(nu_);
    Lanes squared = {};
    for (Group& each : *this) squared += each.step(nu_);
    return std::sqrt(sum(squared));
  }

  double newton_from_multipliers() {
    double last_nu[kWrench];
    std::copy_n(nu_, kWrench, last_nu);
    for (Group& group : *this) group.subtract_wrench(last_nu);
    const double lambda = newton();
    for (int r = 0; r < kWrench; ++r) nu_[r] += last_nu[r];
    return lambda;
  }

  // False when the last step's system was nearly singular.
  bool sound() const { return sound_; }

  double slope() const {
    Lanes total = {};
    for (const Group& group : *this)
      for (int i = 0; i < Q; ++i) total += group.g[i] * group.d[i];
    return sum(total);
  }

  double step_limit() const {
    Lanes worst = {};
    for (const Group& group : *this) worst = max(worst, group.inverse_limit());
    const double inverse = -least(-worst);
    return inverse > 0 ? 1 / inverse : kInfinity;
  }

  void advance(double t) {
    for (Group& group : *this) GRASPFORCE_UNROLL
    for (int i = 0; i < Q; ++i) group.c[i] += t * group.d[i];
  }

  void get_multipliers(double* nu) const {
    if (k_ < layout_.wrench_rows) std::fill_n(nu, layout_.wrench_rows, 0.0);
    GRASPFORCE_UNROLL
    for (int r = 0; r < kWrench; ++r)
      if (r < k_) nu[row_[r]] = nu_[r] * inverse_cone_weight_;
  }

  double decrement_bound(double lambda) {
    if (!evaluate<false>()) return kInfinity;
    Lanes rhs[kHalves * kLanes] = {};
    for (Group& group : *this) group.template add_gradient<false, false>(rhs);
    for (int r = 0; r < kWrench; ++r) nu_[r] = sum(rhs[r]);
    system_.solve(nu_);
    Lanes squared = {};
    for (const Group& group : *this) {
      Lanes left[Q];
      squared += group.residual(nu_, left);
    }
    return std::sqrt(sum(squared)) / (1 - lambda);
  }

 private:
  using Group = LaneGroup<Q>;
  static constexpr int kHalves = (kWrench + kLanes - 1) / kLanes;

  // The groups in use.
  Group* begin() { return groups_.data(); }
  Group* end() { return end_; }
  const Group* begin() const { return groups_.data(); }
  const Group* end() const { return end_; }

  template <bool with_hessian>
  bool evaluate() {
    Lanes worst = splat(kInfinity);
    for (Group& group : *this)
      worst =
          min(worst, group.template evaluate<with_hessian>(cone_weight_, limit_weight_, layout_));
    return least(worst) > 0;
  }

  void load_wrench(const Problem& p) {
    GRASPFORCE_UNROLL
    for (int r = 0; r < kWrench; ++r) f_[r / kLanes][r % kLanes] = r < k_ ? p.f[row_[r]] : 0;
  }
  void load_wrench_rows(const Problem& p) {
    system_.set_rows(k_);
    for (Group& group : *this) group.load_map(p.W, components_, row_, k_);
  }

  void load_limits(const Problem& p) {
    inverse_cone_weight_ = std::min(1.0, *p.alpha);
    cone_weight_ = 1 / inverse_cone_weight_;
    limit_weight_ = *p.alpha * cone_weight_;
    for (Group& group : *this) group.load_limits(p, layout_);
  }

  const Layout& layout_;
  const int components_ = layout_.components();
  std::vector<Group> groups_;
  Group* end_ = nullptr;
  WrenchSystem system_;
  int members_ = 0;  // contacts in the grasp
  int k_ = 0, row_[kWrench] = {};
  Lanes f_[kHalves] = {};
  double nu_[kWrench] = {};
  double cone_weight_ = 1, limit_weight_ = 1, inverse_cone_weight_ = 1;
  bool sound_ = true;
};

}  // namespace graspforce
