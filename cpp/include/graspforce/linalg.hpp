// Dense factorisations for the small systems of the method, row-major: Cholesky, and Householder's
// reflections where its squared condition costs too many digits.
#pragma once

#include <algorithm>
#include <cmath>

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

// Reduces the first n columns of a rows × columns matrix to upper triangular form, A = Q R, with
// the reflections applied to the columns behind them as well. Reflection j is I − beta[j] v vᵀ with
// v = (1, the entries of column j below the diagonal); `row` is room for one row.
inline void reflect(double* a, int rows, int n, int columns, double* beta, double* row) {
  for (int j = 0; j < n; ++j) {
    double* head = a + j * columns;
    double below = 0;
    for (int i = j + 1; i < rows; ++i) below += a[i * columns + j] * a[i * columns + j];
    beta[j] = 0;
    if (below == 0) continue;
    const double length = std::copysign(std::sqrt(head[j] * head[j] + below), head[j]);
    const double first = head[j] + length, inverse = 1 / first;
    beta[j] = first / length;
    head[j] = -length;
    std::copy(head + j + 1, head + columns, row + j + 1);
    for (int i = j + 1; i < rows; ++i) {
      double* other = a + i * columns;
      if (other[j] == 0) continue;  // many are: a contact's cone is independent of the others
      other[j] *= inverse;
      for (int c = j + 1; c < columns; ++c) row[c] += other[j] * other[c];
    }
    for (int c = j + 1; c < columns; ++c) head[c] -= beta[j] * row[c];
    for (int i = j + 1; i < rows; ++i) {
      double* other = a + i * columns;
      if (other[j] != 0)
        add_scaled(-beta[j] * other[j], row + j + 1, columns - j - 1, other + j + 1);
    }
  }
}

// x ← R⁻ᵀ x for the upper triangle R of a matrix with `stride` columns, for several right-hand
// sides that stand beside each other in rows of `width`.
inline void solve_transposed(const double* R, int n, int stride, double* x, int columns = 1,
                             int width = 1) {
  for (int i = 0; i < n; ++i) {
    double* target = x + i * width;
    for (int k = 0; k < i; ++k) add_scaled(-R[k * stride + i], x + k * width, columns, target);
    const double inverse = 1 / R[i * (stride + 1)];
    for (int c = 0; c < columns; ++c) target[c] *= inverse;
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
