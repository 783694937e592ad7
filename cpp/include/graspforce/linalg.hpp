// Dense factorisations for the small systems of the method, row-major: Cholesky, and Householder's
// reflections where its squared condition costs too many digits.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>

#include "graspforce/lanes.hpp"

namespace graspforce {

inline void add_scaled(double factor, const double* a, int n, double* sum) {
  for (int i = 0; i < n; ++i) sum[i] += factor * a[i];
}

inline double dot(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

// Factors the lower triangle of the n×n matrix `a` in place, a = L Lᵀ, and returns the smallest
// pivot relative to its diagonal entry before elimination: how far the matrix is from singular,
// independent of the scaling of its rows. A pivot lost to rounding is replaced by a tiny positive
// one.
inline double cholesky(double* a, int n) {
  double smallest = 1;
  for (int i = 0; i < n; ++i) {
    double* row = a + i * n;
    for (int j = 0; j < i; ++j) {
      const double* other = a + j * n;
      double sum = row[j];
      for (int k = 0; k < j; ++k) sum -= row[k] * other[k];
      row[j] = sum / other[j];
    }
    const double before = row[i];
    double pivot = before;
    for (int k = 0; k < i; ++k) pivot -= row[k] * row[k];
    const double relative = pivot / before;
    if (!(relative >= smallest)) smallest = relative;
    if (!(relative > 1e-15)) pivot = 1e-15 * before;
    row[i] = std::sqrt(pivot);
  }
  return smallest;
}

// x ← L⁻¹ x, for `columns` right-hand sides that stand beside each other in rows.
inline void forward_substitute(const double* L, int n, double* x, int columns = 1) {
  for (int i = 0; i < n; ++i) {
    const double* row = L + i * n;
    double* target = x + i * columns;
    for (int k = 0; k < i; ++k) {
      const double factor = row[k];
      const double* source = x + k * columns;
      for (int c = 0; c < columns; ++c) target[c] -= factor * source[c];
    }
    const double inverse = 1 / row[i];
    for (int c = 0; c < columns; ++c) target[c] *= inverse;
  }
}

// x ← L⁻ᵀ x
inline void back_substitute(const double* L, int n, double* x) {
  for (int i = n - 1; i >= 0; --i) {
    x[i] /= L[i * n + i];
    for (int k = 0; k < i; ++k) x[k] -= L[i * n + k] * x[i];
  }
}

// How far apart the rows of a matrix stand that are worked on four columns at a time; what they
// have behind the last column is zero.
inline int row_stride(int columns) { return (columns + kLanes - 1) / kLanes * kLanes; }

// Applies reflection j, in column j of the rows from j on, to the columns behind j among
// 4 × `vectors` from `first` on.
template <int vectors>
inline void reflect_columns(double* a, int rows, int stride, int j, double beta, int first) {
  double* const head = a + j * stride + first;
  const double* const v = a + j;
  Lanes along[vectors];
  GRASPFORCE_UNROLL
  for (int k = 0; k < vectors; ++k) along[k] = four_at(head + k * kLanes);
  for (int i = j + 1; i < rows; ++i) {
    const double entry = v[i * stride];
    if (entry == 0) continue;  // many are: a contact's cone is independent of the others
    const double* const row = a + i * stride + first;
    GRASPFORCE_UNROLL
    for (int k = 0; k < vectors; ++k) along[k] += entry * four_at(row + k * kLanes);
  }
  GRASPFORCE_UNROLL
  for (int k = 0; k < vectors; ++k) along[k] *= beta;
  for (int c = 0; first + c <= j; ++c) along[0][c] = 0;
  const auto subtract = [&along](double entry, double* row) {
    GRASPFORCE_UNROLL
    for (int k = 0; k < vectors; ++k) {
      const Lanes left = four_at(row + k * kLanes) - entry * along[k];
      std::memcpy(row + k * kLanes, &left, sizeof left);
    }
  };
  subtract(1, head);
  for (int i = j + 1; i < rows; ++i)
    if (v[i * stride] != 0) subtract(v[i * stride], a + i * stride + first);
}

// Reduces the first n columns of a matrix to upper triangular form, A = Q R, with the reflections
// applied to the columns behind them as well; the stride of its rows is that of row_stride.
// Reflection j is I − beta[j] v vᵀ with v = (1, the entries of column j below the diagonal).
inline void reflect(double* a, int rows, int n, int stride, double* beta) {
  for (int j = 0; j < n; ++j) {
    double& head = a[j * (stride + 1)];
    double below = 0;
    for (int i = j + 1; i < rows; ++i) below += a[i * stride + j] * a[i * stride + j];
    beta[j] = 0;
    if (below == 0) continue;
    const double length = std::copysign(std::sqrt(head * head + below), head);
    const double first = head + length, inverse = 1 / first;
    beta[j] = first / length;
    head = -length;
    for (int i = j + 1; i < rows; ++i) a[i * stride + j] *= inverse;
    for (int c = j / kLanes * kLanes; c < stride; c += 2 * kLanes)
      if (c + kLanes < stride)
        reflect_columns<2>(a, rows, stride, j, beta[j], c);
      else
        reflect_columns<1>(a, rows, stride, j, beta[j], c);
  }
}

// x ← R⁻ᵀ x for the upper triangle R of a matrix.
inline void solve_transposed(const double* R, int n, int stride, double* x) {
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < i; ++k) x[i] -= R[k * stride + i] * x[k];
    x[i] /= R[i * (stride + 1)];
  }
}
// The same for several right-hand sides, which stand beside each other in rows of `width`, whole
// vectors.
inline void solve_transposed(const double* R, int n, int stride, double* x, int width) {
  for (int i = 0; i < n; ++i) {
    const double inverse = 1 / R[i * (stride + 1)];
    for (int c = 0; c < width; c += kLanes) {
      Lanes left = four_at(x + i * width + c);
      for (int k = 0; k < i; ++k) left -= R[k * stride + i] * four_at(x + k * width + c);
      left *= inverse;
      std::memcpy(x + i * width + c, &left, sizeof left);
    }
  }
}

// x ← R⁻¹ x
inline void solve_upper(const double* R, int n, int stride, double* x) {
  for (int i = n - 1; i >= 0; --i)
    x[i] = (x[i] - dot(R + i * (stride + 1) + 1, x + i + 1, n - 1 - i)) / R[i * (stride + 1)];
}

// Adds a row's share of a barrier's Hessian: lower triangle of H += second·a aᵀ.
inline void add_outer(const double* a, int n, double second, double* H) {
  for (int i = 0; i < n; ++i) {
    const double scaled = second * a[i];
    if (scaled == 0) continue;
    for (int j = 0; j <= i; ++j) H[i * n + j] += scaled * a[j];
  }
}

}  // namespace graspforce
