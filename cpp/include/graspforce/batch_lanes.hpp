// Newton's method on four problems of a batch at a time, one a lane: newton.hpp lane by lane, with
// the kernels of lane_group.hpp, of which a group is here one contact of the four problems.
//
// Every operation is one of a lane by itself, and so is every decision: what a row comes to does
// not depend on the rows beside it. A row that Newton's method does not certify is handed back, for
// the engine to solve from the beginning.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/answer.hpp"
#include "graspforce/batch_rows.hpp"
#include "graspforce/history.hpp"
#include "graspforce/lane_group.hpp"
#include "graspforce/newton.hpp"

namespace graspforce {

using LaneMask = decltype(Lanes{} < Lanes{});

inline bool any(LaneMask m) { return ((m[0] | m[1]) | (m[2] | m[3])) != 0; }
inline bool all(LaneMask m) { return ((m[0] & m[1]) & (m[2] & m[3])) != 0; }

// Q is the most components of a contact.
template <int Q>
class BatchLanes {
 public:
  explicit BatchLanes(const BatchRows& rows)
      : rows_(rows),
        layout_(rows.layout),
        groups_(layout_.contacts()),
        limits_(std::size_t(layout_.contacts()) * layout_.joints),
        saved_(groups_.size()),
        shared_limits_(rows.share_limits()) {
    outside_.reserve(std::size_t(layout_.components()) * layout_.joints);
    owner_.assign(layout_.joints, kNone);
    for (int i = 0, first = 0; i < layout_.contacts(); first += int(layout_.models[i++])) {
      const int dim = int(layout_.models[i]);
      Group& group = groups_[i];
      first_.push_back(first);
      dims_.push_back(dim);
      contact_of_.insert(contact_of_.end(), dim, i);
      group.members = kLanes;
      group.padding = Lanes{};
      group.has_friction = splat(dim > 1 ? 1 : 0);
      group.has_torsion = splat(dim > 3 ? 1 : 0);
      for (int d = 0; d < dim; ++d) group.mask[d] = splat(1);
      group.rows = {limits_.data() + std::size_t(i) * layout_.joints, 0};
    }
    find_outside();
  }
  BatchLanes(const BatchLanes&) = delete;
  BatchLanes& operator=(const BatchLanes&) = delete;

  // Whether the lanes are made for problems of a layout.
  static bool fits(const Layout& layout) {
    return layout.contacts() <= kMostContacts && layout.wrench_rows <= kWrench &&
           layout.inequalities == 0 && layout.internals == 0 && !layout.rate_limits &&
           !layout.soft_wrench && (layout.joints > 0 || layout.ceilings);
  }

  // Solves the rows from `begin` to `end`. Answers go to writer.write(row, answer), rows that are
  // not for the lanes to hand_back(row).
  template <class Writer, class HandBack>
  void run(std::ptrdiff_t begin, std::ptrdiff_t end, Writer& writer, HandBack hand_back) {
    next_ = begin;
    end_ = end;
    for (;;) {
      end_whole_steps(writer, hand_back);
      if (!refill(hand_back)) return;
      evaluate();
      judge(writer, hand_back);
      step(hand_back);
    }
  }

  // What a lane has come to.
  struct Answer {
    const BatchLanes& lanes;
    int lane;

    void get_forces(double* c) const {
      for (const Group& group : lanes.groups_) {
        const int dim = lanes.dims_[&group - lanes.groups_.data()];
        for (int i = 0; i < dim; ++i) *c++ = group.c[i][lane];
      }
    }
    void get_multipliers(double* nu) const {
      for (int r = 0; r < lanes.layout_.wrench_rows; ++r)
        nu[r] = lanes.nu_[r][lane] * lanes.inverse_cone_weight_[lane];
    }
    Result result() const {
      Result result;
      result.status = Status::Solved;
      result.newton_steps = lanes.steps_[lane];
      result.decrement = lanes.bound_[lane];
      result.start = lanes.from_start_[lane] ? Start::Given : Start::Cold;
      return result;
    }
  };

