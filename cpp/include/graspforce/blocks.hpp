// A problem's numbers, gathered block by block.
//
// In every block all linear limits are rows lo ≤ a·c ≤ hi: joint torques (less their bias), then
// the problem's inequalities, then each contact's normal force between floor and ceiling, then each
// component between its rate limits. Absent sides are infinite: their slack is infinite too, so
// they add nothing to a barrier.
//
// A row of W c = f with a softness F is kept as W c + F s = f, and the slack s, a block by itself,
// costs ½ s²: that is ½ ((f − W c)/F)². Its column of W is F; of an exact row it is zero.
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>
#include <vector>

#include "graspforce/cone.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/linalg.hpp"
#include "graspforce/structure.hpp"

namespace graspforce {

// Hands out pieces of one allocation.
class Arena {
 public:
  // Room for `count` numbers, whose memory is not touched before they are asked for.
  explicit Arena(std::size_t count) { storage_.reserve(count); }
  void reset(std::size_t count) {
    storage_.assign(count, 0.0);
    next_ = storage_.data();
  }
  double* take(std::size_t count) {
    double* here = next_;
    next_ += count;
    assert(next_ <= storage_.data() + storage_.size());
    return here;
  }

 private:
  std::vector<double> storage_;
  double* next_ = nullptr;
};

// One contact inside its block.
struct Tip {
  int contact;  // in the problem
  int first;    // its first component in the block
  Cone cone;
  double reach;       // the normal force that alone uses up the tightest limit
  double cone_scale;  // violation of the cone that counts as one, mu·reach
  double weight;      // of the cone's barrier
};

struct BlockData {
  const Block* block;  // null: the slack of a soft row
  Indices components;  // of c, then of the internal forces; a slack is none
  int slack_row;       // in the problem; −1 for forces
  int q, rows;         // unknowns, rows
  Span<Tip> tips;
  double* Wt;       // q × k: this block's columns of W, transposed
  double* a;        // rows × q
  double *lo, *hi;  // rows
  double* scale;    // rows: violation that counts as one
};

class Blocks {
 public:
  explicit Blocks(const Layout& layout)
      : layout_(layout),
        k_(layout.wrench_rows),
        rows_in_use_(k_),
        f_(k_),
        softness_(k_),
        tips_(layout.contacts()),
        arena_(most_numbers(layout)) {
    parts_.reserve(most_blocks(layout));
  }

  // Shares the room out to the blocks of a structure; needed whenever it has been found anew.
  void allot(const Structure& structure) {
    parts_.clear();
    const std::size_t k = layout_.wrench_rows;
    std::size_t total = 0;
    for (const Block& block : structure.blocks())
      total += block.components.size() * k + count_rows(block) * (block.components.size() + 3);
    total += k * k;
    arena_.reset(total);
    Tip* tips = tips_.data();
    for (const Block& block : structure.blocks()) {
      const std::size_t q = block.components.size(), rows = count_rows(block);
      BlockData part{
          &block,  block.components, -1,      int(q),  int(rows), {tips, block.contacts.size()},
          nullptr, nullptr,          nullptr, nullptr, nullptr};
      int first = 0;
      for (int contact : block.contacts) {
        *tips++ = {contact, first, {structure.dim(contact), 1, 1}, 1, 1, 1};
        first += structure.dim(contact);
      }
      part.Wt = arena_.take(q * k);
      part.a = arena_.take(rows * q);
      part.lo = arena_.take(rows);
      part.hi = arena_.take(rows);
      part.scale = arena_.take(rows);
      parts_.push_back(part);
    }
    of_forces_ = parts_.size();
    slack_columns_ = arena_.take(k * k);
    if (layout_.soft_wrench) add_slacks();
  }

  // Takes a problem's numbers, all of them whatever has changed.
  void load(const Problem& p, unsigned = kChangedAll) {
    k_ = layout_.wrench_rows;
    for (int r = 0; r < k_; ++r) rows_in_use_[r] = r;
    std::copy(p.f, p.f + k_, f_.begin());
    for (int r = 0; r < k_; ++r) softness_[r] = layout_.soft_wrench ? p.f_soft[r] : 0;
    for (BlockData& part : parts_) load_wrench_rows(p, part);
    for (BlockData& part : forces()) load_limits(p, part);
    scale_violations();
  }

  // Keeps only the given rows of W c = f: an independent set when W is rank-deficient.
  void restrict_rows(const Problem& p, const std::vector<int>& rows) {
    k_ = static_cast<int>(rows.size());
    std::copy(rows.begin(), rows.end(), rows_in_use_.begin());
    for (int r = 0; r < k_; ++r) f_[r] = p.f[rows[r]];
    for (BlockData& part : parts_) load_wrench_rows(p, part);
  }

