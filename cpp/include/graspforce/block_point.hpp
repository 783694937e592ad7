// A point c and a step d, kept block by block, and what they mean for cones, limits and W c = f.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/blocks.hpp"

namespace graspforce {

class BlockPoint {
 public:
  explicit BlockPoint(const Blocks& blocks)
      : blocks_(blocks),
        c_(unknowns(blocks.layout())),
        d_(c_),
        missing_(blocks.layout().wrench_rows) {
    first_.reserve(most_blocks(blocks.layout()));
  }

  // Deals the components out to the blocks; needed after Blocks::allot. Does not allocate.
  void allot() {
    settled_ = false;
    first_.clear();
    int next = 0;
    for (const BlockData& part : blocks_.parts()) {
      first_.push_back(next);
      next += part.q;
    }
  }

  // ---- forces in the problem's order, the internal ones behind those of the contacts ---------

  void set_forces(const double* c) {
    for (int b = 0; b < count(); ++b)
      for (int i = 0; i < part(b).components.size(); ++i) this->c(b)[i] = c[part(b).components[i]];
    settle();
  }

  // c ← 2 last − before. Slacks stay what the last optimum made them.
  void extrapolate(const double* last, const double* before) {
    for (int b = 0; b < count(); ++b)
      for (int i = 0; i < part(b).components.size(); ++i) {
        const int component = part(b).components[i];
        c(b)[i] = 2 * last[component] - before[component];
      }
    if (!settled_) settle();
  }

  // Contacts out of the grasp get zero.
  void get_forces(double* c) const {
    std::fill(c, c + force_count(blocks_.layout()), 0.0);
    for (int b = 0; b < count(); ++b)
      for (int i = 0; i < part(b).components.size(); ++i) c[part(b).components[i]] = this->c(b)[i];
  }

  // Pure pushes, each `fraction` of its contact's reach; less in a block where that would pass a
  // limit that weaker pushes keep to.
  void set_pushes(double fraction) {
    for (int b = 0; b < count(); ++b) {
      std::fill_n(c(b), part(b).q, 0.0);
      for (const Tip& tip : part(b).tips) c(b)[tip.first] = fraction * tip.reach;
      double used = kMostUsed;
      for (int r = 0; r < part(b).rows; ++r) {
        const double t = dot(part(b).a + r * part(b).q, c(b), part(b).q);
        const double limit = t > 0 ? part(b).hi[r] : part(b).lo[r];
        if (t * limit > 0) used = std::max(used, t / limit);
      }
      for (const Tip& tip : part(b).tips) c(b)[tip.first] *= kMostUsed / used;
    }
    settle();
  }

  // ---- where the point stands --------------------------------------------------------------

  bool inside() const {
    for (int b = 0; b < count(); ++b) {
      for (const Tip& tip : part(b).tips)
        if (!(tip.cone.margin(c(b) + tip.first) > 0)) return false;
      for (int r = 0; r < part(b).rows; ++r) {
        const double t = dot(part(b).a + r * part(b).q, c(b), part(b).q);
        if (!(part(b).hi[r] > t) || !(t > part(b).lo[r])) return false;
      }
    }
    return true;
  }

  bool balanced() const { return wrench_error() < kBalanced; }

  // max |f − W c| over the exact rows in use, relative to the wrenches that add up to f.
  double wrench_error() const {
    return relative_wrench_error(blocks_, [this](std::size_t b) { return c(int(b)); });
  }

  // Whether the forces are out of all proportion to the limits.
  bool runaway() const {
    double largest = 0;
    for (int b = 0; b < count(); ++b)
      for (int i = 0; i < part(b).components.size(); ++i)
        largest = std::max(largest, std::abs(c(b)[i]));
    return largest > kRunaway * blocks_.size();
  }

  // ---- the step ------------------------------------------------------------------------------

  // Largest t for which the point plus t d stays inside.
  double step_limit() const {
    double limit = kInfinity;
    for (int b = 0; b < count(); ++b) {
      for (const Tip& tip : part(b).tips)
        limit = std::min(limit, tip.cone.step_limit(c(b) + tip.first, d(b) + tip.first));
      for (int r = 0; r < part(b).rows; ++r) {
        const double* a = part(b).a + r * part(b).q;
        const double t = dot(a, c(b), part(b).q), change = dot(a, d(b), part(b).q);
        if (change > 0) limit = std::min(limit, (part(b).hi[r] - t) / change);
        if (change < 0) limit = std::min(limit, (part(b).lo[r] - t) / change);
      }
    }
    return limit;
  }

  void advance(double t) {
    for (int b = 0; b < count(); ++b) add_scaled(t, d(b), part(b).q, c(b));
  }

 protected:
  int count() const { return static_cast<int>(first_.size()); }
  const BlockData& part(int b) const { return blocks_.parts()[b]; }
  double* c(int b) { return c_.data() + first_[b]; }
  double* d(int b) { return d_.data() + first_[b]; }
  const double* c(int b) const { return c_.data() + first_[b]; }
  const double* d(int b) const { return d_.data() + first_[b]; }

  // r ← f − W c, the wrench that is missing.
  void missing_wrench(double* r) const {
    std::copy_n(blocks_.f(), blocks_.k(), r);
    for (int b = 0; b < count(); ++b)
      for (int i = 0; i < part(b).q; ++i)
        add_scaled(-c(b)[i], part(b).Wt + i * blocks_.k(), blocks_.k(), r);
  }

  // Gives the slack of every soft row what the forces leave of it.
  void settle() {
    settled_ = true;
    if (!blocks_.layout().soft_wrench) return;
    for (int b = 0; b < count(); ++b)
      if (part(b).slack_row >= 0) c(b)[0] = 0;
    missing_wrench(missing_.data());
    for (int b = 0; b < count(); ++b)
      for (int r = 0; part(b).slack_row >= 0 && r < blocks_.k(); ++r)
        if (part(b).Wt[r] > 0) c(b)[0] = missing_[r] / part(b).Wt[r];
  }

  const Blocks& blocks_;
  std::vector<double> c_, d_;  // block after block
  std::vector<double> missing_;

 private:
  std::vector<int> first_;  // where each block's components start
  bool settled_ = false;    // the slacks belong to the forces of this or of the last tick
};

}  // namespace graspforce
