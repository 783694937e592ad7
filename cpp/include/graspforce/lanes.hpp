// Four doubles side by side: the vector type of the fast kernels, in GCC's and Clang's portable
// vector extension. The compiler makes AVX, SSE2 or NEON of it, whatever it is built for.
#pragma once

#include <cmath>
#include <cstddef>

// The kernels' loops have small constant bounds; unrolled, their arrays become registers.
#if defined(__clang__)
#define GRASPFORCE_UNROLL _Pragma("unroll")
#else
#define GRASPFORCE_UNROLL _Pragma("GCC unroll 8")
#endif

// The kernels of a tick become one piece of code, so that what they hand on stays in registers.
#define GRASPFORCE_INLINE __attribute__((always_inline)) inline

namespace graspforce {

inline constexpr int kLanes = 4;
typedef double Lanes __attribute__((vector_size(kLanes * sizeof(double))));

inline Lanes splat(double x) { return Lanes{x, x, x, x}; }
inline Lanes min(Lanes a, Lanes b) { return a < b ? a : b; }
inline Lanes max(Lanes a, Lanes b) { return a > b ? a : b; }
inline Lanes abs(Lanes a) { return a < 0 ? -a : a; }
inline Lanes sqrt(Lanes a) {
  for (int i = 0; i < kLanes; ++i) a[i] = std::sqrt(a[i]);
  return a;
}
inline double sum(Lanes a) { return (a[0] + a[1]) + (a[2] + a[3]); }
inline double least(Lanes a) {
  const double x = a[0] < a[1] ? a[0] : a[1], y = a[2] < a[3] ? a[2] : a[3];
  return x < y ? x : y;
}
inline double greatest(Lanes a) {
  const double x = a[0] > a[1] ? a[0] : a[1], y = a[2] > a[3] ? a[2] : a[3];
  return x > y ? x : y;
}

// Sums over the lanes of four vectors at once: one transposition instead of four reductions.
inline Lanes sums(Lanes a, Lanes b, Lanes c, Lanes d) {
#if defined(__clang__)
  const Lanes ab =
      __builtin_shufflevector(a, b, 0, 4, 2, 6) + __builtin_shufflevector(a, b, 1, 5, 3, 7);
  const Lanes cd =
      __builtin_shufflevector(c, d, 0, 4, 2, 6) + __builtin_shufflevector(c, d, 1, 5, 3, 7);
  return __builtin_shufflevector(ab, cd, 0, 1, 4, 5) + __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
#else
  typedef long long Index __attribute__((vector_size(kLanes * sizeof(long long))));
  const Lanes ab =
      __builtin_shuffle(a, b, Index{0, 4, 2, 6}) + __builtin_shuffle(a, b, Index{1, 5, 3, 7});
  const Lanes cd =
      __builtin_shuffle(c, d, Index{0, 4, 2, 6}) + __builtin_shuffle(c, d, Index{1, 5, 3, 7});
  return __builtin_shuffle(ab, cd, Index{0, 1, 4, 5}) +
         __builtin_shuffle(ab, cd, Index{2, 3, 6, 7});
#endif
}

}  // namespace graspforce