  // Gives the rows that are exact a softness, and keeps them alone; the points of these blocks have
  // to be allotted anew, and once more after `harden`.
  void soften(const Problem& p, const std::vector<int>& exact, const double* softness) {
    for (int r : exact) softness_[r] = softness[r];
    if (!layout_.soft_wrench) add_slacks();
    restrict_rows(p, exact);
  }
  // Undoes that; the rows that are to hold are then to be chosen again.
  void harden(const std::vector<int>& exact) {
    for (int r : exact) softness_[r] = 0;
    if (!layout_.soft_wrench) parts_.resize(of_forces_);
  }

  const Layout& layout() const { return layout_; }
  const std::vector<BlockData>& parts() const { return parts_; }
  // Those of forces; the slacks of a soft wrench follow them.
  Span<BlockData> forces() { return {parts_.data(), int(of_forces_)}; }
  int k() const { return k_; }                      // rows of W c = f in use
  const double* f() const { return f_.data(); }     // their right-hand sides
  int row(int r) const { return rows_in_use_[r]; }  // where row r stands in the problem
  bool is_soft(int r) const { return softness_[row(r)] > 0; }
  // The size of force that the limits are made for, by the largest of them, or of the wrench.
  double size() const {
    double most = 0;
    for (int r = 0; r < k(); ++r) most = std::max(most, std::abs(f()[r]));
    for (const BlockData& part : parts_)
      for (int r = 0; r < part.rows; ++r) {
        double largest = 0, bound = 0;
        for (int i = 0; i < part.q; ++i)
          largest = std::max(largest, std::abs(part.a[r * part.q + i]));
        for (double side : {part.hi[r], part.lo[r]})
          if (std::isfinite(side)) bound = std::max(bound, std::abs(side));
        if (largest > 0) most = std::max(most, bound / largest);
      }
    return most;
  }

  // How row r of a part stands among the rows of ForceProblem.linear_limits(), before any are
  // left out: first its upper side, then its lower; −1 for a side that the problem does not have.
  std::pair<int, int> limit_indices(const BlockData& part, int r) const {
    const int joints = layout_.joints, n = layout_.contacts();
    const int block_joints = part.block->joints.size();
    const int inequalities = part.block->inequalities.size();
    const int ceilings = 2 * joints, floors = ceilings + (layout_.ceilings ? n : 0);
    const int rates = floors + (layout_.floors ? n : 0);
    if (r < block_joints) return {part.block->joints[r], joints + part.block->joints[r]};
    r -= block_joints;
    if (r < inequalities)
      return {limit_count(layout_) - layout_.inequalities + part.block->inequalities[r], -1};
    r -= inequalities;
    if (r < boxed_contacts(*part.block)) {
      const int contact = part.tips[r].contact;
      return {layout_.ceilings ? ceilings + contact : -1, layout_.floors ? floors + contact : -1};
    }
    const int component = part.block->components[r - boxed_contacts(*part.block)];
    return {rates + component, rates + layout_.components() + component};
  }

 private:
  // What `allot` takes for any structure.
  static std::size_t most_numbers(const Layout& layout) {
    return std::size_t(force_count(layout)) * layout.wrench_rows +
           most_rows(layout) * (largest_block(layout) + 3) +
           std::size_t(layout.wrench_rows) * layout.wrench_rows;
  }

  // One slack a row of the problem, behind the forces.
  void add_slacks() {
    for (int r = 0, k = layout_.wrench_rows; r < k; ++r)
      parts_.push_back({nullptr,
                        {},
                        r,
                        1,
                        0,
                        {tips_.data(), 0},
                        slack_columns_ + r * k,
                        nullptr,
                        nullptr,
                        nullptr,
                        nullptr});
  }

  // Contacts whose normal force has a row, components that have one.
  int boxed_contacts(const Block& block) const {
    return layout_.ceilings || layout_.floors ? block.contacts.size() : 0;
  }
  // How many of a block's components are of contact forces: the first ones.
  int contact_forces(const Block& block) const {
    const Indices& all = block.components;
    return int(std::lower_bound(all.begin(), all.end(), layout_.components()) - all.begin());
  }
  std::size_t count_rows(const Block& block) const {
    return block.joints.size() + block.inequalities.size() + boxed_contacts(block) +
           (layout_.rate_limits ? contact_forces(block) : 0);
  }

  void load_wrench_rows(const Problem& p, BlockData& part) {
    const int m = layout_.components();
    for (int i = 0; i < part.components.size(); ++i)
      for (int r = 0; r < k_; ++r) {
        const int c = part.components[i];
        part.Wt[i * k_ + r] = c < m ? p.W[entry_at(rows_in_use_[r], c, m)] : 0;
      }
    for (int r = 0; part.slack_row >= 0 && r < k_; ++r)
      part.Wt[r] = rows_in_use_[r] == part.slack_row ? softness_[part.slack_row] : 0;
  }

