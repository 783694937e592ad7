// The choice of the kernels that fit a problem, and the dispatch to them.
#pragma once

#include "graspforce/barrier.hpp"
#include "graspforce/lane_barrier.hpp"

namespace graspforce {

class Kernels {
 public:
  enum class Kind {
    General,
    Lanes3Plain,
    Lanes4Plain,
    Lanes3Soft,
    Lanes4Soft,
    Lanes3Small,
    Lanes4Small,
    Lanes3,
    Lanes4,
  };

  explicit Kernels(const Layout& layout)
      : layout_(layout),
        structure_(layout),
        lanes3_plain_(layout),
        lanes4_plain_(layout),
        lanes3_soft_(layout),
        lanes4_soft_(layout),
        lanes3_small_(layout),
        lanes4_small_(layout),
        lanes3_(layout),
        lanes4_(layout),
        blocks_(layout),
        barrier_(blocks_) {}

  Kind chosen() const { return chosen_; }
  const Structure& structure() const { return structure_; }
  bool empty() const { return structure_.blocks().empty(); }  // no contact in the grasp

  // The next problem's blocks are its own, whatever those of the last.
  void forget() { structure_.forget(); }

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
    prefer(lanes3_plain_, Kind::Lanes3Plain);
    prefer(lanes4_plain_, Kind::Lanes4Plain);
    prefer(lanes3_soft_, Kind::Lanes3Soft);
    prefer(lanes4_soft_, Kind::Lanes4Soft);
    prefer(lanes3_small_, Kind::Lanes3Small);
    prefer(lanes4_small_, Kind::Lanes4Small);
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
      case Kind::Lanes3Plain:
        return load_and_work(lanes3_plain_);
      case Kind::Lanes4Plain:
        return load_and_work(lanes4_plain_);
      case Kind::Lanes3Soft:
        return load_and_work(lanes3_soft_);
      case Kind::Lanes4Soft:
        return load_and_work(lanes4_soft_);
      case Kind::Lanes3Small:
        return load_and_work(lanes3_small_);
      case Kind::Lanes4Small:
        return load_and_work(lanes4_small_);
      case Kind::Lanes3:
        return load_and_work(lanes3_);
      case Kind::Lanes4:
        return load_and_work(lanes4_);
      case Kind::General:
        barrier_.set_weights(problem);
        return load_and_work(barrier_);
    }
  }

  // The general blocks, which serve the primal–dual method whichever kernels are chosen.
  Blocks& blocks() { return blocks_; }

  // What holds the rows of W c = f for a barrier.
  Blocks& rows(Barrier&) { return blocks_; }
  template <int Q, Grasps grasps>
  LaneBarrier<Q, grasps>& rows(LaneBarrier<Q, grasps>& barrier) {
    return barrier;
  }

 private:
  const Layout& layout_;
  Structure structure_;
  // For grasps without coupled contacts; the threes without soft fingers.
  LaneBarrier<3, Grasps::Plain> lanes3_plain_;
  LaneBarrier<4, Grasps::Plain> lanes4_plain_;
  LaneBarrier<3, Grasps::Soft> lanes3_soft_;
  LaneBarrier<4, Grasps::Soft> lanes4_soft_;
  LaneBarrier<3, Grasps::Small> lanes3_small_;
  LaneBarrier<4, Grasps::Small> lanes4_small_;
  LaneBarrier<3, Grasps::Any> lanes3_;
  LaneBarrier<4, Grasps::Any> lanes4_;
  Blocks blocks_;  // for all others
  Barrier barrier_;
  Kind chosen_ = Kind::General;
};

}  // namespace graspforce