 private:
  using Group = LaneGroup<Q, true>;
  static constexpr int kMostContacts = 8;
  static constexpr int kNone = -1;
  static constexpr int kLower = Group::kLower;
  // A lane has no problem; or one whose point nothing is known of; or one that a step has led to.
  enum class Phase { Empty, Fresh, Stepped };

  bool in_use(int lane) const { return phase_[lane] != Phase::Empty; }
  // Which lanes are in a phase.
  LaneMask mask(Phase phase) const {
    LaneMask m = {};
    for (int l = 0; l < kLanes; ++l) m[l] = phase_[l] == phase ? -1 : 0;
    return m;
  }

  // ---- the problems in the lanes -------------------------------------------------------------

  // Puts problems into empty lanes; false when there are none left in any.
  template <class HandBack>
  bool refill(HandBack hand_back) {
    bool some = false;
    LaneMask cold = {};
    for (int l = 0; l < kLanes; ++l) {
      while (phase_[l] == Phase::Empty && next_ < end_) {
        const std::ptrdiff_t row = next_++;
        if (!load(l, rows_.problem(row))) {
          hand_back(row);
          continue;
        }
        row_[l] = row;
        phase_[l] = Phase::Fresh;
        steps_[l] = 0;
        balanced_[l] = 0;
        const double* start = rows_.start_of(row);
        from_start_[l] = start != nullptr;
        if (start != nullptr)
          set_forces(l, start);
        else
          cold[l] = -1;
      }
      some |= in_use(l);
    }
    if (any(cold)) set_pushes(cold);
    return some;
  }

  // Puts a problem into a lane; false where it is not for the lanes.
  bool load(int l, const Problem& p) {
    if (!shared_limits_ && !rows_.fits_lanes(p)) return false;
    if (layout_.joints > 0 && !outside_.holds(p.J) && !find_owners(p.J)) return false;
    if (shared_limits_ && !limits_loaded_) {
      if (!rows_.fits_lanes(p)) return false;
      for (int lane = 0; lane < kLanes; ++lane) load_limits(lane, p);
      limits_loaded_ = true;
    }
    if (!shared_limits_) load_limits(l, p);
    if (!free_joints_hold_) return false;
    const int m = int(contact_of_.size()), joints = layout_.joints;
    for (int i = 0; i < layout_.contacts(); ++i) {
      Group& group = groups_[i];
      const int dim = dims_[i], first = first_[i];
      const double* from = p.W + first;
      for (int r = 0; r < layout_.wrench_rows; ++r, from += m) take(dim, from, 1, group.W[r], l);
      const std::vector<int>& own = joints_of_[i];
      for (std::size_t r = 0; r < own.size(); ++r)
        take(dim, p.J + first * joints + own[r], joints, group.rows[int(r)].a, l);
    }
    double largest = 0;
    for (int r = 0; r < layout_.wrench_rows; ++r) {
      f_[r][l] = p.f[r];
      largest = std::max(largest, std::abs(p.f[r]));
    }
    largest_f_[l] = largest;
    return true;
  }

  // The numbers of one contact, so far apart, into a lane.
  GRASPFORCE_INLINE static void take(int dim, const double* from, int apart, Lanes* to, int l) {
    if (dim == Q) {
      GRASPFORCE_UNROLL
      for (int d = 0; d < Q; ++d) to[d][l] = from[d * apart];
    } else {
      for (int d = 0; d < dim; ++d) to[d][l] = from[d * apart];
    }
  }

