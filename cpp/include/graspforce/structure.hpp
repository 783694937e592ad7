// Which contacts belong together: blocks of the Hessian of Phi, found from the pattern of J and A.
//
// Two contacts share a block when one joint feels both (a palm and a fingertip on one finger) or
// when one inequality binds both. Fingertip grasps have a block a contact; in the worst case all
// is one block, the dense method of the paper. An internal force of the motors is in the block of
// those that feel it; contacts and internal forces are the nodes that limits tie together.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <vector>

#include "graspforce/lanes.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/span.hpp"

namespace graspforce {

using Indices = Span<const int>;

// The entries of a row-major matrix that have to be zero (outside), as windows of four side by side
// (which may overlap) and those that have no such neighbours; and where they are nearly all, the
// list of the others (inside). Entries are counted in ints: a matrix of more would take 16 GB.
class Pattern {
 public:
  void reserve(std::size_t entries) {
    fours_.reserve(entries / 2 + kAtOnce);
    ones_.reserve(entries);
    inside_.reserve(entries / kSparse);
  }

  template <class Outside>
  void find(int rows, int columns, Outside outside) {
    fours_.clear();
    ones_.clear();
    inside_.clear();
    const int count = rows * columns;
    sparse_ = count >= kMinEntries;
    for (int at = 0, end; at < count; at = end + 1) {
      for (end = at; end < count && outside(end / columns, end % columns);) ++end;
      for (int i = at; end - at < 4 && i < end; ++i) ones_.push_back(i);
      for (int i = at; end - at >= 4 && i < end; i += 4) fours_.push_back(std::min(i, end - 4));
      if (end == count || !sparse_) continue;
      if (inside_.size() < std::size_t(count) / kSparse)
        inside_.push_back(end);
      else
        sparse_ = false;
    }
    while (fours_.size() % kAtOnce != 0) fours_.push_back(fours_.back());
  }

  // Whether there is a list of the entries inside, short enough to save time.
  bool sparse() const { return sparse_; }

  // Of a sparse matrix: copies the entries inside; false unless all of them are finite.
  bool copy_inside(const double* from, double* to) const {
    constexpr std::uint64_t kExponent = std::uint64_t{0x7ff} << 52;
    bool finite = true;
    for (int at : inside_) {
      std::uint64_t bits;
      std::memcpy(&bits, from + at, sizeof bits);
      std::memcpy(to + at, &bits, sizeof bits);
      finite &= (bits & kExponent) != kExponent;
    }
    return finite;
  }
  // Whether two sparse matrices have the same bits inside.
  bool same_inside(const double* a, const double* b) const {
    for (int at : inside_)
      if (std::memcmp(a + at, b + at, sizeof(double)) != 0) return false;
    return true;
  }

  // Whether all entries outside are zero.
  bool holds(const double* entries) const {
    constexpr std::uint64_t kMagnitude = ~std::uint64_t{0} >> 1;  // all bits but the sign
    BitLanes found_in[kAtOnce] = {}, bits;
    for (auto at = fours_.begin(); at != fours_.end(); at += kAtOnce)
      for (int i = 0; i < kAtOnce; ++i) {
        std::memcpy(&bits, entries + at[i], sizeof bits);
        found_in[i] |= bits;
      }
    const BitLanes every = (found_in[0] | found_in[1]) | (found_in[2] | found_in[3]);
    std::uint64_t found = every[0] | every[1] | every[2] | every[3], one;
    for (int at : ones_) {
      std::memcpy(&one, entries + at, sizeof one);
      found |= one;
    }
    return (found & kMagnitude) == 0;
  }

 private:
  static constexpr int kAtOnce = 4;         // windows that are looked at side by side
  static constexpr int kSparse = 4;         // entries for each inside, at least
  static constexpr int kMinEntries = 1024;  // entries from which on a copy of all takes longer

