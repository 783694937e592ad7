// The last two optima of a stream of ticks, and the forces that they predict.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/fields.hpp"
#include "graspforce/layout.hpp"

namespace graspforce {

// Share of its reach with which a contact without history starts; the more the limits weigh, the
// smaller the forces that balance them.
inline double initial_push(const Problem& problem) { return 1 / std::sqrt(4 + 3 * *problem.alpha); }

class History {
 public:
  explicit History(const Layout& layout)
      : layout_(layout), guess_(force_count(layout)), ceiling_(layout.contacts()) {
    for (Optimum& optimum : last_) {
      optimum.c.resize(force_count(layout));
      optimum.ceiling.resize(layout.contacts());
    }
  }

  int size() const { return size_; }  // optima known, at most two
  void clear() { size_ = 0; }

  // Takes the ceilings of the tick that begins, where they may have changed.
  void begin_tick(const Problem& problem, unsigned changed) {
    if (changed & kChangedRest) {
      for (int i = 0; i < layout_.contacts(); ++i)
        ceiling_[i] = layout_.ceilings ? problem.engagement[i] * problem.c_max[i] : 1;
      ticks_since_limits_changed_ = 0;
    } else {
      ++ticks_since_limits_changed_;
    }
  }

  // Puts a barrier at forces extrapolated from the last `order` optima. A contact's forces are
  // taken as shares of its ceiling, so that they follow it to zero and back; a contact that has
  // just come into the grasp starts with a push.
  template <class AnyBarrier>
  void extrapolate(AnyBarrier& barrier, const Problem& problem, int order) {
    const Optimum &last = last_[newest_], &before = last_[1 - newest_];
    if (ceilings_hold() && order == 2) return barrier.extrapolate(last.c.data(), before.c.data());
    for (int i = 0, c = 0; i < layout_.contacts(); ++i) {
      const int end = c + static_cast<int>(layout_.models[i]);
      const double now = ceiling_[i];
      const bool one = last.ceiling[i] > 0, two = order == 2 && before.ceiling[i] > 0;
      const double to_last = one ? now / last.ceiling[i] : 0;
      const double to_before = two ? now / before.ceiling[i] : 0;
      for (bool normal = true; c < end; ++c, normal = false) {
        if (!one)
          guess_[c] = normal ? now * initial_push(problem) : 0;
        else if (!two)
          guess_[c] = to_last * last.c[c];
        else
          guess_[c] = 2 * to_last * last.c[c] - to_before * before.c[c];
      }
    }
    for (int v = layout_.components(); v < force_count(layout_); ++v)
      guess_[v] = order == 2 ? 2 * last.c[v] - before.c[v] : last.c[v];
    barrier.set_forces(guess_.data());
  }

  // Keeps the forces that the tick has found.
  void remember(const Problem& problem, const std::vector<double>& c) {
    newest_ = 1 - newest_;
    Optimum& optimum = last_[newest_];
    std::copy(c.begin(), c.end(), optimum.c.begin());
    if (size_ < 2 || !ceilings_hold())
      for (int i = 0; i < layout_.contacts(); ++i)
        optimum.ceiling[i] = problem.in_grasp(i) ? ceiling_[i] : 0;
    size_ = std::min(size_ + 1, 2);
  }

 private:
  struct Optimum {
    std::vector<double> c, ceiling;
  };

  // Whether the ceilings are those of the last two ticks.
  bool ceilings_hold() const { return ticks_since_limits_changed_ >= 2; }

  const Layout& layout_;
  std::vector<double> guess_, ceiling_;
  Optimum last_[2];
  int newest_ = 0, size_ = 0;
  int ticks_since_limits_changed_ = 0;  // ticks since the ceilings may last have changed
};

}  // namespace graspforce
