// The numbers of the last tick and of the next, and what differs between them.
//
// A large J is nearly all zeros: a finger's joints move its own contacts. Once that pattern is
// known, a tick reads every entry once, to check that those outside it are still zero, and copies
// and compares only those inside.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "graspforce/lanes.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/structure.hpp"
#include "graspforce/validity.hpp"

namespace graspforce {

// The numbers of one tick's problem, packed; unchanged while a reference is kept.
using Snapshot = std::shared_ptr<const std::vector<double>>;

class DoubleBuffer {
 public:
  // `structure` is that of the last tick, which the pattern is taken from.
  DoubleBuffer(const Layout& layout, const Structure& structure)
      : at_(layout),
        structure_(structure),
        now_{std::make_shared<std::vector<double>>(at_.size)},
        next_{std::make_shared<std::vector<double>>(at_.size)} {}

  const Offsets& offsets() const { return at_; }
  Snapshot snapshot() const { return now_.numbers; }
  double* now() { return now_.numbers->data(); }
  const double* now() const { return now_.numbers->data(); }
  double* next() { return next_.numbers->data(); }
  bool finite() const { return finite_; }  // all that has been staged for the next tick

  // Stages a whole problem for the next tick. Makes new memory where a snapshot is kept.
  void stage(const double* fields) {
    if (next_.numbers.use_count() > 1) next_ = {std::make_shared<std::vector<double>>(at_.size)};
    if (pattern().sparse()) return stage_sparse(fields);
    finite_ = copy_finite(fields, next(), at_.size);
    J_kept_ = false;
    next_.generation = 0;
  }

  // Stages other numbers for a field, or for fields side by side.
  void stage(const double* numbers, std::size_t offset, std::size_t count) {
    if (offset == at_.J && pattern().sparse())
      stage_jacobian(numbers, count);
    else
      finite_ &= copy_finite(numbers, next() + offset, count);
  }

  // Copies a field's staged numbers back to the fields that were staged.
  void restore(double* fields, std::size_t offset, std::size_t count) {
    if (offset == at_.J && J_kept_ && fields_J_kept_)
      pattern().copy_inside(next() + offset, fields + offset);
    else
      std::copy_n(next() + offset, count, fields + offset);
  }

  // What differs between the last tick and the next, for Engine::tick. The last tick's J keeps to
  // the pattern, which held for it or was found in it.
  unsigned changes() const {
    if (!J_kept_) return find_changes(at_, now(), next_.numbers->data());
    return kJacobianKept | find_changes(at_, now(), next_.numbers->data(), &pattern());
  }

  // The staged numbers become those of the last tick.
  void swap() { std::swap(now_, next_); }

 private:
  struct Buffer {
    std::shared_ptr<std::vector<double>> numbers;
    unsigned generation = 0;  // of the pattern outside which it has zeros when staged to
  };

  const Pattern& pattern() const { return structure_.jacobian(); }

  GRASPFORCE_APART void stage_sparse(const double* fields) {
    finite_ = copy_finite(fields, next(), at_.J);
    stage_jacobian(fields + at_.J, at_.internal - at_.J);
    finite_ &= copy_finite(fields + at_.internal, next() + at_.internal, at_.size - at_.internal);
    fields_J_kept_ = J_kept_;
  }

  GRASPFORCE_APART void stage_jacobian(const double* J, std::size_t count) {
    J_kept_ = pattern().holds(J);
    if (J_kept_ && next_.generation == structure_.generation()) {
      finite_ &= pattern().copy_inside(J, next() + at_.J);
    } else {
      finite_ &= copy_finite(J, next() + at_.J, count);
      next_.generation = J_kept_ ? structure_.generation() : 0;
    }
  }

  Offsets at_;
  const Structure& structure_;
  Buffer now_, next_;
  // Whether the staged J, and that of the fields that were staged, keep to the pattern.
  bool J_kept_ = false, fields_J_kept_ = false, finite_ = true;
};

}  // namespace graspforce
