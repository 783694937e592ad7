// What ties joints to each other: joints that follow others, and closed loops of links.
//
// A loop is closed by a constraint between two of its links: a point of one stays at a point of the
// other (Place), and where they are welded, so does their orientation (Turn). Such loops never
// close exactly: a file's numbers are rounded, a simulation's constraints are soft, and the axes of
// a plane linkage are parallel to a mrad or so. Taken by their word they would stop a linkage that
// turns. So what holds a linkage by less than kPlay of what its other constraints do counts as play
// in the bearings. To compare them, a joint's turn counts by the way it makes at the linkage's
// size, in metres like a slide. The same as graspforce.hands.loops.rows_of in Python.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "graspforce/span.hpp"

namespace graspforce {

class Linkages {
 public:
  enum class Kind { Ratio, Place, Turn };  // Ratio is a joint that follows, and whatever is no loop
  static constexpr double kPlay = 3e-3;
  // A loop that is open by more than this share of its size is no loop.
  static constexpr double kHopeless = 0.1;

  // Of so many rows in so many couplings at most. `turns` says which joints turn; the others slide.
  Linkages(const std::vector<char>& turns, int most_rows, int most_couplings)
      : dofs_(static_cast<int>(turns.size())),
        turns_(turns),
        rows_(std::size_t(most_rows) * dofs_),
        even_(rows_.size()),
        found_(rows_.size()),
        joints_(dofs_) {
    couplings_.reserve(most_couplings);
    spans_.reserve(most_couplings);
  }

  void clear() {
    couplings_.clear();
    used_ = count_ = 0;
    open_ = 0;
  }

  // Adds a coupling; its rows, gradients by the joints' motions, are to be written where the result
  // points, zeros before. `gap`: by how much it is missed [m for a Place].
  double* add(Kind kind, int rows, double gap) {
    couplings_.push_back({kind, used_, rows, gap, false});
    double* const first = row(used_);
    std::fill_n(first, std::size_t(rows) * dofs_, 0);
    used_ += rows;
    return first;
  }

  // Finds what the couplings leave no joint motion along: rows().
  void find() {
    for (Coupling& each : couplings_) each.done = !any(each);
    for (std::size_t i = 0; i < couplings_.size(); ++i)
      if (!couplings_[i].done) find_group(i);
  }
  const double* rows() const { return found_.data(); }
  int count() const { return count_; }
  // By which share of its size the most open loop is open.
  double open() const { return open_; }

 private:
  struct Coupling {
    Kind kind;
    int first, rows;
    double gap;
    bool done;
  };

  // What is rounding beside a row, and in the cosine of a right angle.
  static constexpr double kNothing = 1e-13, kRight = 1e-14;

  double* row(int i) { return rows_.data() + std::size_t(i) * dofs_; }
  double* even(int i) { return even_.data() + std::size_t(i) * dofs_; }
  bool any(const Coupling& each) {
    const double* const first = row(each.first);
    return std::any_of(first, first + std::size_t(each.rows) * dofs_,
                       [](double x) { return x != 0; });
  }
  bool shares(const Coupling& each) {
    for (int r = each.first; r < each.first + each.rows; ++r)
      for (int i = 0; i < dofs_; ++i)
        if (joints_[i] && row(r)[i] != 0) return true;
    return false;
  }