  // Everything but W, J and f.
  void load_limits(int l, const Problem& p) {
    free_joints_hold_ = true;
    for (int j = 0; j < layout_.joints; ++j)  // no contact touches it: a condition by itself
      if (owner_[j] == kNone && !(p.tau_lo[j] < p.tau_bias[j] && p.tau_bias[j] < p.tau_hi[j]))
        free_joints_hold_ = false;
    for (int i = 0; i < layout_.contacts(); ++i) {
      Group& group = groups_[i];
      for (std::size_t r = 0; r < joints_of_[i].size(); ++r) {
        const int j = joints_of_[i][r];
        group.rows[int(r)].lo[l] = p.tau_lo[j] - p.tau_bias[j];
        group.rows[int(r)].hi[l] = p.tau_hi[j] - p.tau_bias[j];
      }
      for (int r = int(joints_of_[i].size()); r < group.rows.size(); ++r) clear(group.rows[r], l);
      group.mu[l] = dims_[i] > 1 ? p.mu[i] : 1;
      if (dims_[i] > 3) group.torsion[l] = p.mu[i] / p.gamma[i];
      if (layout_.ceilings) group.ceiling[l] = normal_ceiling(layout_, p, i);
      if (layout_.floors) group.floor[l] = normal_floor(layout_, p, i);
    }
    inverse_cone_weight_[l] = std::min(1.0, *p.alpha);
    cone_weight_[l] = 1 / inverse_cone_weight_[l];
    limit_weight_[l] = *p.alpha * cone_weight_[l];
    push_[l] = initial_push(p);
  }

  static void clear(LaneRow<Q>& row, int l) {
    for (int d = 0; d < Q; ++d) row.a[d][l] = 0;
    row.lo[l] = -1;
    row.hi[l] = 1;
  }

  // Finds which contact each joint touches; false where one touches several. A joint keeps the
  // contact of the rows before, whose entries may be zero in this one: zeros change nothing.
  bool find_owners(const double* J) {
    const int joints = layout_.joints;
    std::vector<int>& found = found_;
    found.assign(joints, kNone);
    for (int c = 0; c < layout_.components(); ++c)
      for (int j = 0; j < joints; ++j)
        if (J[c * joints + j] != 0) {
          if (found[j] != kNone && found[j] != contact_of_[c]) return false;
          found[j] = contact_of_[c];
        }
    for (int j = 0; j < joints; ++j)
      if (found[j] == kNone) found[j] = owner_[j];
    owner_ = found;
    find_outside();
    limits_loaded_ = false;
    return true;
  }

  void find_outside() {
    joints_of_.resize(layout_.contacts());
    for (int i = 0; i < layout_.contacts(); ++i) {
      joints_of_[i].clear();
      for (int j = 0; j < layout_.joints; ++j)
        if (owner_[j] == i) joints_of_[i].push_back(j);
      Group& group = groups_[i];
      const int needed = int(joints_of_[i].size());
      if (needed <= group.rows.size()) continue;
      group.rows = {group.rows.data(), needed};  // those that are new are clear
      group.two_sided = needed;
    }
    outside_.find(layout_.components(), layout_.joints,
                  [&](int c, int j) { return owner_[j] != contact_of_[c]; });
  }

  // ---- the point ------------------------------------------------------------------------------

  void set_forces(int l, const double* c) {
    for (int i = 0; i < layout_.contacts(); ++i)
      for (int d = 0; d < Q; ++d) groups_[i].c[d][l] = d < dims_[i] ? *c++ : 0;
  }

  // Pure pushes in some lanes; see LaneBarrier::set_pushes.
  void set_pushes(LaneMask which) {
    Lanes known = {};
    for (const Group& group : groups_) {
      const Lanes reach = group.reach();
      known = reach < kInfinity ? max(known, reach) : known;
    }
    const Lanes own = largest_f_ > 0 ? largest_f_ : splat(1);
    const Lanes fallback = known > 0 ? known : own;
    for (Group& group : groups_) {
      Lanes before[Q];
      std::copy_n(group.c, Q, before);
      group.push(push_ * min(group.reach(), fallback), layout_);
      for (int i = 0; i < Q; ++i) group.c[i] = which ? group.c[i] : before[i];
    }
  }

