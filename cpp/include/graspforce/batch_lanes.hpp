// Newton's method on four or eight problems of a batch at a time, one a lane: newton.hpp lane by
// lane, with the kernels of lane_group.hpp, of which a group is here one contact of the problems.
//
// Every operation is one of a lane by itself, and so is every decision: what a row comes to does
// not depend on the rows beside it. A row that Newton's method does not certify is handed back, for
// the engine to solve from the beginning.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "graspforce/answer.hpp"
#include "graspforce/batch_rows.hpp"
#include "graspforce/history.hpp"
#include "graspforce/lane_group.hpp"
#include "graspforce/newton.hpp"

namespace graspforce {

// Of problems side by side as many as a register holds.
#if defined(__AVX512F__)
using BatchVector = WideLanes;
#else
using BatchVector = Lanes;
#endif

// Q is the most components of a contact, V the vector with a problem in each lane.
template <int Q, class V = BatchVector>
class BatchLanes {
 public:
  explicit BatchLanes(const BatchRows& rows)
      : rows_(rows),
        layout_(rows.layout),
        groups_(layout_.contacts()),
        limits_(std::size_t(layout_.contacts()) * layout_.joints),
        saved_(groups_.size()),
        torques_{BatchRows::shared({rows.fields.tau_lo, rows.fields.tau_hi, rows.fields.tau_bias})},
        coefficients_{rows.share_coefficients()} {
    outside_.reserve(std::size_t(layout_.components()) * layout_.joints);
    owner_.assign(layout_.joints, kNone);
    for (int i = 0, first = 0; i < layout_.contacts(); first += int(layout_.models[i++])) {
      const int dim = int(layout_.models[i]);
      Group& group = groups_[i];
      first_.push_back(first);
      dims_.push_back(dim);
      contact_of_.insert(contact_of_.end(), dim, i);
      group.padding = V{};
      group.has_friction = splat<V>(dim > 1 ? 1 : 0);
      group.has_torsion = splat<V>(dim > 3 ? 1 : 0);
      for (int d = 0; d < dim; ++d) group.mask[d] = splat<V>(1);
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

  // Solves the KKT systems of factor.hpp for the rows from `begin` to `end` that are wanted, in
  // place for a right-hand side (g, r) a row; forces c, wanted and x begin with the first row's.
  // Rows that are not for the lanes, those close to their limits among them, go to hand_back(row).
  template <class HandBack>
  void solve_kkt(std::ptrdiff_t begin, std::ptrdiff_t end, const double* c, const bool* wanted,
                 double* x, HandBack hand_back) {
    const std::ptrdiff_t m = layout_.components(), line = m + layout_.wrench_rows;
    stepped_ = 0;
    for (std::ptrdiff_t first = begin; first < end; first += kLanes) {
      Bits used = 0;
      for (int l = 0; l < kLanes && first + l < end; ++l)
        if (wanted[first + l - begin] && load(l, rows_.problem(first + l))) {
          set_forces(l, c + (first + l - begin) * m);
          used |= 1u << l;
        }
      evaluate();
      used &= inside_;
      V diagonal[kMostContacts][Q];
      for (int i = 0; i < layout_.contacts(); ++i)
        for (int d = 0; d < Q; ++d) diagonal[i][d] = groups_[i].H[lane_ldl::at(d, d)];
      each(used, [&](int l) { set_sides(l, x + (first + l - begin) * line); });
      newton();
      V stretch = stretch_;
      for (int i = 0; i < layout_.contacts(); ++i)
        for (int d = 0; d < Q; ++d) stretch = max(stretch, diagonal[i][d] * groups_[i].inverse[d]);
      used &= bits_of((stretch < kMostStretch) & (lambda_ < kInfinity));
      for (int l = 0; l < kLanes && first + l < end; ++l)
        if ((used >> l & 1u) != 0)
          get_solution(l, x + (first + l - begin) * line);
        else
          hand_back(first + l);
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
  using Group = LaneGroup<Q, true, V>;
  using Mask = MaskOf<V>;
  using Bits = unsigned;  // one a lane
  static constexpr int kLanes = kLanesOf<V>;
  static constexpr Bits kAll = (1u << kLanes) - 1;
  static constexpr int kMostContacts = 8;
  static constexpr int kNone = -1;
  static constexpr int kLower = Group::kLower;
  // Diagonal entry beside its pivot up to which a KKT system is solved to 1e-11 or so.
  static constexpr double kMostStretch = 1e4;

  // Calls work(lane) for lanes in turn.
  template <class Work>
  static void each(Bits lanes, Work work) {
    for (; lanes != 0; lanes &= lanes - 1) work(lowest(lanes));
  }

  // ---- the problems in the lanes -------------------------------------------------------------

  // Puts problems into empty lanes; false when there are none left in any.
  template <class HandBack>
  bool refill(HandBack hand_back) {
    each(kAll & ~(fresh_ | stepped_), [&](int l) {
      while (next_ < end_) {
        const std::ptrdiff_t row = next_++;
        if (!load(l, rows_.problem(row))) {
          hand_back(row);
          continue;
        }
        row_[l] = row;
        fresh_ |= 1u << l;
        steps_[l] = 0;
        balanced_[l] = 0;
        const double* start = rows_.start_of(row);
        from_start_[l] = start != nullptr;
        if (start != nullptr)
          set_forces(l, start);
        else
          set_pushes(l);
        return;
      }
    });
    return (fresh_ | stepped_) != 0;
  }

  // Fields that are loaded into a lane with each problem; where all rows share them, once.
  struct Part {
    bool shared;
    Bits loaded = 0;

    bool has(int l) const { return shared && (loaded >> l & 1u) != 0; }
  };

  // Puts a problem into a lane; false where it is not for the lanes.
  bool load(int l, const Problem& p) {
    if (layout_.joints > 0 && !outside_.holds(p.J) && !find_owners(p.J)) return false;
    if (!coefficients_.has(l)) {
      if (!rows_.coefficients_fit(p)) return false;
      load_coefficients(l, p);
      coefficients_.loaded |= 1u << l;
    }
    if (!torques_.has(l)) {
      if (!rows_.torques_fit(p) || !free_joints_hold(p)) return false;
      load_torques(l, p);
      torques_.loaded |= 1u << l;
    }
    const int contacts = int(groups_.size());
    for (int i = 0; i < contacts; ++i) {
      if (dims_[i] == Q && layout_.wrench_rows == kWrench)
        take_matrices<kWrench, Q>(l, i, kWrench, Q, p);
      else
        take_matrices<0, 0>(l, i, layout_.wrench_rows, dims_[i], p);
    }
    double largest = 0;
    for (int r = 0; r < layout_.wrench_rows; ++r) {
      f_[r][l] = p.f[r];
      largest = std::max(largest, std::abs(p.f[r]));
    }
    largest_f_[l] = largest;
    return true;
  }

  // A contact's columns of W and rows of J into a lane. Where the template's numbers are the
  // matrices' own and not 0, the compiler unrolls what is most of the work of a warm row.
  template <int rows, int components>
  GRASPFORCE_INLINE void take_matrices(int l, int i, int wrench_rows, int dim, const Problem& p) {
    const int m = int(contact_of_.size()), joints = layout_.joints;
    const int height = rows > 0 ? rows : wrench_rows, width = components > 0 ? components : dim;
    Group& group = groups_[i];
    const double* from = p.W + first_[i];
    GRASPFORCE_UNROLL
    for (int r = 0; r < height; ++r, from += m) {
      GRASPFORCE_UNROLL
      for (int d = 0; d < width; ++d) group.W[r][d][l] = from[d];
    }
    from = p.J + first_[i] * joints;
    LaneRow<Q, V>* row = group.rows.data();
    for (int j : joints_of_[i]) {
      GRASPFORCE_UNROLL
      for (int d = 0; d < width; ++d) row->a[d][l] = from[j + d * joints];
      ++row;
    }
  }

  // A joint that no contact touches is a condition by itself.
  bool free_joints_hold(const Problem& p) const {
    for (int j = 0; j < layout_.joints; ++j)
      if (owner_[j] == kNone && !(p.tau_lo[j] < p.tau_bias[j] && p.tau_bias[j] < p.tau_hi[j]))
        return false;
    return true;
  }

  void load_torques(int l, const Problem& p) {
    for (int i = 0; i < layout_.contacts(); ++i) {
      const Span<LaneRow<Q, V>> rows = groups_[i].rows;
      const std::vector<int>& own = joints_of_[i];
      for (std::size_t r = 0; r < own.size(); ++r) {
        rows[int(r)].lo[l] = p.tau_lo[own[r]] - p.tau_bias[own[r]];
        rows[int(r)].hi[l] = p.tau_hi[own[r]] - p.tau_bias[own[r]];
      }
      for (int r = int(own.size()); r < rows.size(); ++r) {
        for (int d = 0; d < Q; ++d) rows[r].a[d][l] = 0;
        rows[r].lo[l] = -1;
        rows[r].hi[l] = 1;
      }
    }
  }

  void load_coefficients(int l, const Problem& p) {
    for (int i = 0; i < layout_.contacts(); ++i) {
      Group& group = groups_[i];
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
    torques_.loaded = 0;  // lanes in use keep theirs until they are through
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

  // The sides of a KKT system in a lane, as those of a step from c = 0 with the gradient −g that
  // makes up for r. H is that of Phi over its unit, and so are g and ν.
  void set_sides(int l, const double* side) {
    for (int i = 0; i < layout_.contacts(); ++i)
      for (int d = 0; d < Q; ++d) {
        groups_[i].c[d][l] = 0;
        groups_[i].g[d][l] = d < dims_[i] ? -cone_weight_[l] * *side++ : 0;
      }
    for (int r = 0; r < layout_.wrench_rows; ++r) f_[r][l] = side[r];
  }
  void get_solution(int l, double* x) const {
    for (int i = 0; i < layout_.contacts(); ++i)
      for (int d = 0; d < dims_[i]; ++d) *x++ = groups_[i].d[d][l];
    for (int r = 0; r < layout_.wrench_rows; ++r) x[r] = -nu_[r][l] * inverse_cone_weight_[l];
  }

  // Pure pushes in a lane; see LaneBarrier::set_pushes.
  void set_pushes(int l) {
    double reach[kMostContacts], known = 0;
    for (int i = 0; i < layout_.contacts(); ++i) {
      reach[i] = groups_[i].reach(l);
      if (reach[i] < kInfinity) known = std::max(known, reach[i]);
    }
    const double fallback = known > 0 ? known : largest_f_[l] > 0 ? largest_f_[l] : 1;
    for (int i = 0; i < layout_.contacts(); ++i)
      groups_[i].push(l, push_[l] * std::min(reach[i], fallback));
  }

  // Least slack.
  V slack() const {
    V worst = splat<V>(kInfinity);
    for (const Group& group : groups_) worst = min(worst, group.slack(layout_));
    return worst;
  }

  // In which of some lanes W c = f holds to rounding; see LaneBarrier::balanced.
  Bits balanced(Bits asked) const {
    V missing[kWrench], worst = {};
    for (int r = 0; r < kWrench; ++r) {
      missing[r] = f_[r];
      for (const Group& group : groups_) missing[r] -= group.wrench(r, group.c);
      worst = max(worst, abs(missing[r]));
    }
    const Bits by_f = bits_of(worst < kBalanced * largest_f_);
    if ((asked & ~by_f) == 0) return asked;
    V size = {};
    for (int r = 0; r < kWrench; ++r) {
      V part = abs(f_[r]);
      for (const Group& group : groups_)
        for (int i = 0; i < Q; ++i) part += abs(group.W[r][i] * group.c[i]);
      size = max(size, part);
    }
    return asked & (by_f | bits_of((size < kInfinity) & (worst < kBalanced * size)));
  }

  // Where the forces are out of all proportion to the limits.
  Mask find_runaway() const {
    V force = {};
    for (const Group& group : groups_)
      for (int i = 0; i < Q; ++i) force = max(force, abs(group.c[i]));
    const Mask suspicious = force > 1e-3 * kRunaway * largest_f_;
    if (bits_of(suspicious) == 0) return suspicious;
    V size = largest_f_;
    for (const Group& group : groups_) size = max(size, group.size(layout_));
    return force > kRunaway * size;
  }

  // ---- Newton's method, in the order of `minimise` ----------------------------------------------

  // Where the bound on the decrement is small enough.
  Mask certified() const { return bound_ * bound_ / 2 <= rows_.settings.tol; }

  // Ends the lanes whose last step has certified its own end.
  template <class Writer, class HandBack>
  void end_whole_steps(Writer& writer, HandBack hand_back) {
    const Bits sure = stepped_ & bits_of(certified());
    if (sure != 0) end(balanced(sure), bits_of(slack() > 0), writer, hand_back);
  }

  // Ends lanes at a certified point.
  template <class Writer, class HandBack>
  void end(Bits certified, Bits inside, Writer& writer, HandBack hand_back) {
    if (certified == 0) return;
    stepped_ &= ~certified;
    const Bits good = certified & inside & ~bits_of(find_runaway());
    each(good, [&](int l) { writer.write(row_[l], Answer{*this, l}); });
    each(certified & ~good, [&](int l) { hand_back(row_[l]); });
  }

  // Gradient and Hessian in all lanes, and where the point is inside.
  void evaluate() {
    V worst = splat<V>(kInfinity);
    for (Group& group : groups_)
      worst = min(worst, group.template evaluate<true>(cone_weight_, limit_weight_, layout_));
    inside_ = bits_of(worst > 0);
  }

  // Judges the points that steps have led to.
  template <class Writer, class HandBack>
  void judge(Writer& writer, HandBack hand_back) {
    const Bits open = stepped_ & inside_ & bits_of((bound_ < kInfinity) & ~certified());
    if (open != 0) {
      const V closer = decrement_bound(mask_of<V>(open));
      bound_ = select(mask_of<V>(open), min(bound_, closer), bound_);
      const Bits closed = open & bits_of(certified());
      if (closed != 0) end(balanced(closed), inside_, writer, hand_back);
    }
    shorten();
    each(fresh_ & ~inside_, [&](int l) {
      if (!from_start_[l]) return refuse(l, hand_back);
      from_start_[l] = false;  // pushes in its place, to be evaluated with the next lanes
      set_pushes(l);
      waiting_ |= 1u << l;
    });
    balanced_ |= mask_of<V>(stepped_) & (taken_ == 1);
    const Bits restored = bits_of(balanced_), far = bits_of(bound_ >= 1);
    each(stepped_, [&](int l) {
      const Bits own = 1u << l;
      const bool lost = !(inside_ & own) || steps_[l] >= rows_.settings.max_steps ||
                        (!(restored & own) && steps_[l] >= kMaxUnbalancedSteps) ||
                        ((far & own) && steps_[l] >= kMaxSlowSteps);
      if (lost) refuse(l, hand_back);
    });
  }

  template <class HandBack>
  void refuse(int l, HandBack hand_back) {
    fresh_ &= ~(1u << l);
    stepped_ &= ~(1u << l);
    hand_back(row_[l]);
  }

  // c ← c + t d in some lanes; in the others d may be anything.
  void advance(Mask which, V t) {
    for (Group& group : groups_)
      for (int i = 0; i < Q; ++i)
        group.c[i] = select(which, group.c[i] + t * group.d[i], group.c[i]);
  }

  // Takes back what of a step overshoots the minimum along it.
  void shorten() {
    const V safe = select(balanced_, 1 / (1 + lambda_), taken_);
    for (;;) {
      Bits over = stepped_ & inside_ & bits_of(taken_ > safe);
      if (over == 0) return;
      V slope = {};
      for (const Group& group : groups_)
        for (int i = 0; i < Q; ++i) slope += group.g[i] * group.d[i];
      over &= bits_of(slope > 0.5 * lambda_ * lambda_);
      if (over == 0) return;
      const Mask which = mask_of<V>(over);
      const V shorter = max(safe, taken_ / 2);
      advance(which, shorter - taken_);
      taken_ = select(which, shorter, taken_);
      bound_ = select(which, splat<V>(kInfinity), bound_);
      evaluate();
    }
  }

  // Bounds on the decrement where whole steps have led to; see LaneBarrier::decrement_bound. The
  // factors are those of the points before, which the steps were made with.
  V decrement_bound(Mask which) {
    V nu[kWrench] = {}, squared = {};
    for (std::size_t i = 0; i < groups_.size(); ++i)
      groups_[i].template add_gradient<false>(nu, saved_[i].L, saved_[i].inverse);
    lane_ldl::solve<kWrench>(S_, inverse_S_, nu);
    for (std::size_t i = 0; i < groups_.size(); ++i) {
      V left[Q];
      squared += groups_[i].residual(nu, left, saved_[i].L, saved_[i].inverse);
    }
    for (int r = 0; r < kWrench; ++r) nu_[r] = select(which, nu[r], nu_[r]);
    return sqrt(squared) / (1 - lambda_);
  }

  // Newton steps in all lanes, taken as far as their decrements allow.
  template <class HandBack>
  void step(HandBack hand_back) {
    newton();
    const Bits useless =
        bits_of(~(lambda_ < kInfinity)) | (fresh_ & ~bits_of(kSuspectPivot * stretch_ < 1));
    each((fresh_ | stepped_) & ~waiting_ & useless, [&](int l) { refuse(l, hand_back); });
    const Bits moving = (fresh_ | stepped_) & ~waiting_;
    each(moving, [&](int l) { ++steps_[l]; });
    stepped_ |= moving;
    fresh_ &= ~moving;
    waiting_ = 0;
    const Mask is_long = mask_of<V>(moving) & (lambda_ >= 0.25);
    taken_ = splat<V>(1);
    if (bits_of(is_long) != 0) {
      V worst = {};
      for (const Group& group : groups_) worst = max(worst, group.inverse_limit(layout_));
      taken_ = select(is_long & (worst > 0.9), 0.9 / worst, taken_);
    }
    advance(mask_of<V>(moving), taken_);
    const V ratio = lambda_ / (1 - lambda_);
    bound_ = select((taken_ == 1) & (lambda_ < 1), ratio * ratio, splat<V>(kInfinity));
  }

  // The steps d, their decrements and multipliers; near a minimum for the change of the last
  // multipliers, see Barrier::newton_from_multipliers.
  void newton() {
    const Mask near = mask_of<V>(stepped_) & (bound_ < 1);
    V last_nu[kWrench];
    for (int r = 0; r < kWrench; ++r) last_nu[r] = select(near, nu_[r], V{});
    SumsOf<V> total;
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
    V before[kWrench];
    for (int r = 0; r < kWrench; ++r) {
      V& diagonal = total.v[lane_ldl::at(r, r)];
      if (r >= layout_.wrench_rows) diagonal += 1;  // a row that is not in use
      before[r] = diagonal;
    }
    std::copy_n(total.v, SumsOf<V>::kTriangle, S_);
    lane_ldl::factor<kWrench>(S_, inverse_S_);
    stretch_ = V{};
    for (int r = 0; r < kWrench; ++r) {
      stretch_ = max(stretch_, before[r] * inverse_S_[r]);
      nu_[r] = total.rhs(r);
    }
    lane_ldl::solve<kWrench>(S_, inverse_S_, nu_);
    V squared = {};
    for (std::size_t i = 0; i < groups_.size(); ++i) {
      squared += groups_[i].step(nu_);
      std::copy_n(groups_[i].H, kLower, saved_[i].L);
      std::copy_n(groups_[i].inverse, Q, saved_[i].inverse);
    }
    lambda_ = sqrt(squared);
    for (int r = 0; r < kWrench; ++r) nu_[r] += last_nu[r];
  }

  struct Factor {
    V L[kLower], inverse[Q];
  };

  const BatchRows& rows_;
  const Layout& layout_;
  std::vector<Group> groups_;          // one a contact
  std::vector<LaneRow<Q, V>> limits_;  // of the contacts' joints, room for all joints at each
  std::vector<Factor> saved_;          // of the last step
  std::vector<int> first_, dims_, contact_of_, owner_, found_;
  std::vector<std::vector<int>> joints_of_;
  Pattern outside_;              // entries of J that are zero, as far as joints have owners
  Part torques_, coefficients_;  // limits of the joints; friction, ceilings, weights

  std::ptrdiff_t next_ = 0, end_ = 0;
  std::ptrdiff_t row_[kLanes] = {};
  int steps_[kLanes] = {};
  bool from_start_[kLanes] = {};
  // Lanes with a point of which nothing is known, and with one that a step has led to; the others
  // are empty.
  Bits fresh_ = 0, stepped_ = 0;
  Bits waiting_ = 0;  // lanes whose point has changed since it was evaluated
  Bits inside_ = 0;
  Mask balanced_ = {};
  V f_[kWrench] = {}, nu_[kWrench] = {}, largest_f_ = {};
  V cone_weight_ = splat<V>(1), limit_weight_ = splat<V>(1), inverse_cone_weight_ = splat<V>(1);
  V push_ = splat<V>(0.1), lambda_ = {}, bound_ = {}, taken_ = {};
  V stretch_ = {};  // diagonal entries of S beside their pivots, the largest
  V S_[SumsOf<V>::kTriangle] = {}, inverse_S_[kWrench] = {};
};

// The lanes for a batch's layout, if there are any.
class LanesFor {
 public:
  explicit LanesFor(const BatchRows& rows) {
    if (!BatchLanes<3>::fits(rows.layout)) return;
    const std::vector<Model>& models = rows.layout.models;
    if (std::count(models.begin(), models.end(), Model::SFC) == 0)
      three_ = std::make_unique<BatchLanes<3>>(rows);
    else
      four_ = std::make_unique<BatchLanes<4>>(rows);
  }

  // Calls work(lanes); false where there are none.
  template <class Work>
  bool use(Work work) {
    if (three_ != nullptr) work(*three_);
    if (four_ != nullptr) work(*four_);
    return three_ != nullptr || four_ != nullptr;
  }

 private:
  std::unique_ptr<BatchLanes<3>> three_;
  std::unique_ptr<BatchLanes<4>> four_;
};

}  // namespace graspforce