  std::vector<int> fours_, ones_, inside_;
  bool sparse_ = false;
};

struct Block {
  Indices contacts;
  Indices components;    // of c, contact by contact; then m + i for internal force i
  Indices joints;        // columns of J that touch the block
  Indices inequalities;  // rows of A that touch the block
};

// Contacts out of the grasp belong to no block, nor do joints and inequalities that touch only
// such contacts. A limit that touches no contact at all is a condition on its bounds alone; the
// first block carries it.
class Structure {
 public:
  explicit Structure(const Layout& layout) : layout_(layout) {
    const int n = layout.contacts(), m = layout.components(), all = force_count(layout);
    const int nodes = n + layout.internals;
    start_.reserve(n + 1);
    start_.push_back(0);
    for (Model model : layout.models) start_.push_back(start_.back() + static_cast<int>(model));
    node_of_.reserve(all);
    for (int i = 0; i < n; ++i) node_of_.insert(node_of_.end(), dim(i), i);
    for (int i = n; i < nodes; ++i) node_of_.push_back(i);
    parent_.resize(nodes);
    block_of_node_.assign(nodes, kNone);
    block_of_joint_.assign(layout.joints, kNone);
    block_of_inequality_.assign(layout.inequalities, kNone);
    blocks_.reserve(nodes);
    ends_.reserve(nodes);
    contacts_.resize(n);
    components_.resize(all);
    joints_.resize(layout.joints);
    inequalities_.resize(layout.inequalities);
    J_.reserve(static_cast<std::size_t>(m) * layout.joints);
    internal_.reserve(static_cast<std::size_t>(layout.internals) * layout.joints);
    A_.reserve(static_cast<std::size_t>(m) * layout.inequalities);
  }

  // Holds for no problem any more.
  void forget() { blocks_.clear(); }

  int start(int contact) const { return start_[contact]; }
  int dim(int contact) const { return start_[contact + 1] - start_[contact]; }
  const std::vector<Block>& blocks() const { return blocks_; }
  const Pattern& jacobian() const { return J_; }
  // How often the blocks have been found: while it stays, so does the pattern.
  unsigned generation() const { return generation_; }

  // True when this structure still holds: the same contacts in the grasp, no entry of J or A
  // outside their blocks. Only what has changed is looked at.
  bool holds(const Problem& p, unsigned changed = kChangedAll) const {
    if (blocks_.empty()) return false;
    if (changed & kChangedRest) {
      for (int i = 0; i < layout_.contacts(); ++i)
        if (p.in_grasp(i) != (block_of_node_[i] != kNone)) return false;
      if (!A_.holds(p.A)) return false;
    }
    if (changed & kChangedJacobian) {
      if (!(changed & kJacobianKept) && !J_.holds(p.J)) return false;
      if (layout_.internals > 0 && !internal_.holds(p.internal)) return false;
    }
    return all_in_grasp_ || !(changed & (kChangedJacobian | kChangedRest)) || same_limits_count(p);
  }

  // Finds the blocks. Does not allocate.
  void find(const Problem& p) {
    const int n = layout_.contacts(), m = layout_.components(), nodes = n + layout_.internals;
    ++generation_;
    auto takes_part = [&](int node) { return node >= n || p.in_grasp(node); };
    std::iota(parent_.begin(), parent_.end(), 0);
    for (int j = 0; j < layout_.joints; ++j)
      block_of_joint_[j] =
          unite(takes_part, [&](int force) { return p.arm(force, j, m, layout_.joints) != 0; });
    for (int r = 0; r < layout_.inequalities; ++r)
      block_of_inequality_[r] =
          unite(takes_part, [&](int c) { return c < m && p.A[entry_at(r, c, m)] != 0; });

    blocks_.clear();
    all_in_grasp_ = true;
    for (int i = 0; i < nodes; ++i) {
      all_in_grasp_ &= takes_part(i);
      block_of_node_[i] = kNone;
      if (!takes_part(i)) continue;
      const int root = find_root(i);
      if (root == i) blocks_.emplace_back();
      block_of_node_[i] = root == i ? static_cast<int>(blocks_.size()) - 1 : block_of_node_[root];
    }
    // From the first contact that a limit touches to its block.
    auto settle = [&](std::vector<int>& block_of) {
      for (int& first : block_of) {
        first = blocks_.empty() || first == kNone ? kNone
                : first == kNoContact             ? 0
                                                  : block_of_node_[first];
      }
    };
    settle(block_of_joint_);
    settle(block_of_inequality_);
    collect(contacts_, &Block::contacts, [&](int i) { return block_of_node_[i]; });
    collect(components_, &Block::components, [&](int c) { return block_of_node_[node_of_[c]]; });
    collect(joints_, &Block::joints, [&](int j) { return block_of_joint_[j]; });
    collect(inequalities_, &Block::inequalities, [&](int r) { return block_of_inequality_[r]; });

    auto outside = [](int block, int other) {
      return block != kNone && other != kNone && other != block;
    };
    auto block_of = [&](int component) { return block_of_node_[node_of_[component]]; };
    J_.find(m, layout_.joints,
            [&](int c, int j) { return outside(block_of(c), block_of_joint_[j]); });
    internal_.find(layout_.internals, layout_.joints,
                   [&](int i, int j) { return outside(block_of(m + i), block_of_joint_[j]); });
    A_.find(layout_.inequalities, m,
            [&](int r, int c) { return outside(block_of(c), block_of_inequality_[r]); });
  }

