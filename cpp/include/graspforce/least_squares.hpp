// The step of a hard problem, without squaring its condition.
//
// Near the boundary the Hessian H = Gᵀ G of a block holds the squares of slacks that differ by many
// orders of magnitude, and Cholesky loses the small ones beside the large. The same step is the
// solution of a least-squares problem in G itself,
//
//     minimise ‖G d + τ γ + δ h‖²  subject to  W d = r,
//
// with the scaled gradient γ and, in Phase 1, the column h of the slack σ, whose step is δ.
// Reflections reduce each block to R (Gᵀ G = Rᵀ R), then the stack of Z = R⁻ᵀ Wᵀ to k rows. In
// those orthogonal coordinates the minimiser can be read off: the k rows are given by W d = r, and
// in the others p = R d is −(τ γ + δ h). No term is a difference of larger ones.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/blocks.hpp"
#include "graspforce/linalg.hpp"

namespace graspforce {

class LeastSquares {
 public:
  explicit LeastSquares(const Blocks& blocks)
      : blocks_(blocks),
        arena_(most_numbers(blocks.layout())),
        Z_(unknowns(blocks.layout()) * row_stride(blocks.layout().wrench_rows + 2)),
        p_(unknowns(blocks.layout())),
        top_(blocks.layout().wrench_rows),
        beta_(std::max<std::size_t>(blocks.layout().wrench_rows, unknowns(blocks.layout()))) {
    G_.reserve(most_blocks(blocks.layout()));
  }

  // Makes the matrices that are kept by block; needed after Blocks::allot. Does not allocate.
  void allot() {
    std::size_t total = 0;
    for (const BlockData& part : blocks_.parts()) total += numbers(part);
    arena_.reset(total);
    G_.clear();
    m_ = 0;
    for (const BlockData& part : blocks_.parts()) {
      G_.push_back(arena_.take(numbers(part)));
      m_ += part.q;
    }
  }

  // ---- setting up ----------------------------------------------------------------------------

  void clear() {
    for (std::size_t b = 0; b < G_.size(); ++b)
      std::fill_n(G_[b], numbers(blocks_.parts()[b]), 0.0);
    hh_ = gh_ = 0;
  }

  // Row i of a block, one of rows + q: q entries of G, then that of γ, then that of h.
  double* row(int b, int i) { return G_[b] + i * width(blocks_.parts()[b]); }

  // A row of zeros in G with these entries in γ and h.
  void add_row(double gamma, double h) {
    hh_ += h * h;
    gh_ += gamma * h;
  }

  // Factors G as it stands and sets r (k).
  void factor(const double* r) {
    int first = 0;
    for (std::size_t b = 0; b < G_.size(); ++b) {
      const BlockData& part = blocks_.parts()[b];
      const int q = part.q, height = q + part.rows;
      reflect(G_[b], height, q, width(part), beta_.data());
      for (int i = q; i < height; ++i) add_row(row(b, i)[q], row(b, i)[q + 1]);
      set_wrench(part, first);
      solve_transposed(G_[b], q, width(part), z(first), width());
      for (int i = 0; i < q; ++i) std::copy_n(row(b, i) + q, 2, z(first + i) + k());
      first += q;
    }
    reduce_wrench(r);
  }

  // Sets r for G = 1: the step of least norm.
  void set_least_norm(const double* r) {
    hh_ = gh_ = 0;
    int first = 0;
    for (const BlockData& part : blocks_.parts()) {
      set_wrench(part, first);
      first += part.q;
    }
    reduce_wrench(r);
  }

  // ---- solving -------------------------------------------------------------------------------

  // δ that minimises δ + ½‖G d + τ γ + δ h‖² together with d.
  double slack_step(double tau) const {
    double slope = 1 + tau * gh_, curvature = hh_;
    for (int r = 0; r < k(); ++r) {
      const double h = z(r)[k() + 1];
      slope += h * (top_[r] + tau * z(r)[k()]);
      curvature += h * h;
    }
    return -slope / curvature;
  }

  // ‖R d‖ for δ = 0: the Newton decrement.
  double length(double tau) const {
    double squared = 0;
    for (int r = 0; r < k(); ++r) squared += top_[r] * top_[r];
    for (int i = k(); i < m_; ++i) squared += tau * tau * z(i)[k()] * z(i)[k()];
    return std::sqrt(squared);
  }

  // The multipliers ν (k) of W d = r for this τ and δ.
  void multipliers(double tau, double delta, double* nu) const {
    for (int r = 0; r < k(); ++r) nu[r] = top_[r] + tau * z(r)[k()] + delta * z(r)[k() + 1];
    solve_upper(Z_.data(), k(), width(), nu);
  }