  void load_limits(const Problem& p, BlockData& part) {
    const Block& block = *part.block;
    const int m = layout_.components();
    double* a = part.a;
    int r = 0;
    for (int joint : block.joints) {
      for (int i = 0; i < part.q; ++i) a[i] = p.arm(block.components[i], joint, m, layout_.joints);
      part.lo[r] = p.tau_lo[joint] - p.tau_bias[joint];
      part.hi[r] = p.tau_hi[joint] - p.tau_bias[joint];
      a += part.q;
      ++r;
    }
    for (int row : block.inequalities) {
      for (int i = 0; i < contact_forces(block); ++i)
        a[i] = p.A[entry_at(row, block.components[i], m)];
      part.lo[r] = -kInfinity;
      part.hi[r] = p.b[row];
      a += part.q;
      ++r;
    }
    for (Tip& tip : part.tips) {
      tip.cone.mu = p.mu[tip.contact];
      tip.cone.torsion = p.mu[tip.contact] / p.gamma[tip.contact];
      if (layout_.cone_weights) tip.weight = p.cone_weight[tip.contact];
      if (boxed_contacts(block) == 0) continue;
      a[tip.first] = 1;
      part.hi[r] = normal_ceiling(layout_, p, tip.contact);
      part.lo[r] = normal_floor(layout_, p, tip.contact);
      a += part.q;
      ++r;
    }
    for (int i = 0; r < part.rows; ++i, ++r, a += part.q) {
      const int component = block.components[i];
      a[i] = 1;
      part.lo[r] = p.c_last[component] - p.dc_max[component];
      part.hi[r] = p.c_last[component] + p.dc_max[component];
    }
  }

  // What one unit of relative violation means; the definition is reference.violation_scales.
  void scale_violations() {
    double known = 0, wrench = 0;
    for (BlockData& part : forces()) {
      const int joints = part.block->joints.size();
      const int others = joints + part.block->inequalities.size();
      for (int r = 0; r < joints; ++r) part.scale[r] = 0.5 * (part.hi[r] - part.lo[r]);
      for (int i = 0; i < part.tips.size(); ++i) {
        Tip& tip = part.tips[i];
        tip.reach = layout_.ceilings ? part.hi[others + i] : kInfinity;
        for (int r = 0; r < joints; ++r) {
          const double moment_arm = std::abs(part.a[r * part.q + tip.first]);
          if (moment_arm > 0) tip.reach = std::min(tip.reach, 2 * part.scale[r] / moment_arm);
        }
        if (tip.reach < kInfinity) known = std::max(known, tip.reach);
      }
    }
    for (int r = 0; r < k_; ++r) wrench = std::max(wrench, std::abs(f_[r]));
    const double fallback = known > 0 ? known : wrench > 0 ? wrench : 1;
    for (BlockData& part : forces()) {
      for (Tip& tip : part.tips) {
        if (!(tip.reach < kInfinity)) tip.reach = fallback;
        tip.cone_scale = tip.cone.mu * tip.reach;
      }
      int r = part.block->joints.size();
      for (int i = 0; i < part.block->inequalities.size(); ++i, ++r) {
        double own = 0;
        for (const Tip& tip : part.tips)
          for (int j = 0; j < tip.cone.dim; ++j)
            own += std::abs(part.a[r * part.q + tip.first + j]) * tip.reach;
        part.scale[r] = own > 0 ? own : std::max(std::abs(part.hi[r]), fallback);
      }
      for (int i = 0; i < boxed_contacts(*part.block); ++i, ++r) part.scale[r] = part.tips[i].reach;
      for (; r < part.rows; ++r) part.scale[r] = 0.5 * (part.hi[r] - part.lo[r]);
    }
  }

  const Layout& layout_;
  int k_;
  std::vector<int> rows_in_use_;
  std::vector<double> f_;
  std::vector<double> softness_;  // by the problem's rows
  std::vector<BlockData> parts_;
  std::size_t of_forces_ = 0;
  double* slack_columns_ = nullptr;  // k × k
  std::vector<Tip> tips_;
  Arena arena_;
};

// max |f − W c| over the exact rows in use, relative to the wrenches that add up to f.
template <class Forces>
double relative_wrench_error(const Blocks& blocks, Forces forces) {
  double worst = 0, scale = 0;
  for (int r = 0; r < blocks.k(); ++r) {
    if (blocks.is_soft(r)) continue;
    double sum = 0, size = std::abs(blocks.f()[r]);
    for (std::size_t b = 0; b < blocks.parts().size(); ++b) {
      const BlockData& part = blocks.parts()[b];
      const double* c = forces(b);
      for (int i = 0; i < part.q; ++i) {
        const double wrench = part.Wt[i * blocks.k() + r] * c[i];
        sum += wrench;
        size += std::abs(wrench);
      }
    }
    const double error = std::abs(blocks.f()[r] - sum);
    if (!(error <= worst)) worst = error;  // NaN stays
    scale = std::max(scale, size);
  }
  if (!(scale < kInfinity)) return kInfinity;
  return scale > 0 ? worst / scale : 0;
}

}  // namespace graspforce