 private:
  static constexpr int kNone = -1;
  static constexpr int kNoContact = -2;  // touches nothing, in the grasp or out of it

  // With a contact out of the grasp: whether the limits that touch no other are still the same.
  bool same_limits_count(const Problem& p) const {
    const int n = layout_.contacts(), m = layout_.components(), all = force_count(layout_);
    auto same = [&](int block, auto entry) {
      bool inside = false, outside = false;
      for (int c = 0; c < all; ++c)
        if (entry(c) != 0) (node_of_[c] >= n || p.in_grasp(node_of_[c]) ? inside : outside) = true;
      return (block != kNone) == (inside || !outside);
    };
    for (int j = 0; j < layout_.joints; ++j)
      if (!same(block_of_joint_[j], [&](int c) { return p.arm(c, j, m, layout_.joints); }))
        return false;
    for (int r = 0; r < layout_.inequalities; ++r)
      if (!same(block_of_inequality_[r], [&](int c) { return c < m ? p.A[entry_at(r, c, m)] : 0; }))
        return false;
    return true;
  }

  // Joins all contacts in the grasp, and internal forces, that a limit touches; returns the first
  // of them.
  template <class TakesPart, class Touches>
  int unite(TakesPart takes_part, Touches touches) {
    int first = kNone;
    bool any = false;
    for (int c = 0; c < static_cast<int>(components_.size()); ++c) {
      if (!touches(c)) continue;
      any = true;
      const int node = node_of_[c];
      if (!takes_part(node)) continue;
      if (first == kNone) first = node;
      const int a = find_root(first), b = find_root(node);
      parent_[a < b ? b : a] = a < b ? a : b;  // the root is the smallest: it is met first
    }
    return any ? first : kNoContact;
  }

  int find_root(int node) const {
    while (parent_[node] != node) node = parent_[node];
    return node;
  }

  // Lists the items of every block, block by block in one list (a counting sort).
  template <class BlockOf>
  void collect(std::vector<int>& list, Indices Block::* items, BlockOf block_of) {
    const int count = static_cast<int>(list.size());
    ends_.assign(blocks_.size(), 0);
    for (int item = 0; item < count; ++item)
      if (block_of(item) != kNone) ++ends_[block_of(item)];
    int end = 0;
    for (std::size_t b = 0; b < blocks_.size(); ++b) {
      blocks_[b].*items = Indices(list.data() + end, ends_[b]);
      end += ends_[b];
      ends_[b] = end - ends_[b];
    }
    for (int item = 0; item < count; ++item)
      if (block_of(item) != kNone) list[ends_[block_of(item)]++] = item;
  }

  const Layout& layout_;
  std::vector<int> start_, node_of_, parent_;  // nodes: contacts, then internal forces
  std::vector<int> block_of_node_, block_of_joint_, block_of_inequality_;
  std::vector<int> contacts_, components_, joints_, inequalities_;  // the blocks' lists
  std::vector<int> ends_;
  std::vector<Block> blocks_;
  bool all_in_grasp_ = true;
  Pattern J_, internal_, A_;
  unsigned generation_ = 0;
};

}  // namespace graspforce
