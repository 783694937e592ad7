// How motors move joints: one to one, through tendons, or with joints that follow others.
//
// Couplings (a joint that mimics another) allow only motions dq of the joints with couplings dq =
// 0; a drive, that is a motor at a joint or on a tendon, moves by drives dq. Turned around, every
// allowed motion is
//
//     dq = driven dl + free dz
//
// with dl the drives' motions and dz motions that no drive takes part in. By virtual work, contact
// forces whose joint torques would be Q on a robot with a motor at every joint need driven.T Q of
// the drives, and can be held only if free.T Q is 0. The same as graspforce.hands.transmission in
// Python, for drives that are independent of each other.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/span.hpp"

namespace graspforce {

// An orthonormal basis that grows by what vectors have beyond it: Gram-Schmidt, done twice.
class Basis {
 public:
  // Of vectors of n numbers.
  explicit Basis(int n) : n_(n), vectors_(static_cast<std::size_t>(n) * n) {}

  int size() const { return size_; }
  const double* operator[](int i) const { return vectors_.data() + std::size_t(i) * n_; }
  void clear() { size_ = 0; }

  // Leaves of v what is at right angles to the basis; adds what it had along each to `along`.
  void project(double* v, double* along = nullptr) const {
    for (int twice = 0; twice < 2; ++twice)
      for (int i = 0; i < size_; ++i) {
        const double* q = (*this)[i];
        double part = 0;
        for (int c = 0; c < n_; ++c) part += q[c] * v[c];
        if (part == 0) continue;
        for (int c = 0; c < n_; ++c) v[c] -= part * q[c];
        if (along != nullptr) along[i] += part;
      }
  }
  // Adds v, of this length, which is at right angles to the basis.
  void add(const double* v, double length) {
    for (int c = 0; c < n_; ++c) vectors_[std::size_t(size_) * n_ + c] = v[c] / length;
    ++size_;
  }
  // Adds what rows span beyond it, the longest first, until what is left of all is no longer than
  // `least`; the rows are used up. Returns how many vectors came.
  int add_span(const Matrix& rows, double least) {
    const int before = size_;
    for (int r = 0; r < rows.rows(); ++r) project(&rows(r, 0));
    while (size_ < n_) {
      int longest = -1;
      double most = least;
      for (int r = 0; r < rows.rows(); ++r)
        if (const double size = norm(&rows(r, 0)); size > most) {
          most = size;
          longest = r;
        }
      if (longest < 0) break;
      add(&rows(longest, 0), most);
      for (int r = 0; r < rows.rows(); ++r) project(&rows(r, 0));
    }
    return size_ - before;
  }
  double norm(const double* v) const {
    double sum = 0;
    for (int c = 0; c < n_; ++c) sum += v[c] * v[c];
    return std::sqrt(sum);
  }

 private:
  int n_, size_ = 0;
  std::vector<double> vectors_;
};

class Transmission {
 public:
  // A singular row below this share of the largest is rounding, not a motion.
  static constexpr double kRank = 1e-8;

  // A joint's motion per motion of a drive.
  struct Entry {
    int dof, drive;
    double ratio;
  };

  // All memory is made here, for so many couplings at most.
  Transmission(int dofs, int drives, int most_couplings)
      : dofs_(dofs),
        drives_(drives),
        basis_(dofs),
        rows_(entries(std::max({most_couplings, drives, dofs}), dofs)),
        given_(entries(most_couplings + drives, dofs)),
        lower_(entries(drives, drives)),
        along_(static_cast<std::size_t>(dofs)),
        driven_(entries(dofs, drives)),
        free_(entries(dofs, dofs)) {
    moves_.reserve(driven_.size());
  }

  int dofs() const { return dofs_; }
  int drives() const { return drives_; }