  // The step d, block after block.
  void step(double tau, double delta, double* d) {
    step_in_R(tau, delta);
    leave_R(d);
  }
  // The same for G = 1.
  void least_norm_step(double* d) {
    step_in_R(0, 0);
    std::copy_n(p_.begin(), m_, d);
  }

  // Norm of what a gradient g (block after block) has in the directions with W d = 0, by the
  // factors at hand, and the multipliers ν that fit it best.
  double project(const double* g, double* nu) {
    enter_R(g);
    std::copy_n(p_.begin(), k(), nu);
    solve_upper(Z_.data(), k(), width(), nu);
    double squared = 0;
    for (int i = k(); i < m_; ++i) squared += p_[i] * p_[i];
    return std::sqrt(squared);
  }

  // Solves Gᵀ G d + Wᵀ ν = g, W d = r by the factors at hand; g and d stand block after block.
  void solve(const double* g, const double* r, double* d, double* nu) {
    enter_R(g);
    // W d = r gives the first k of p, and what it leaves of g there is the multipliers'.
    std::copy_n(r, k(), top_.begin());
    solve_transposed(Z_.data(), k(), width(), top_.data());
    for (int i = 0; i < k(); ++i) nu[i] = p_[i] - top_[i];
    solve_upper(Z_.data(), k(), width(), nu);
    std::copy_n(top_.begin(), k(), p_.begin());
    for (int j = k() - 1; j >= 0; --j) mirror(j);
    leave_R(d);
  }

 private:
  static std::size_t most_numbers(const Layout& layout) {
    return (most_rows(layout) + unknowns(layout)) * row_stride(largest_block(layout) + 2);
  }
  static int width(const BlockData& part) { return row_stride(part.q + 2); }
  static std::size_t numbers(const BlockData& part) {
    return std::size_t(part.rows + part.q) * width(part);
  }

  int k() const { return blocks_.k(); }
  int width() const { return row_stride(k() + 2); }
  double* z(int i) { return Z_.data() + i * width(); }
  const double* z(int i) const { return Z_.data() + i * width(); }

  // A block's Wᵀ into its rows of Z, from row `first` on, with zeros behind it.
  void set_wrench(const BlockData& part, int first) {
    for (int i = 0; i < part.q; ++i) {
      std::copy_n(part.Wt + i * k(), k(), z(first + i));
      std::fill_n(z(first + i) + k(), width() - k(), 0.0);
    }
  }

  void reduce_wrench(const double* r) {
    reflect(Z_.data(), m_, k(), width(), beta_.data());
    std::copy_n(r, k(), top_.begin());
    solve_transposed(Z_.data(), k(), width(), top_.data());
  }

  // p ← R d.
  void step_in_R(double tau, double delta) {
    std::copy_n(top_.begin(), k(), p_.begin());
    for (int i = k(); i < m_; ++i) p_[i] = -(tau * z(i)[k()] + delta * z(i)[k() + 1]);
    for (int j = k() - 1; j >= 0; --j) mirror(j);
  }

  // Reflection j of the stack, applied to p.
  void mirror(int j) {
    double along = p_[j];
    for (int i = j + 1; i < m_; ++i) along += z(i)[j] * p_[i];
    along *= beta_[j];
    p_[j] -= along;
    for (int i = j + 1; i < m_; ++i) p_[i] -= along * z(i)[j];
  }

  // p ← R⁻ᵀ g, in the coordinates in which the stack is reduced.
  void enter_R(const double* g) {
    std::copy_n(g, m_, p_.begin());
    int first = 0;
    for (std::size_t b = 0; b < G_.size(); ++b) {
      const BlockData& part = blocks_.parts()[b];
      solve_transposed(G_[b], part.q, width(part), p_.data() + first);
      first += part.q;
    }
    for (int j = 0; j < k(); ++j) mirror(j);
  }

  void leave_R(double* d) {
    std::copy_n(p_.begin(), m_, d);
    for (std::size_t b = 0; b < G_.size(); ++b) {
      const BlockData& part = blocks_.parts()[b];
      solve_upper(G_[b], part.q, width(part), d);
      d += part.q;
    }
  }

  const Blocks& blocks_;
  Arena arena_;
  // Both in rows of whole vectors: (rows + q) × (q + 2) a block, whose upper triangle is R once it
  // is factored, and m × (k + 2), Wᵀ, γ, h in R's coordinates, then reduced.
  std::vector<double*> G_;
  std::vector<double> Z_;
  std::vector<double> p_, top_, beta_;
  int m_ = 0;               // components of all blocks
  double hh_ = 0, gh_ = 0;  // h·h and γ·h in the rows that no step reaches
};

}  // namespace graspforce