  // The couplings that share joints with one, together: a linkage.
  void find_group(std::size_t start) {
    std::fill(joints_.begin(), joints_.end(), false);
    group_rows_ = 0;
    bool loops = false;
    double size = 0, gap = 0;
    const auto take = [&](Coupling& each) {
      each.done = true;
      loops = loops || each.kind != Kind::Ratio;
      for (int r = each.first; r < each.first + each.rows; ++r) {
        std::copy_n(row(r), dofs_, even(group_rows_++));
        for (int i = 0; i < dofs_; ++i) {
          joints_[i] = joints_[i] || row(r)[i] != 0;
          if (each.kind == Kind::Place && turns_[i]) size = std::max(size, std::abs(row(r)[i]));
        }
      }
      if (each.kind == Kind::Place) gap = std::max(gap, each.gap);
      spans_.push_back(each.rows);
    };
    spans_.clear();
    take(couplings_[start]);
    for (bool more = true; more;) {
      more = false;
      for (Coupling& each : couplings_)
        if (!each.done && shares(each)) {
          take(each);
          more = true;
        }
    }
    if (!loops) {
      for (int r = 0; r < group_rows_; ++r) keep(even(r));
      return;
    }
    if (size == 0) size = 1;
    open_ = std::max(open_, gap / size);
    make_even(size);
    make_orthogonal();
    double most = 0;
    for (int r = 0; r < group_rows_; ++r) most = std::max(most, norm(even(r)));
    for (int r = 0; r < group_rows_; ++r) {
      if (!(norm(even(r)) > kPlay * most)) continue;
      for (int i = 0; i < dofs_; ++i) even(r)[i] *= turns_[i] ? size : 1;
      const double length = norm(even(r));
      for (int i = 0; i < dofs_; ++i) even(r)[i] /= length;
      keep(even(r));
    }
  }

  // Each coupling's rows by the joints' ways, its largest entry 1.
  void make_even(double size) {
    int r = 0;
    for (const int rows : spans_) {
      double most = 0;
      for (int k = r; k < r + rows; ++k)
        for (int i = 0; i < dofs_; ++i) {
          if (turns_[i]) even(k)[i] /= size;
          most = std::max(most, std::abs(even(k)[i]));
        }
      for (int k = r; k < r + rows; ++k)
        for (int i = 0; i < dofs_; ++i) even(k)[i] /= most == 0 ? 1 : most;
      r += rows;
    }
  }

  // Rotates pairs of rows until all are at right angles: Jacobi's singular value decomposition, of
  // which the rows are then the right vectors times the values.
  void make_orthogonal() {
    for (int sweep = 0; sweep < 60; ++sweep) {
      bool turned = false;
      for (int i = 0; i < group_rows_; ++i)
        for (int j = i + 1; j < group_rows_; ++j) {
          double *const a = even(i), *const b = even(j);
          double aa = 0, bb = 0, ab = 0;
          for (int k = 0; k < dofs_; ++k) {
            aa += a[k] * a[k];
            bb += b[k] * b[k];
            ab += a[k] * b[k];
          }
          // Rows that are rounding beside others never come to right angles, nor have to.
          const bool alone = std::min(aa, bb) <= kNothing * kNothing * std::max(aa, bb);
          if (alone || !(std::abs(ab) > kRight * std::sqrt(aa * bb))) continue;
          turned = true;
          const double zeta = (bb - aa) / (2 * ab);
          const double t = (zeta >= 0 ? 1 : -1) / (std::abs(zeta) + std::sqrt(1 + zeta * zeta));
          const double c = 1 / std::sqrt(1 + t * t), s = c * t;
          for (int k = 0; k < dofs_; ++k) {
            const double x = a[k], y = b[k];
            a[k] = c * x - s * y;
            b[k] = s * x + c * y;
          }
        }
      if (!turned) return;
    }
  }

  double norm(const double* v) const {
    double sum = 0;
    for (int i = 0; i < dofs_; ++i) sum += v[i] * v[i];
    return std::sqrt(sum);
  }
  void keep(const double* v) { std::copy_n(v, dofs_, &found_[std::size_t(count_++) * dofs_]); }

  int dofs_, used_ = 0, count_ = 0, group_rows_ = 0;
  double open_ = 0;
  std::vector<char> turns_;
  std::vector<double> rows_, even_, found_;
  std::vector<char> joints_;
  std::vector<int> spans_;
  std::vector<Coupling> couplings_;
};

}  // namespace graspforce
