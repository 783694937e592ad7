// A test that goes on after a failure and says at the end whether there was one.
#pragma once

#include <cstdio>

inline int failures = 0;

#define EXPECT(condition)                                         \
  do {                                                            \
    if (!(condition)) {                                           \
      std::printf("%s:%d: %s\n", __FILE__, __LINE__, #condition); \
      ++failures;                                                 \
    }                                                             \
  } while (false)

inline int verdict(const char* tests) {
  if (failures == 0) std::printf("all %s tests passed\n", tests);
  return failures == 0 ? 0 : 1;
}