  // Least slack.
  Lanes slack() const {
    Lanes worst = splat(kInfinity);
    for (const Group& group : groups_) worst = min(worst, group.slack(layout_));
    return worst;
  }

  // Where W c = f holds to rounding; see LaneBarrier::balanced.
  LaneMask find_balanced() const {
    Lanes missing[kWrench], worst = {};
    for (int r = 0; r < kWrench; ++r) {
      missing[r] = f_[r];
      for (const Group& group : groups_) missing[r] -= group.wrench(r, group.c);
      worst = max(worst, abs(missing[r]));
    }
    const LaneMask by_f = worst < kBalanced * largest_f_;
    if (all(by_f)) return by_f;
    Lanes size = {};
    for (int r = 0; r < kWrench; ++r) {
      Lanes part = abs(f_[r]);
      for (const Group& group : groups_)
        for (int i = 0; i < Q; ++i) part += abs(group.W[r][i] * group.c[i]);
      size = max(size, part);
    }
    return by_f | ((size < kInfinity) & (worst < kBalanced * size));
  }

  // Where the forces are out of all proportion to the limits.
  LaneMask find_runaway() const {
    Lanes force = {};
    for (const Group& group : groups_)
      for (int i = 0; i < Q; ++i) force = max(force, abs(group.c[i]));
    const LaneMask suspicious = force > 1e-3 * kRunaway * largest_f_;
    if (!any(suspicious)) return suspicious;
    Lanes size = largest_f_;
    for (const Group& group : groups_) size = max(size, group.size(layout_));
    return force > kRunaway * size;
  }

  // ---- Newton's method, in the order of `minimise` ----------------------------------------------

  // Ends the lanes whose last step has certified its own end.
  template <class Writer, class HandBack>
  void end_whole_steps(Writer& writer, HandBack hand_back) {
    const LaneMask sure = mask(Phase::Stepped) & (bound_ * bound_ / 2 <= rows_.settings.tol);
    if (any(sure)) end(sure & find_balanced(), slack() > 0, writer, hand_back);
  }

  // Ends lanes at a certified point.
  template <class Writer, class HandBack>
  void end(LaneMask certified, LaneMask inside, Writer& writer, HandBack hand_back) {
    if (!any(certified)) return;
    const LaneMask good = inside & ~find_runaway();
    for (int l = 0; l < kLanes; ++l) {
      if (!certified[l]) continue;
      phase_[l] = Phase::Empty;
      if (good[l])
        writer.write(row_[l], Answer{*this, l});
      else
        hand_back(row_[l]);
    }
  }

  // Gradient and Hessian in all lanes, and where the point is inside.
  void evaluate() {
    Lanes worst = splat(kInfinity);
    for (Group& group : groups_)
      worst = min(worst, group.template evaluate<true>(cone_weight_, limit_weight_, layout_));
    inside_ = worst > 0;
  }

  // Judges the points that steps have led to.
  template <class Writer, class HandBack>
  void judge(Writer& writer, HandBack hand_back) {
    LaneMask stepped = mask(Phase::Stepped);
    const LaneMask open =
        stepped & inside_ & (bound_ < kInfinity) & (bound_ * bound_ / 2 > rows_.settings.tol);
    if (any(open)) {
      const Lanes closer = decrement_bound(open);
      bound_ = open ? min(bound_, closer) : bound_;
      const LaneMask certified = open & (bound_ * bound_ / 2 <= rows_.settings.tol);
      if (any(certified)) {
        end(certified & find_balanced(), inside_, writer, hand_back);
        stepped = mask(Phase::Stepped);
      }
    }
    shorten(stepped);
    const LaneMask whole = taken_ == 1;
    for (int l = 0; l < kLanes; ++l) {
      if (phase_[l] == Phase::Fresh && !inside_[l]) {
        if (!from_start_[l]) {
          refuse(l, hand_back);
        } else {  // pushes in place of a start that is outside, to be evaluated with the next lanes
          from_start_[l] = false;
          LaneMask only = {};
          only[l] = -1;
          set_pushes(only);
          waiting_[l] = -1;
        }
      } else if (phase_[l] == Phase::Stepped) {
        balanced_[l] |= whole[l];
        const bool lost = !inside_[l] || steps_[l] >= rows_.settings.max_steps ||
                          (!balanced_[l] && steps_[l] >= kMaxUnbalancedSteps) ||
                          (steps_[l] >= kMaxSlowSteps && bound_[l] >= 1);
        if (lost) refuse(l, hand_back);
      }
    }
  }

