// The choice of the kernels that fit a problem, and the dispatch to them.
#pragma once

#include "graspforce/barrier.hpp"
#include "graspforce/lane_barrier.hpp"

namespace graspforce {

class Kernels {
 public:
  enum class Kind { General, Lanes3Single, Lanes4Single, Lanes3, Lanes4 };

  explicit Kernels(const Layout& layout)
      : layout_(layout),
        structure_(layout),
        lanes3_single_(layout),
        lanes4_single_(layout),
        lanes3_(layout),
        lanes4_(layout),
        blocks_(layout),
        barrier_(blocks_) {}

  Kind chosen() const { return chosen_; }
  const Structure& structure() const { return structure_; }
  bool empty() const { return structure_.blocks().empty(); }  // no contact in the grasp

  // Finds the blocks anew and chooses, where the last ones do not hold for the problem any more;
  // true when that was so. `changed` tells what differs from the last problem.
  bool rearrange(const Problem& problem, unsigned changed) {
    if (structure_.holds(problem, changed)) return false;
    structure_.find(problem);
    blocks_.allot(structure_);
    barrier_.allot();
    chosen_ = Kind::General;
    auto prefer = [&](auto& barrier, Kind kind) {
      if (chosen_ != Kind::General || !barrier.fits(layout_, structure_)) return;
      chosen_ = kind;
      barrier.allot(structure_);
    };
    prefer(lanes3_single_, Kind::Lanes3Single);
    prefer(lanes4_single_, Kind::Lanes4Single);
    prefer(lanes3_, Kind::Lanes3);
    prefer(lanes4_, Kind::Lanes4);
    return true;
  }

  // Calls work with the chosen barrier, which has loaded the problem.
  template <class Work>
  void dispatch(const Problem& problem, unsigned changed, Work work) {
    auto load_and_work = [&](auto& barrier) {
      rows(barrier).load(problem, changed);
      work(barrier);
    };
    switch (chosen_) {
      case Kind::Lanes3Single:
        return load_and_work(lanes3_single_);
      case Kind::Lanes4Single:
        return load_and_work(lanes4_single_);
      case Kind::Lanes3:
        return load_and_work(lanes3_);
      case Kind::Lanes4:
        return load_and_work(lanes4_);
      case Kind::General:
        barrier_.set_weights(*problem.alpha);
        return load_and_work(barrier_);
    }
  }

  // The general blocks, which serve the primal–dual method whichever kernels are chosen.
  Blocks& blocks() { return blocks_; }

  // What holds the rows of W c = f for a barrier.
  Blocks& rows(Barrier&) { return blocks_; }
  template <int Q, bool single>
  LaneBarrier<Q, single>& rows(LaneBarrier<Q, single>& barrier) {
    return barrier;
  }

 private:
  const Layout& layout_;
  Structure structure_;
  // For grasps without coupled contacts; the first of each pair up to four contacts, the threes
  // without soft fingers.
  LaneBarrier<3, true> lanes3_single_;
  LaneBarrier<4, true> lanes4_single_;
  LaneBarrier<3, false> lanes3_;
  LaneBarrier<4, false> lanes4_;
  Blocks blocks_;  // for all others
  Barrier barrier_;
  Kind chosen_ = Kind::General;
};

}  // namespace graspforce
