// H = L D Lᵀ of several small matrices at a time, one a lane: lower triangles, row by row.
#pragma once

#include "graspforce/lanes.hpp"

namespace graspforce::lane_ldl {

// Where entry (i, j) of a lower triangle stands.
constexpr int at(int i, int j) { return i * (i + 1) / 2 + j; }

// Puts the unit factor L below the diagonal of H, and the inverses of D beside it. Two columns at a
// time, so that their divisions do not wait for each other: with pivot p and q below it,
// t = p v − q u is p times what eliminating column u leaves of v, and the second pivot is det / p.
// Rounding is that of one column after the other. A pivot lost to rounding is replaced by a tiny
// positive one.
template <int Q, class V>
GRASPFORCE_INLINE void factor(V* H, V* inverse) {
  V tiny[Q];
  GRASPFORCE_UNROLL
  for (int i = 0; i < Q; ++i) tiny[i] = 1e-15 * H[at(i, i)];
  GRASPFORCE_UNROLL
  for (int j = 0; j < Q; j += 2) {
    const V p = max(H[at(j, j)], tiny[j]);
    inverse[j] = 1 / p;
    if (j + 1 == Q) break;
    const V q = H[at(j + 1, j)], det = p * H[at(j + 1, j + 1)] - q * q;
    const V inverse_det = 1 / max(det, tiny[j + 1] * p);
    inverse[j + 1] = p * inverse_det;
    H[at(j + 1, j)] = q * inverse[j];
    V u[Q], t[Q];
    GRASPFORCE_UNROLL
    for (int i = j + 2; i < Q; ++i) {
      u[i] = H[at(i, j)];
      t[i] = p * H[at(i, j + 1)] - q * u[i];
      H[at(i, j)] = inverse[j] * u[i];
      H[at(i, j + 1)] = inverse_det * t[i];
      GRASPFORCE_UNROLL
      for (int k = j + 2; k <= i; ++k)
        H[at(i, k)] = (H[at(i, k)] - H[at(i, j)] * u[k]) - inverse_det * (inverse[j] * t[i] * t[k]);
    }
  }
}

// x ← L⁻¹ x.
template <int Q, class V>
GRASPFORCE_INLINE void forward(const V* L, V* x) {
  GRASPFORCE_UNROLL
  for (int i = 1; i < Q; ++i) {
    GRASPFORCE_UNROLL
    for (int k = 0; k < i; ++k) x[i] -= L[at(i, k)] * x[k];
  }
}

// x ← L⁻ᵀ x.
template <int Q, class V>
GRASPFORCE_INLINE void back(const V* L, V* x) {
  GRASPFORCE_UNROLL
  for (int i = Q - 2; i >= 0; --i) {
    GRASPFORCE_UNROLL
    for (int k = i + 1; k < Q; ++k) x[i] -= L[at(k, i)] * x[k];
  }
}

// x ← H⁻¹ x.
template <int Q, class V>
GRASPFORCE_INLINE void solve(const V* L, const V* inverse, V* x) {
  forward<Q>(L, x);
  GRASPFORCE_UNROLL
  for (int i = 0; i < Q; ++i) x[i] *= inverse[i];
  back<Q>(L, x);
}

}  // namespace graspforce::lane_ldl
