// The KKT system of a grasp at given forces, factored once for many right-hand sides: what the
// derivatives of an optimum with respect to anything in the problem are solutions of.
//
//     H d + Wᵀ ν = g        H = ∇²Phi(c), of Phi itself (Eq. 16)
//     W d = r               of a soft row, W d − f_soft² ν = r
//
// At an optimum ∇Phi(c) = Wᵀ nu and W c = f. A change of the problem by a parameter p moves it by
// d = dc/dp and ν = −dnu/dp with g = −∂(∇Phi − Wᵀ nu)/∂p and r = ∂(f − W c)/∂p: for a change of f
// alone g = 0 and r = df. The matrix is symmetric, so adjoints solve the same system.
//
// H is factored as Gᵀ G by reflections (least_squares.hpp), which keep the digits that H itself has
// lost where an optimum is close to its limits.
#pragma once

#include <algorithm>
#include <vector>

#include "graspforce/floating_point.hpp"
#include "graspforce/orthogonal_barrier.hpp"
#include "graspforce/pull.hpp"
#include "graspforce/rank.hpp"

namespace graspforce {

class Factor {
 public:
  // Makes the memory for any problem of the layout; nothing after it allocates.
  explicit Factor(const Layout& layout)
      : pull_(layout),
        layout_(pull_.inner()),
        offsets_(layout_),
        structure_(layout_),
        blocks_(layout_),
        least_squares_(blocks_),
        barrier_(blocks_, least_squares_),
        rank_(layout_),
        g_(unknowns(layout_)),
        d_(g_),
        r_(layout_.wrench_rows),
        nu_(r_) {}
  Factor(const Factor&) = delete;
  Factor& operator=(const Factor&) = delete;

  const Layout& layout() const { return pull_.outer(); }

  // Forgets the blocks of the problems before: the next solutions depend on the next problem alone,
  // to the last bit.
  void forget() { structure_.forget(); }

  // Factors a packed problem at forces c, the internal ones behind those of the contacts. False,
  // and nothing to solve with, unless c is strictly inside every cone and limit. Contacts out of
  // the grasp do not count.
  bool at(const double* packed, const double* c) {
    const DefaultFloatingPoint environment;
    const Problem problem(offsets_, pull_.problem(packed));
    if (!structure_.holds(problem)) {
      structure_.find(problem);
      blocks_.allot(structure_);
      least_squares_.allot();
      barrier_.allot();
    }
    blocks_.load(problem);
    rank_.run(problem);
    if (rank_.deficient()) blocks_.restrict_rows(problem, rank_.rows());
    barrier_.set_weights(1, *problem.alpha);
    barrier_.set_forces(pull_.inward(c));
    if (!barrier_.evaluate()) return false;
    std::fill(r_.begin(), r_.end(), 0.0);
    least_squares_.factor(r_.data());
    return true;
  }

  // Solves in place for `columns` right-hand sides that stand beside each other in the rows of x,
  // those of the m forces, of the internal ones behind them, and of the k of W: (g, r) becomes
  // (d, ν). Contacts out of the grasp get d = 0 whatever their g. Where W has dependent rows each r
  // has to lie in its range; ν is then zero in the rows that depend on the others, whose r is not
  // looked at.
  void solve(double* x, int columns) {
    const DefaultFloatingPoint environment;
    const std::size_t width = columns;
    const int forces = force_count(layout_);
    double* const wrench = x + forces * width;
    for (int column = 0; column < columns; ++column) {
      each_component([&](int c, double& g, double&) { g = x[c * width + column]; });
      for (int r = 0; r < blocks_.k(); ++r) r_[r] = wrench[blocks_.row(r) * width + column];
      least_squares_.solve(g_.data(), r_.data(), d_.data(), nu_.data());
      for (int c = 0; c < forces; ++c) x[c * width + column] = 0;
      for (int r = 0; r < layout_.wrench_rows; ++r) wrench[r * width + column] = 0;
      each_component([&](int c, double&, double& d) { x[c * width + column] = d; });
      for (int r = 0; r < blocks_.k(); ++r) wrench[blocks_.row(r) * width + column] = nu_[r];
    }
  }

 private:
  // Calls work(component in the problem, its g, its d), block after block. The g of the slacks of a
  // soft wrench, which come after the blocks, stays zero.
  template <class Work>
  void each_component(Work work) {
    std::size_t next = 0;
    for (const BlockData& part : blocks_.parts())
      for (int component : part.components) {
        work(component, g_[next], d_[next]);
        ++next;
      }
  }

  Pull pull_;
  Layout layout_;
  Offsets offsets_;
  Structure structure_;
  Blocks blocks_;
  LeastSquares least_squares_;
  OrthogonalBarrier barrier_;
  RankExamination rank_;
  std::vector<double> g_, d_, r_, nu_;  // of one right-hand side, block after block
};

}  // namespace graspforce
