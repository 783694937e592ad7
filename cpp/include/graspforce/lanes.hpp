// Doubles side by side: the vector types of the fast kernels, in GCC's and Clang's portable vector
// extension. The compiler makes AVX, SSE2 or NEON of it, whatever it is built for. For compilers
// without it, such as MSVC, and with GRASPFORCE_PLAIN_LANES, plain structs take their place; no
// other file needs to know.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

#if !defined(GRASPFORCE_PLAIN_LANES) && !defined(__GNUC__) && !defined(__clang__)
#define GRASPFORCE_PLAIN_LANES
#endif

#if defined(GRASPFORCE_PLAIN_LANES)
#include "graspforce/plain_lanes.hpp"
#elif defined(__AVX__)
#include <immintrin.h>
#endif

// The kernels' loops have small constant bounds; unrolled, their arrays become registers.
#if defined(__clang__)
#define GRASPFORCE_UNROLL _Pragma("unroll")
#elif defined(__GNUC__)
#define GRASPFORCE_UNROLL _Pragma("GCC unroll 8")
#else
#define GRASPFORCE_UNROLL
#endif

// The kernels of a tick become one piece of code, so that what they hand on stays in registers;
// code that most ticks do not run stands apart.
#if defined(__GNUC__) || defined(__clang__)
#define GRASPFORCE_INLINE __attribute__((always_inline)) inline
#define GRASPFORCE_APART __attribute__((noinline))
#else
#define GRASPFORCE_INLINE __forceinline
#define GRASPFORCE_APART __declspec(noinline)
#endif

