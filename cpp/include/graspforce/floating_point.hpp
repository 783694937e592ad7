// The floating-point environment of the core, independent of the caller's.
//
// Infinite slacks and decrements are part of the method, and so are divisions that make them: a
// caller who has floating-point traps on would be killed by SIGFPE. Another rounding mode, or
// denormals that are flushed to zero, would void the allowances for rounding in the proofs.
#pragma once

#if defined(__SSE2__)
#include <xmmintrin.h>
#else
#include <cfenv>
#endif

namespace graspforce {

// Sets traps off, rounding to nearest and denormals as they are for its life, and puts the
// caller's settings back at its end. Reading the register costs about a nanosecond; it is written
// only where it differs.
class DefaultFloatingPoint {
 public:
  DefaultFloatingPoint(const DefaultFloatingPoint&) = delete;
  DefaultFloatingPoint& operator=(const DefaultFloatingPoint&) = delete;

#if defined(__SSE2__)
  DefaultFloatingPoint() : callers_(_mm_getcsr()) {
    if ((callers_ & ~kFlags) != kDefault) _mm_setcsr(kDefault);
  }
  ~DefaultFloatingPoint() {
    if ((callers_ & ~kFlags) != kDefault) _mm_setcsr(callers_);
  }

 private:
  static constexpr unsigned kFlags = 0x3f;      // what has happened, not a setting
  static constexpr unsigned kDefault = 0x1f80;  // of a new process
  unsigned callers_;
#else
  DefaultFloatingPoint() {
    std::feholdexcept(&callers_);
    std::fesetround(FE_TONEAREST);
  }
  ~DefaultFloatingPoint() { std::fesetenv(&callers_); }

 private:
  std::fenv_t callers_;
#endif
};

}  // namespace graspforce
