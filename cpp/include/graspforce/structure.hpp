// Which contacts belong together: blocks of the Hessian of Phi, found from the pattern of J and A.
//
// Two contacts share a block when one joint feels both (a palm and a fingertip on one finger) or
// when one inequality binds both. Fingertip grasps have a block a contact; in the worst case all
// is one block, the dense method of the paper.
#pragma once

#include <cstdint>
#include <cstring>
#include <numeric>
#include <vector>

#include "graspforce/layout.hpp"

namespace graspforce {

struct Block {
  std::vector<int> contacts;
  std::vector<int> components;    // of c, contact by contact
  std::vector<int> joints;        // columns of J that touch the block
  std::vector<int> inequalities;  // rows of A that touch the block
};

// Contacts out of the grasp belong to no block, nor do joints and inequalities that touch only
// such contacts. A limit that touches no contact at all is a condition on its bounds alone; the
// first block carries it.
class Structure {
 public:
  explicit Structure(const Layout& layout) : layout_(layout) {
    const int n = layout.contacts(), m = layout.components();
    start_.reserve(n + 1);
    start_.push_back(0);
    for (Model model : layout.models) start_.push_back(start_.back() + static_cast<int>(model));
    contact_of_.reserve(m);
    for (int i = 0; i < n; ++i) contact_of_.insert(contact_of_.end(), dim(i), i);
    parent_.resize(n);
    block_of_contact_.assign(n, kNone);
    block_of_joint_.assign(layout.joints, kNone);
    block_of_inequality_.assign(layout.inequalities, kNone);
    outside_J_.resize(static_cast<std::size_t>(m) * layout.joints);
    outside_A_.resize(static_cast<std::size_t>(m) * layout.inequalities);
  }

  int start(int contact) const { return start_[contact]; }
  int dim(int contact) const { return start_[contact + 1] - start_[contact]; }
  const std::vector<Block>& blocks() const { return blocks_; }

  // True when this structure still holds: no entry of J or A outside the blocks, the same
  // contacts in the grasp. Only what has changed is looked at.
  bool holds(const Problem& p, unsigned changed = kChangedAll) const {
    if (blocks_.empty()) return false;
    if (changed & kChangedRest) {
      for (int i = 0; i < layout_.contacts(); ++i)
        if (p.in_grasp(i) != (block_of_contact_[i] != kNone)) return false;
      if (any_under(outside_A_, p.A)) return false;
    }
    if (changed & kChangedJacobian && any_under(outside_J_, p.J)) return false;
    return all_in_grasp_ || !(changed & (kChangedJacobian | kChangedRest)) || same_limits_count(p);
  }

  void find(const Problem& p) {
    const int n = layout_.contacts(), m = layout_.components();
    std::iota(parent_.begin(), parent_.end(), 0);
    auto touches_joint = [&](int row, int joint) {
      return p.J[static_cast<std::size_t>(row) * layout_.joints + joint] != 0;
    };
    auto touches_inequality = [&](int column, int r) {
      return p.A[static_cast<std::size_t>(r) * m + column] != 0;
    };
    std::vector<int> first_of_joint(layout_.joints, kNone);
    std::vector<int> first_of_inequality(layout_.inequalities, kNone);
    for (int j = 0; j < layout_.joints; ++j)
      first_of_joint[j] = unite(p, [&](int component) { return touches_joint(component, j); });
    for (int r = 0; r < layout_.inequalities; ++r)
      first_of_inequality[r] =
          unite(p, [&](int component) { return touches_inequality(component, r); });

    blocks_.clear();
    all_in_grasp_ = true;
    for (int i = 0; i < n; ++i) {
      all_in_grasp_ &= p.in_grasp(i);
      block_of_contact_[i] = kNone;
      if (!p.in_grasp(i)) continue;
      const int root = find_root(i);
      if (root == i) blocks_.emplace_back();
      block_of_contact_[i] =
          root == i ? static_cast<int>(blocks_.size()) - 1 : block_of_contact_[root];
      Block& block = blocks_[block_of_contact_[i]];
      block.contacts.push_back(i);
      for (int c = start_[i]; c < start_[i + 1]; ++c) block.components.push_back(c);
    }
    assign(first_of_joint, block_of_joint_, &Block::joints);
    assign(first_of_inequality, block_of_inequality_, &Block::inequalities);
    for (int component = 0; component < m; ++component) {
      const int block = block_of_contact_[contact_of_[component]];
      auto outside = [block](int other) {
        return block != kNone && other != block ? kMagnitude : 0;
      };
      for (int j = 0; j < layout_.joints; ++j)
        outside_J_[component * layout_.joints + j] = outside(block_of_joint_[j]);
      for (int r = 0; r < layout_.inequalities; ++r)
        outside_A_[r * m + component] = outside(block_of_inequality_[r]);
    }
  }

