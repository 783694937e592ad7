// The barrier of barrier.hpp for grasps in which no two contacts share a block: four contacts at a
// time, one a lane, with everything of a contact's size fixed when compiled.
//
// The same mathematics with the same names; the kernels are in lane_group.hpp. Contacts of one
// model make up groups of four. W c = f has at most six rows, and rows that are missing or not in
// use are rows of zeros with a one on the diagonal of the 6 × 6 system.
#pragma once

#include <algorithm>
#include <cmath>
#include <tuple>
#include <type_traits>
#include <vector>

#include "graspforce/lane_group.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/structure.hpp"

namespace graspforce {

class LaneBarrier {
 public:
  explicit LaneBarrier(const Layout& layout) : layout_(layout) {}

  // Sorts the contacts into groups; false when the structure does not fit the kernels.
  bool allot(const Structure& structure) {
    if (layout_.wrench_rows > kWrench || structure.blocks().empty()) return false;
    for (const Block& block : structure.blocks())
      if (block.contacts.size() > 1) return false;
    members_ = 0;
    allot_groups<1>(structure);
    allot_groups<3>(structure);
    allot_groups<4>(structure);
    return true;
  }

  // Takes what has changed of a problem's numbers.
  void load(const Problem& p, unsigned changed) {
    if (changed & kChangedMap || k_ < layout_.wrench_rows) {
      k_ = layout_.wrench_rows;
      for (int r = 0; r < k_; ++r) row_[r] = r;
      load_wrench_rows(p);
    }
    for (int r = 0; r < k_; ++r) f_[r] = p.f[r];
    if (changed & kChangedJacobian)
      each([&](auto& group) { group.load_jacobian(p.J, layout_.joints); });
    if (changed & kChangedRest) load_limits(p);
  }

  // Keeps only the given rows of W c = f: an independent set when W is rank-deficient.
  void restrict_rows(const Problem& p, const std::vector<int>& rows) {
    k_ = static_cast<int>(rows.size());
    for (int r = 0; r < k_; ++r) {
      row_[r] = rows[r];
      f_[r] = p.f[rows[r]];
    }
    load_wrench_rows(p);
  }

  double cone_weight() const { return cone_weight_; }
  double limit_weight() const { return limit_weight_; }

  // ---- the point ---------------------------------------------------------------------------