  // Takes couplings and drives, row by row, as they are now. False where drives depend on each
  // other, or where couplings hold one still: their forces are not determined then.
  bool update(const double* couplings, int count, const double* drives) {
    const std::size_t size = entries(count, dofs_), more = entries(drives_, dofs_);
    const bool same = count == count_ && std::equal(couplings, couplings + size, given_.begin()) &&
                      std::equal(drives, drives + more, given_.begin() + size);
    if (same) return determined_;
    count_ = count;
    std::copy(couplings, couplings + size, given_.begin());
    std::copy(drives, drives + more, given_.begin() + size);
    return determined_ = find(couplings, drives);
  }

  // The entries of `driven` that are not 0.
  Span<const Entry> driven() const { return {moves_.data(), int(moves_.size())}; }

  // How many motions no drive takes part in, and the joints' parts in one of them: orthonormal.
  int free() const { return free_count_; }
  const double* free(int motion) const { return free_.data() + entries(motion, dofs_); }

 private:
  static std::size_t entries(int rows, int columns) { return std::size_t(rows) * columns; }

  bool find(const double* couplings, const double* drives) {
    basis_.clear();
    moves_.clear();
    free_count_ = 0;
    Matrix rows(rows_.data(), count_, dofs_);
    std::copy_n(couplings, entries(count_, dofs_), rows_.begin());
    double most = 0;
    for (int r = 0; r < count_; ++r) most = std::max(most, basis_.norm(&rows(r, 0)));
    const int held = basis_.add_span(rows, kRank * most);

    // What couplings leave of the drives, D = L Q; then driven = Qᵀ L⁻¹ moves every drive by
    // itself, and the joints no more than that takes.
    std::fill(lower_.begin(), lower_.end(), 0);
    for (int d = 0; d < drives_; ++d) {
      double* const row = rows_.data();
      std::copy_n(drives + entries(d, dofs_), dofs_, row);
      const double whole = basis_.norm(row);
      std::fill(along_.begin(), along_.end(), 0);
      basis_.project(row, along_.data());
      const double left = basis_.norm(row);
      if (!(left > kRank * whole)) return false;
      for (int j = 0; j < d; ++j) lower_[entries(d, drives_) + j] = along_[held + j];
      lower_[entries(d, drives_) + d] = left;
      basis_.add(row, left);
    }
    double largest = 0;
    for (int i = 0; i < dofs_; ++i)
      for (int j = drives_ - 1; j >= 0; --j) {  // one row of driven: x L = q
        double x = basis_[held + j][i];
        for (int k = j + 1; k < drives_; ++k)
          x -= driven_[entries(i, drives_) + k] * lower_[entries(k, drives_) + j];
        x /= lower_[entries(j, drives_) + j];
        driven_[entries(i, drives_) + j] = x;
        largest = std::max(largest, std::abs(x));
      }
    for (int i = 0; i < dofs_; ++i)
      for (int j = 0; j < drives_; ++j)
        if (const double x = driven_[entries(i, drives_) + j]; std::abs(x) > kRounding * largest)
          moves_.push_back({i, j, x});

    // The rest of all motions.
    const int taken = basis_.size();
    if (taken == dofs_) return true;
    Matrix every(rows_.data(), dofs_, dofs_);
    for (int i = 0; i < dofs_; ++i)
      for (int j = 0; j < dofs_; ++j) every(i, j) = i == j;
    free_count_ = basis_.add_span(every, 1e-6);
    for (int k = 0; k < free_count_; ++k)
      for (int i = 0; i < dofs_; ++i) {
        const double x = basis_[taken + k][i];
        free_[entries(k, dofs_) + i] = std::abs(x) > kRounding ? x : 0;
      }
    return true;
  }

  // What is smaller than this share is rounding: fingers that share no joint must not seem to.
  static constexpr double kRounding = 1e-12;

  int dofs_, drives_, count_ = -1, free_count_ = 0;
  bool determined_ = false;
  Basis basis_;
  std::vector<double> rows_, given_, lower_, along_, driven_, free_;
  std::vector<Entry> moves_;
};

}  // namespace graspforce