  template <class HandBack>
  void refuse(int l, HandBack hand_back) {
    phase_[l] = Phase::Empty;
    hand_back(row_[l]);
  }

  // c ← c + t d in some lanes; in the others d may be anything.
  void advance(LaneMask which, Lanes t) {
    for (Group& group : groups_)
      for (int i = 0; i < Q; ++i) group.c[i] = which ? group.c[i] + t * group.d[i] : group.c[i];
  }

  // Takes back what of a step overshoots the minimum along it.
  void shorten(LaneMask stepped) {
    const Lanes safe = balanced_ ? 1 / (1 + lambda_) : taken_;
    for (;;) {
      LaneMask over = stepped & inside_ & (taken_ > safe);
      if (!any(over)) return;
      Lanes slope = {};
      for (const Group& group : groups_)
        for (int i = 0; i < Q; ++i) slope += group.g[i] * group.d[i];
      over &= slope > 0.5 * lambda_ * lambda_;
      if (!any(over)) return;
      const Lanes shorter = max(safe, taken_ / 2);
      advance(over, shorter - taken_);
      taken_ = over ? shorter : taken_;
      bound_ = over ? splat(kInfinity) : bound_;
      evaluate();
    }
  }

  // Bounds on the decrement where whole steps have led to; see LaneBarrier::decrement_bound. The
  // factors of the steps are those of the points before, which `evaluate` has overwritten.
  Lanes decrement_bound(LaneMask which) {
    swap_factors();
    Lanes nu[kWrench] = {}, squared = {};
    for (Group& group : groups_) group.template add_gradient<false>(nu);
    lane_ldl::solve<kWrench>(S_, inverse_S_, nu);
    for (const Group& group : groups_) {
      Lanes left[Q];
      squared += group.residual(nu, left);
    }
    swap_factors();
    for (int r = 0; r < kWrench; ++r) nu_[r] = which ? nu[r] : nu_[r];
    return sqrt(squared) / (1 - lambda_);
  }

  void swap_factors() {
    for (std::size_t i = 0; i < groups_.size(); ++i) {
      std::swap_ranges(groups_[i].H, groups_[i].H + kLower, saved_[i].L);
      std::swap_ranges(groups_[i].inverse, groups_[i].inverse + Q, saved_[i].inverse);
    }
  }

  // Newton steps in all lanes, taken as far as their decrements allow.
  template <class HandBack>
  void step(HandBack hand_back) {
    newton();
    Lanes far = splat(1);
    LaneMask moving = {};
    for (int l = 0; l < kLanes; ++l) {
      if (!in_use(l)) continue;
      if (waiting_[l]) {
        waiting_[l] = 0;
        continue;
      }
      if (!std::isfinite(lambda_[l]) || (phase_[l] == Phase::Fresh && !sound_[l])) {
        refuse(l, hand_back);
        continue;
      }
      phase_[l] = Phase::Stepped;
      ++steps_[l];
      moving[l] = -1;
    }
    const LaneMask long_steps = moving & (lambda_ >= 0.25);
    if (any(long_steps)) {
      Lanes worst = {};
      for (const Group& group : groups_) worst = max(worst, group.inverse_limit(layout_));
      far = long_steps & (worst > 0.9) ? 0.9 / worst : far;
    }
    taken_ = far;
    advance(moving, taken_);
    const Lanes ratio = lambda_ / (1 - lambda_);
    bound_ = (taken_ == 1) & (lambda_ < 1) ? ratio * ratio : splat(kInfinity);
  }

