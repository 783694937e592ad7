// Contacts that pull, as an ordinary problem.
//
// A contact that a vacuum or a magnet holds with p bears n ≥ −p, with friction by the preload n +
// p: its cone is the ordinary one, shifted by −p along the normal. In c' = c + p along every normal
// all cones are ordinary, and what is linear stays so, with other right-hand sides:
//
//     W c' = f + W p,  Jᵀc' + (tau_bias − Jᵀp),  c'_norm ≤ c_max + p,  A c' ≤ b + A p, …
//
// so the core knows c' alone. Multipliers, proofs, steps and Phi are those of the problem in c'.
// p is engagement·pull: a contact that leaves the grasp lets go.
#pragma once

#include <algorithm>
#include <vector>

#include "graspforce/lanes.hpp"
#include "graspforce/layout.hpp"

namespace graspforce {

class Pull {
 public:
  explicit Pull(const Layout& layout) : outer_(layout), inner_(layout), at_(outer_), to_(inner()) {
    if (!outer_.pulls) return;
    numbers_.resize(to_.size);
    shift_.resize(outer_.contacts());
    forces_.resize(force_count(outer_));
  }

  const Layout& outer() const { return outer_; }
  // The layout of the problem in c'.
  const Layout& inner() {
    inner_.pulls = false;
    return inner_;
  }
  std::size_t packed_size() const { return at_.size; }

  // The numbers of the problem in c', until the next call; of a problem without pulls its own.
  const double* problem(const double* packed) { return outer_.pulls ? shifted(packed) : packed; }

  // c from c', and the reverse, by the pulls of the last problem. Zeros, which stand for no answer,
  // stay.
  const double* outward(const double* forces) { return outer_.pulls ? reduced(forces) : forces; }
  const double* inward(const double* forces) { return outer_.pulls ? moved(forces, 1) : forces; }

 private:
  // Apart, so that a problem without pulls pays for nothing but the question.
  GRASPFORCE_APART const double* shifted(const double* packed) {
    double* to = std::copy(packed, packed + at_.pull, numbers_.data());
    std::copy(packed + at_.f_soft, packed + at_.size, to);
    const Problem p(at_, packed);
    double* numbers = numbers_.data();
    const int m = outer_.components(), joints = outer_.joints;
    for (int i = 0, c = 0; i < outer_.contacts(); c += static_cast<int>(outer_.models[i]), ++i) {
      const double pull = shift_[i] = p.in_grasp(i) ? p.engagement[i] * p.pull[i] : 0;
      if (outer_.ceilings) numbers[to_.c_max + i] += p.pull[i];
      if (outer_.floors) numbers[to_.c_min + i] += p.pull[i];
      if (outer_.rate_limits) numbers[to_.c_last + c] += pull;
      for (int r = 0; r < outer_.wrench_rows; ++r)
        numbers[to_.f + r] += p.W[entry_at(r, c, m)] * pull;
      for (int j = 0; j < joints; ++j)
        numbers[to_.tau_bias + j] -= p.J[entry_at(c, j, joints)] * pull;
      for (int r = 0; r < outer_.inequalities; ++r)
        numbers[to_.b + r] += p.A[entry_at(r, c, m)] * pull;
    }
    return numbers;
  }

  GRASPFORCE_APART const double* reduced(const double* forces) {
    const double* end = forces + forces_.size();
    if (std::all_of(forces, end, [](double c) { return c == 0; })) return forces;
    return moved(forces, -1);
  }

  GRASPFORCE_APART const double* moved(const double* forces, double sign) {
    std::copy_n(forces, forces_.size(), forces_.begin());
    for (int i = 0, c = 0; i < outer_.contacts(); c += static_cast<int>(outer_.models[i]), ++i)
      forces_[c] += sign * shift_[i];
    return forces_.data();
  }

  Layout outer_, inner_;
  Offsets at_, to_;
  std::vector<double> numbers_, shift_, forces_;
};

}  // namespace graspforce