namespace graspforce {

inline constexpr int kLanes = 4;
#if defined(GRASPFORCE_PLAIN_LANES)
using Lanes = PlainLanes<double, kLanes>;
using WideLanes = PlainLanes<double, 2 * kLanes>;
using BitLanes = PlainLanes<std::uint64_t, kLanes>;
#else
typedef double Lanes __attribute__((vector_size(kLanes * sizeof(double))));
// Eight of them, for problems side by side where a register holds as many.
typedef double WideLanes __attribute__((vector_size(2 * kLanes * sizeof(double))));
// The bits of four doubles.
typedef std::uint64_t BitLanes __attribute__((vector_size(kLanes * sizeof(std::uint64_t))));
#endif

template <class V = Lanes>
inline constexpr int kLanesOf = int(sizeof(V) / sizeof(double));

// What comparing vectors gives: in each lane all bits set, or none.
template <class V>
using MaskOf = decltype(V{} < V{});

// Lane by lane a where the mask is set, else b; both are computed.
template <class V>
GRASPFORCE_INLINE V select(MaskOf<V> mask, V a, V b) {
#if defined(GRASPFORCE_PLAIN_LANES)
  for (int i = 0; i < kLanesOf<V>; ++i) a[i] = mask[i] ? a[i] : b[i];
  return a;
#else
  return mask ? a : b;
#endif
}

template <class V = Lanes>
GRASPFORCE_INLINE V splat(double x) {
  return x - V{};
}
template <class V>
GRASPFORCE_INLINE V min(V a, V b) {
  return select(a < b, a, b);
}
template <class V>
GRASPFORCE_INLINE V max(V a, V b) {
  return select(a > b, a, b);
}
template <class V>
GRASPFORCE_INLINE V abs(V a) {
#if defined(GRASPFORCE_PLAIN_LANES)
  for (int i = 0; i < kLanesOf<V>; ++i) a[i] = std::abs(a[i]);
  return a;
#else
  constexpr long long kMagnitude = 0x7fffffffffffffff;  // all bits but the sign
  return (V)((MaskOf<V>)a & kMagnitude);
#endif
}
template <class V>
GRASPFORCE_INLINE V sqrt(V a) {
  for (int i = 0; i < kLanesOf<V>; ++i) a[i] = std::sqrt(a[i]);
  return a;
}

// A bit for each lane of a mask, the first the lowest. Written out, the loop costs the compiler's
// code an extraction a lane.
template <class Mask>
GRASPFORCE_INLINE unsigned bits_of(Mask mask) {
#if defined(__AVX512DQ__) && !defined(GRASPFORCE_PLAIN_LANES)
  if constexpr (sizeof(Mask) == 64) return _mm512_movepi64_mask((__m512i)mask);
#endif
#if defined(__AVX__) && !defined(GRASPFORCE_PLAIN_LANES)
  if constexpr (sizeof(Mask) == 32) return unsigned(_mm256_movemask_pd((__m256d)mask));
#endif
  unsigned bits = 0;
  for (std::size_t i = 0; i < sizeof mask / sizeof mask[0]; ++i) bits |= unsigned(mask[i] & 1) << i;
  return bits;
}

// The place of the lowest bit that is set; there is one.
inline int lowest(unsigned bits) {
#if defined(__GNUC__) || defined(__clang__)
  return __builtin_ctz(bits);
#else
  int place = 0;
  while ((bits >> place & 1u) == 0) ++place;
  return place;
#endif
}

// The mask of some lanes.
template <class V>
GRASPFORCE_INLINE MaskOf<V> mask_of(unsigned bits) {
  MaskOf<V> own = {};
  GRASPFORCE_UNROLL
  for (int i = 0; i < kLanesOf<V>; ++i) own[i] = 1LL << i;
  return (own & static_cast<long long>(bits)) != 0;
}

// Whether a number is positive in every lane: false where one is not a number.
inline bool all_positive(Lanes a) {
  const auto yes = a > 0;
  return ((yes[0] & yes[1]) & (yes[2] & yes[3])) != 0;
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

// Four of the eight doubles of a and b, by their places: 0…3 in a, 4…7 in b.
template <int i, int j, int k, int l>
inline Lanes shuffle(Lanes a, Lanes b) {
#if defined(GRASPFORCE_PLAIN_LANES)
  const double both[] = {a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]};
  return Lanes{both[i], both[j], both[k], both[l]};
#elif defined(__clang__)
  return __builtin_shufflevector(a, b, i, j, k, l);
#else
  typedef long long Index __attribute__((vector_size(kLanes * sizeof(long long))));
  return __builtin_shuffle(a, b, Index{i, j, k, l});
#endif
}

// One of the four in every lane; quicker than by way of a scalar where i is known to the compiler.
GRASPFORCE_INLINE Lanes broadcast(Lanes a, int i) {
  switch (i) {
    case 0:
      return shuffle<0, 0, 0, 0>(a, a);
    case 1:
      return shuffle<1, 1, 1, 1>(a, a);
    case 2:
      return shuffle<2, 2, 2, 2>(a, a);
    default:
      return shuffle<3, 3, 3, 3>(a, a);
  }
}

// Sums over the lanes of four vectors at once: one transposition instead of four reductions.
inline Lanes sums(Lanes a, Lanes b, Lanes c, Lanes d) {
  const Lanes ab = shuffle<0, 4, 2, 6>(a, b) + shuffle<1, 5, 3, 7>(a, b);
  const Lanes cd = shuffle<0, 4, 2, 6>(c, d) + shuffle<1, 5, 3, 7>(c, d);
  return shuffle<0, 1, 4, 5>(ab, cd) + shuffle<2, 3, 6, 7>(ab, cd);
}

inline Lanes four_at(const double* from) {
  Lanes four;
  std::memcpy(&four, from, sizeof four);
  return four;
}

// Of four contacts with Q numbers each, which stand side by side in Q vectors: one vector a number.
template <int Q>
GRASPFORCE_INLINE void to_components(Lanes* v) {
  static_assert(Q == 3 || Q == 4);
  if constexpr (Q == 3) {
    const Lanes a = shuffle<0, 1, 6, 7>(v[0], v[1]), b = shuffle<2, 3, 4, 5>(v[0], v[2]);
    const Lanes c = shuffle<0, 1, 6, 7>(v[1], v[2]);
    v[0] = shuffle<0, 5, 2, 7>(a, b);
    v[1] = shuffle<1, 4, 3, 6>(a, c);
    v[2] = shuffle<0, 5, 2, 7>(b, c);
  } else {
    const Lanes a = shuffle<0, 4, 2, 6>(v[0], v[1]), b = shuffle<1, 5, 3, 7>(v[0], v[1]);
    const Lanes c = shuffle<0, 4, 2, 6>(v[2], v[3]), d = shuffle<1, 5, 3, 7>(v[2], v[3]);
    v[0] = shuffle<0, 1, 4, 5>(a, c);
    v[1] = shuffle<0, 1, 4, 5>(b, d);
    v[2] = shuffle<2, 3, 6, 7>(a, c);
    v[3] = shuffle<2, 3, 6, 7>(b, d);
  }
}

// The reverse.
template <int Q>
GRASPFORCE_INLINE void to_contacts(Lanes* v) {
  if constexpr (Q == 3) {
    const Lanes a = shuffle<0, 4, 2, 6>(v[0], v[1]), b = shuffle<0, 5, 2, 7>(v[2], v[0]);
    const Lanes c = shuffle<1, 5, 3, 7>(v[1], v[2]);
    v[0] = shuffle<0, 1, 4, 5>(a, b);
    v[1] = shuffle<0, 1, 6, 7>(c, a);
    v[2] = shuffle<2, 3, 6, 7>(b, c);
  } else {
    to_components<Q>(v);  // a transposition
  }
}

}  // namespace graspforce