  // The steps d, their decrements and multipliers; near a minimum for the change of the last
  // multipliers, see Barrier::newton_from_multipliers.
  void newton() {
    const LaneMask near = mask(Phase::Stepped) & (bound_ < 1);
    Lanes last_nu[kWrench];
    for (int r = 0; r < kWrench; ++r) last_nu[r] = near ? nu_[r] : Lanes{};
    WrenchSums total;
    for (int r = 0; r < kWrench; ++r) total.rhs()[r] = f_[r];
    bool first = true;
    for (Group& group : groups_) {
      group.subtract_wrench(last_nu);
      if (first)
        group.template add<true>(total);
      else
        group.template add<false>(total);
      first = false;
    }
    Lanes before[kWrench];
    for (int r = 0; r < kWrench; ++r) {
      Lanes& diagonal = total.v[lane_ldl::at(r, r)];
      if (r >= layout_.wrench_rows) diagonal += 1;  // a row that is not in use
      before[r] = diagonal;
    }
    std::copy_n(total.v, WrenchSums::kTriangle, S_);
    lane_ldl::factor<kWrench>(S_, inverse_S_);
    sound_ = LaneMask{} == LaneMask{};
    for (int r = 0; r < kWrench; ++r) {
      sound_ &= kSuspectPivot * before[r] * inverse_S_[r] < 1;
      nu_[r] = total.rhs(r);
    }
    lane_ldl::solve<kWrench>(S_, inverse_S_, nu_);
    Lanes squared = {};
    for (std::size_t i = 0; i < groups_.size(); ++i) {
      squared += groups_[i].step(nu_);
      std::copy_n(groups_[i].H, kLower, saved_[i].L);
      std::copy_n(groups_[i].inverse, Q, saved_[i].inverse);
    }
    lambda_ = sqrt(squared);
    for (int r = 0; r < kWrench; ++r) nu_[r] += last_nu[r];
  }

  struct Factor {
    Lanes L[kLower], inverse[Q];
  };

  const BatchRows& rows_;
  const Layout& layout_;
  std::vector<Group> groups_;       // one a contact
  std::vector<LaneRow<Q>> limits_;  // of the contacts' joints, room for all joints at each
  std::vector<Factor> saved_;       // of the last step
  std::vector<int> first_, dims_, contact_of_, owner_, found_;
  std::vector<std::vector<int>> joints_of_;
  Pattern outside_;           // entries of J that are zero, as far as joints have owners
  const bool shared_limits_;  // all rows have the limits and coefficients of the first
  bool limits_loaded_ = false, free_joints_hold_ = true;

  std::ptrdiff_t next_ = 0, end_ = 0;
  std::ptrdiff_t row_[kLanes] = {};
  Phase phase_[kLanes] = {};
  int steps_[kLanes] = {};
  bool from_start_[kLanes] = {};
  LaneMask waiting_ = {};  // lanes whose point has changed since it was evaluated
  LaneMask inside_ = {}, balanced_ = {}, sound_ = {};
  Lanes f_[kWrench] = {}, nu_[kWrench] = {}, largest_f_ = {};
  Lanes cone_weight_ = splat(1), limit_weight_ = splat(1), inverse_cone_weight_ = splat(1);
  Lanes push_ = splat(0.1), lambda_ = {}, bound_ = {}, taken_ = {};
  Lanes S_[WrenchSums::kTriangle] = {}, inverse_S_[kWrench] = {};
};

}  // namespace graspforce
