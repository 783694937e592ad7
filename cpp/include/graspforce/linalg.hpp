// Dense Cholesky for the small symmetric systems of the method. Row-major, lower triangle.
#pragma once

#include <cmath>

namespace graspforce {

// Factors the lower triangle of the n×n matrix `a` in place, a = L Lᵀ, and returns the smallest
// pivot relative to its diagonal entry before elimination: how far the matrix is from singular,
// whatever the scaling of its rows. A pivot lost to rounding is replaced by a tiny positive one.
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

// Adds a row's share of a barrier's Hessian: lower triangle of H += second·a aᵀ.
inline void add_outer(const double* a, int n, double second, double* H) {
  for (int i = 0; i < n; ++i) {
    const double scaled = second * a[i];
    if (scaled == 0) continue;
    for (int j = 0; j <= i; ++j) H[i * n + j] += scaled * a[j];
  }
}

inline void add_scaled(double factor, const double* a, int n, double* sum) {
  for (int i = 0; i < n; ++i) sum[i] += factor * a[i];
}

inline double dot(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

}  // namespace graspforce
