// Rank of the grasp map: which rows of W c = f are independent, and whether f fits the others.
//
// Two point contacts, planar grasps and parallel frictionless fingers have a W of lower rank.
// Newton's method then works on an independent set of rows. The rest of f is either implied by
// those rows or unreachable by any forces of these contacts.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/cone.hpp"
#include "graspforce/layout.hpp"
#include "graspforce/linalg.hpp"

namespace graspforce {

inline constexpr double kRankTolerance = 1e-10;
inline constexpr double kReachTolerance = 1e-9;

class RankExamination {
 public:
  explicit RankExamination(const Layout& layout)
      : layout_(layout),
        k_(layout.wrench_rows),
        m_(layout.components()),
        Q_(static_cast<std::size_t>(k_) * m_),
        f_(k_),
        size_(k_),
        length_(k_),
        used_(k_) {
    exact_.reserve(k_);
    all_exact_.reserve(k_);
    rows_.reserve(k_);
  }

  // An independent set of the exact rows, best conditioned first.
  const std::vector<int>& exact_rows() const { return exact_; }
  // All exact rows, those that depend on others included.
  const std::vector<int>& all_exact_rows() const { return all_exact_; }
  // The independent ones, and the soft ones, which are independent of all others by their slacks.
  const std::vector<int>& rows() const { return rows_; }
  bool deficient() const { return deficient_; }  // by the last run; false before the first
  bool overflows() const { return overflows_; }  // whether f is reachable cannot be told
  bool unreachable() const { return known_ && (overflows_ || !reachable_); }
  bool known() const { return known_; }  // there was a run since `forget`
  void forget() { known_ = false; }
  void reach() { reachable_ = true; }  // f is replaced by one that fits all rows
  void forget_deficiency() { deficient_ = false; }

  // Gram-Schmidt with pivoting and reorthogonalisation over the rows of W; contacts out of the
  // grasp do not count.
  void run(const Problem& p) {
    known_ = true;
    scale_rows(p);
    exact_.clear();
    all_exact_.clear();
    for (int r = 0; r < k_; ++r)
      if (!is_soft(p, r)) all_exact_.push_back(r);
    for (int best = longest_row(); best >= 0; best = longest_row()) {
      used_[best] = true;
      exact_.push_back(best);
      eliminate(best);
    }
    rows_ = exact_;
    for (int r = 0; r < k_; ++r)
      if (is_soft(p, r)) rows_.push_back(r);
    deficient_ = static_cast<int>(rows_.size()) < k_;
    // Eliminating a row from another eliminates it from f as well; what is left of f on a row that
    // has vanished is out of reach.
    double largest_f = 0;  // what rounding in f is measured by
    double c = 0;  // what the rows ask of the forces: a relative change of W counts times that
    for (int r = 0; r < k_; ++r) {
      if (is_soft(p, r)) continue;
      largest_f = std::max(largest_f, std::abs(p.f[r]));
      if (used_[r]) c = std::max(c, std::abs(f_[r]));
    }
    reachable_ = true;
    overflows_ = false;
    for (int r = 0; r < k_; ++r) {
      const double left = std::abs(f_[r]) * length_[r];
      overflows_ = overflows_ || !std::isfinite(size_[r] * length_[r]);
      if (!used_[r] &&
          left > kReachTolerance * std::max(std::max(size_[r], c) * length_[r], largest_f))
        reachable_ = false;
    }
  }

  // Whether forces make all of f, the rows that were left out included: what rounding hides from
  // `run` in rows of very different sizes shows here.
  bool fits(const Problem& p, const double* c) const {
    double worst = 0, scale = 0;
    for (int r = 0; r < k_; ++r) {
      if (is_soft(p, r)) continue;
      const double* w = p.W + static_cast<std::size_t>(r) * m_;
      double sum = 0, size = std::abs(p.f[r]);
      for (int i = 0; i < m_; ++i) {
        sum += w[i] * c[i];
        size += std::abs(w[i] * c[i]);
      }
      worst = std::max(worst, std::abs(p.f[r] - sum));
      scale = std::max(scale, size);
    }
    return worst <= kReachTolerance * scale && scale < kInfinity;
  }

 private:
  bool is_soft(const Problem& p, int r) const { return layout_.soft_wrench && p.f_soft[r] > 0; }
  double* row(int r) { return Q_.data() + static_cast<std::size_t>(r) * m_; }

  // Rows of unit length: forces and torques have different units.
  void scale_rows(const Problem& p) {
    for (int r = 0; r < k_; ++r) {
      double sum = 0, largest = 0;
      for (int i = 0, c = 0; i < layout_.contacts(); ++i)
        for (int d = 0; d < static_cast<int>(layout_.models[i]); ++d, ++c) {
          row(r)[c] = p.in_grasp(i) ? p.W[entry_at(r, c, m_)] : 0;
          largest = std::max(largest, std::abs(row(r)[c]));
        }
      for (int c = 0; c < m_ && largest > 0; ++c) sum += std::pow(row(r)[c] / largest, 2);
      length_[r] = sum > 0 ? largest * std::sqrt(sum) : 1;
      for (int c = 0; c < m_; ++c) row(r)[c] /= length_[r];
      f_[r] = p.f[r] / length_[r];
      size_[r] = std::abs(f_[r]);
      used_[r] = is_soft(p, r);
    }
  }

  // The longest of the rows that are left, −1 when they have all vanished.
  int longest_row() {
    int best = -1;
    double longest = kRankTolerance * kRankTolerance;
    for (int r = 0; r < k_; ++r) {
      const double squared = used_[r] ? 0 : dot(row(r), row(r), m_);
      if (squared > longest) {
        longest = squared;
        best = r;
      }
    }
    return best;
  }

  void eliminate(int best) {
    const double inverse = 1 / std::sqrt(dot(row(best), row(best), m_));
    for (int c = 0; c < m_; ++c) row(best)[c] *= inverse;
    f_[best] *= inverse;
    size_[best] *= inverse;
    for (int r = 0; r < k_; ++r) {
      for (int pass = 0; pass < 2 && !used_[r]; ++pass) {
        const double along = dot(row(r), row(best), m_);
        add_scaled(-along, row(best), m_, row(r));
        f_[r] -= along * f_[best];
        size_[r] += std::abs(along) * size_[best];
      }
    }
  }

  const Layout& layout_;
  int k_, m_;
  std::vector<double> Q_, f_, size_, length_;
  std::vector<char> used_;
  std::vector<int> exact_, all_exact_, rows_;
  bool known_ = false, deficient_ = false, reachable_ = true, overflows_ = false;
};

}  // namespace graspforce