 private:
  static constexpr int kNone = -1;
  static constexpr int kNoContact = -2;  // touches nothing, in the grasp or out of it

  static constexpr std::uint64_t kMagnitude = ~std::uint64_t{0} >> 1;  // all bits but the sign

  // With a contact out of the grasp: whether the limits that touch no other are still the same.
  bool same_limits_count(const Problem& p) const {
    const int m = layout_.components();
    auto same = [&](int block, auto entry) {
      bool inside = false, outside = false;
      for (int c = 0; c < m; ++c)
        if (entry(c) != 0) (p.in_grasp(contact_of_[c]) ? inside : outside) = true;
      return (block != kNone) == (inside || !outside);
    };
    for (int j = 0; j < layout_.joints; ++j)
      if (!same(block_of_joint_[j], [&](int c) { return p.J[c * layout_.joints + j]; }))
        return false;
    for (int r = 0; r < layout_.inequalities; ++r)
      if (!same(block_of_inequality_[r], [&](int c) { return p.A[r * m + c]; })) return false;
    return true;
  }

  // Whether any entry under the mask differs from zero.
  static bool any_under(const std::vector<std::uint64_t>& mask, const double* entries) {
    typedef std::uint64_t Bits __attribute__((vector_size(32)));
    const std::size_t count = mask.size();
    std::size_t i = 0;
    Bits four = {};
    auto look = [&](std::size_t at) {
      Bits bits, wanted;
      std::memcpy(&bits, entries + at, sizeof bits);
      std::memcpy(&wanted, mask.data() + at, sizeof wanted);
      four |= bits & wanted;
    };
    for (; i + 12 <= count; i += 12) {
      look(i);
      look(i + 4);
      look(i + 8);
    }
    std::uint64_t found = four[0] | four[1] | four[2] | four[3];
    for (; i < count; ++i) {
      std::uint64_t bits;
      std::memcpy(&bits, entries + i, sizeof bits);
      found |= bits & mask[i];
    }
    return found != 0;
  }

  // Joins all contacts in the grasp that a limit touches; returns the first of them.
  template <class Touches>
  int unite(const Problem& p, Touches touches) {
    int first = kNone;
    bool any = false;
    for (int c = 0; c < layout_.components(); ++c) {
      if (!touches(c)) continue;
      any = true;
      const int contact = contact_of_[c];
      if (!p.in_grasp(contact)) continue;
      if (first == kNone) first = contact;
      const int a = find_root(first), b = find_root(contact);
      parent_[a < b ? b : a] = a < b ? a : b;  // the root is the smallest: it is met first
    }
    return any ? first : kNoContact;
  }

  int find_root(int contact) const {
    while (parent_[contact] != contact) contact = parent_[contact];
    return contact;
  }

  void assign(const std::vector<int>& first, std::vector<int>& block_of,
              std::vector<int> Block::* list) {
    for (std::size_t limit = 0; limit < first.size(); ++limit) {
      block_of[limit] = kNone;
      if (blocks_.empty() || first[limit] == kNone) continue;
      block_of[limit] = first[limit] == kNoContact ? 0 : block_of_contact_[first[limit]];
      (blocks_[block_of[limit]].*list).push_back(static_cast<int>(limit));
    }
  }

  const Layout& layout_;
  std::vector<int> start_, contact_of_, parent_;
  std::vector<int> block_of_contact_, block_of_joint_, block_of_inequality_;
  std::vector<Block> blocks_;
  bool all_in_grasp_ = true;
  std::vector<std::uint64_t> outside_J_, outside_A_;  // masks of entries that have to be zero
};

}  // namespace graspforce