  void set_forces(const double* c) {
    each([&](auto& group) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < group.components; ++i)
        group.c[i] = group.gather(c, group.start, i, group.mask);
      group.c[0] += 1 - group.mask;
    });
  }

  void get_forces(double* c) const {
    if (members_ < layout_.contacts()) std::fill_n(c, components_, 0.0);
    each([&](const auto& group) {
      for (int l = 0; l < group.members; ++l) {
        GRASPFORCE_UNROLL
        for (int i = 0; i < group.components; ++i) c[group.start[l] + i] = group.c[i][l];
      }
    });
  }

  // Pure pushes, each `fraction` of its contact's reach.
  void set_pushes(double fraction) {
    double known = 0, wrench = 0;
    each([&](auto& group) {
      const Lanes reach = group.reach();
      for (int l = 0; l < kLanes; ++l)
        if (group.contact[l] >= 0 && reach[l] < kInfinity) known = std::max(known, reach[l]);
    });
    for (int r = 0; r < k_; ++r) wrench = std::max(wrench, std::abs(f_[r]));
    const double fallback = known > 0 ? known : wrench > 0 ? wrench : 1;
    each([&](auto& group) {
      const Lanes reach = group.reach();
      for (int l = 0; l < kLanes; ++l) {
        GRASPFORCE_UNROLL
        for (int i = 1; i < group.components; ++i) group.c[i][l] = 0;
        group.c[0][l] = group.contact[l] < 0 ? 1 : fraction * std::min(reach[l], fallback);
      }
    });
  }

  bool inside() const {
    Lanes worst = splat(kInfinity);
    each([&](const auto& group) { worst = min(worst, group.slack()); });
    return least(worst) > 0;
  }

  // max |f − W c| relative to the wrenches that add up to f.
  double wrench_error() {
    double worst = 0, scale = 0;
    Lanes parts[kWrench];
    each_and_first([&](auto& group, auto first) {
      GRASPFORCE_UNROLL
      for (int r = 0; r < kWrench; ++r)
        parts[r] = first ? group.wrench(r, group.c) : parts[r] + group.wrench(r, group.c);
    });
    double wrench[kWrench];
    add_lanes(parts, wrench);
    for (int r = 0; r < k_; ++r) {
      const double error = std::abs(f_[r] - wrench[r]);
      if (!(error <= worst)) worst = error;  // NaN stays
      scale = std::max(scale, std::abs(f_[r]));
    }
    if (worst < 1e-12 * scale) return worst / scale;  // the sizes of the parts only add to that
    each([&](const auto& group) {
      GRASPFORCE_UNROLL
      for (int r = 0; r < kWrench; ++r) {
        Lanes size = {};
        GRASPFORCE_UNROLL
        for (int i = 0; i < group.components; ++i) size += abs(group.W[r][i] * group.c[i]);
        scale = std::max(scale, sum(size));
      }
    });
    return scale > 0 ? worst / scale : 0;
  }

  double largest_force() const {
    double largest = 0;
    each([&](const auto& group) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < group.components; ++i)
        for (int l = 0; l < kLanes; ++l)
          if (group.contact[l] >= 0) largest = std::max(largest, std::abs(group.c[i][l]));
    });
    return largest;
  }

  // ---- derivatives and the Newton step -------------------------------------------------------

  bool evaluate() { return evaluate<true>(); }

  double newton() {
    WrenchSums total;
    each_and_first([&](auto& group, auto first) { group.template add<first>(total); });
    smallest_pivot_ = system_.factor(total, k_);
    add_lanes(total.rhs, nu_);
    for (int r = 0; r < k_; ++r) nu_[r] += f_[r];
    system_.solve(nu_);
    Lanes squared = {};
    each([&](auto& group) { squared += group.step(nu_); });
    return std::sqrt(sum(squared));
  }

  double smallest_pivot() const { return smallest_pivot_; }

  double slope() const {
    Lanes total = {};
    each([&](const auto& group) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < group.components; ++i) total += group.g[i] * group.d[i];
    });
    return sum(total);
  }

  double step_limit() const {
    Lanes worst = {};
    each([&](const auto& group) { worst = max(worst, group.inverse_limit()); });
    const double inverse = -least(-worst);
    return inverse > 0 ? 1 / inverse : kInfinity;
  }

  void advance(double t) {
    each([t](auto& group) {
      GRASPFORCE_UNROLL
      for (int i = 0; i < group.components; ++i) group.c[i] += t * group.d[i];
    });
  }

  void get_multipliers(double* nu) const {
    for (int r = 0; r < layout_.wrench_rows; ++r) nu[r] = 0;
    for (int r = 0; r < k_; ++r) nu[row_[r]] = nu_[r] / cone_weight_;
  }

  double decrement_bound(double lambda) {
    if (!evaluate<false>()) return kInfinity;
    Lanes rhs[kWrench];
    each_and_first(
        [&](auto& group, auto first) { group.template add_gradient<first>(rhs, false); });
    add_lanes(rhs, nu_);
    system_.solve(nu_);
    Lanes squared = {};
    each([&](auto& group) {
      Lanes left[std::decay_t<decltype(group)>::components];
      squared += group.residual(nu_, left);
    });
    return std::sqrt(sum(squared)) / (1 - lambda);
  }

 private:
  template <class Visit>
  void each(Visit visit) {
    std::apply([&](auto&... lists) { (visit_all(lists, visit), ...); }, groups_);
  }
  template <class Visit>
  void each(Visit visit) const {
    std::apply([&](const auto&... lists) { (visit_all(lists, visit), ...); }, groups_);
  }
  template <class List, class Visit>
  static void visit_all(List& list, Visit& visit) {
    for (auto& group : list) visit(group);
  }

  // Visits every group and tells at compile time which is the first.
  template <class Visit>
  void each_and_first(Visit visit) {
    bool first = true;
    each([&](auto& group) {
      if (first)
        visit(group, std::true_type{});
      else
        visit(group, std::false_type{});
      first = false;
    });
  }

  template <bool with_hessian>
  bool evaluate() {
    Lanes worst = splat(kInfinity);
    each([&](auto& group) {
      worst = min(worst, group.template evaluate<with_hessian>(cone_weight_, limit_weight_,
                                                               layout_.ceilings, layout_.floors));
    });
    return least(worst) > 0;
  }

  static void add_lanes(const Lanes* rhs, double* x) {
    const Lanes low = sums(rhs[0], rhs[1], rhs[2], rhs[3]),
                high = sums(rhs[4], rhs[5], rhs[4], rhs[5]);
    for (int r = 0; r < kWrench; ++r) x[r] = r < kLanes ? low[r] : high[r - kLanes];
  }

  template <int Q>
  void allot_groups(const Structure& structure) {
    auto& list = std::get<std::vector<LaneGroup<Q>>>(groups_);
    list.clear();
    std::size_t members = 0;
    for (const Block& block : structure.blocks()) members += block.components.size() == Q;
    list.resize((members + kLanes - 1) / kLanes);
    members_ += static_cast<int>(members);
    std::size_t next = 0;
    for (const Block& block : structure.blocks()) {
      if (block.components.size() != Q) continue;
      LaneGroup<Q>& group = list[next / kLanes];
      group.two_sided = std::max(group.two_sided, static_cast<int>(block.joints.size()));
      ++next;
    }
    next = 0;
    for (const Block& block : structure.blocks()) {
      if (block.components.size() != Q) continue;
      LaneGroup<Q>& group = list[next / kLanes];
      const int lane = static_cast<int>(next++ % kLanes);
      group.contact[lane] = block.contacts[0];
      group.members = lane + 1;
      group.mask[lane] = 1;
      // Lanes that stay empty read what the last contact reads, and mask it.
      for (int l = lane; l < kLanes; ++l) group.start[l] = block.components[0];
      group.rows.resize(std::max(group.rows.size(), group.two_sided + block.inequalities.size()));
      auto occupy = [lane](LaneRow<Q>& row, int source) {
        row.mask[lane] = 1;
        row.source[lane] = source;
      };
      for (std::size_t r = 0; r < block.joints.size(); ++r) occupy(group.rows[r], block.joints[r]);
      for (std::size_t r = 0; r < block.inequalities.size(); ++r)
        occupy(group.rows[group.two_sided + r], block.inequalities[r]);
    }
  }

  void load_wrench_rows(const Problem& p) {
    each([&](auto& group) { group.load_map(p.W, components_, row_, k_); });
  }

  void load_limits(const Problem& p) {
    const double weakest = std::min(1.0, *p.alpha);
    cone_weight_ = 1 / weakest;
    limit_weight_ = *p.alpha / weakest;
    each([&](auto& group) { group.load_limits(p, layout_, components_); });
  }

  const Layout& layout_;
  const int components_ = layout_.components();
  std::tuple<std::vector<LaneGroup<1>>, std::vector<LaneGroup<3>>, std::vector<LaneGroup<4>>>
      groups_;
  WrenchSystem system_;
  int members_ = 0;  // contacts in the grasp
  int k_ = 0, row_[kWrench] = {};
  double f_[kWrench] = {}, nu_[kWrench] = {};
  double cone_weight_ = 1, limit_weight_ = 1, smallest_pivot_ = 1;
};

}  // namespace graspforce
