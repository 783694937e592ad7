// Which of the compiled modules this processor runs.
#pragma once

#include <vector>

#if defined(GRASPFORCE_FURTHER_CORES)
#include <cpuid.h>
#endif

namespace graspforce {

// The instruction sets beyond the baseline that the core is also built for, as far as the processor
// has them and the system saves their registers; the best comes last. Asked of the processor
// itself:
// __builtin_cpu_supports makes Zig link its own memcpy and memcmp, byte by byte, for glibc's.
inline std::vector<const char*> instruction_sets() {
  std::vector<const char*> sets;
#if defined(GRASPFORCE_FURTHER_CORES)
  constexpr unsigned kYmm = 0x6, kZmm = 0xe6;  // registers in XCR0, with those that they contain
  unsigned a, b, c, d, saved, high;
  if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_FMA) || !(c & bit_OSXSAVE)) return sets;
  __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
  if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return sets;
  if (!(b & bit_AVX2) || (saved & kYmm) != kYmm) return sets;
  sets.push_back("avx2");
  constexpr unsigned kAll = bit_AVX512F | bit_AVX512VL | bit_AVX512DQ;
  if ((b & kAll) == kAll && (saved & kZmm) == kZmm) sets.push_back("avx512");
#endif
  return sets;
}

}  // namespace graspforce
