// Work on the rows of a batch by several threads, chunk after chunk, until someone says stop.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

#include "graspforce/floating_point.hpp"

namespace graspforce {

inline constexpr std::ptrdiff_t kRowsAtOnce = 256;  // that a thread takes at a time

inline int threads_for(std::ptrdiff_t rows, int threads) {
  const std::ptrdiff_t chunks = (rows + kRowsAtOnce - 1) / kRowsAtOnce;
  return std::max(1, int(std::min<std::ptrdiff_t>(threads, chunks)));
}

// Calls work(begin, end, go_on) for chunks of `rows` rows, on the calling thread and further ones,
// each with the work that make(thread) returns, and with go_on for work to call between rows: where
// it is false the work should end. `poll` is asked on the calling thread alone; where it returns
// false all stop, and so does this, with false.
template <class Make, class Poll>
bool each_chunk(std::ptrdiff_t rows, int threads, Make make, Poll poll) {
  std::atomic<std::ptrdiff_t> next{0};
  std::atomic<bool> stop{false};
  auto run = [&](int thread, auto go_on) {
    const DefaultFloatingPoint environment;
    auto work = make(thread);
    while (go_on()) {
      const std::ptrdiff_t begin = next.fetch_add(kRowsAtOnce);
      if (begin >= rows) return;
      work(begin, std::min(begin + kRowsAtOnce, rows), go_on);
    }
  };
  std::vector<std::thread> pool;
  for (int i = 1; i < threads_for(rows, threads); ++i)
    pool.emplace_back([&run, &stop, i] { run(i, [&stop] { return !stop; }); });
  run(0, [&] {
    if (!stop && !poll()) stop = true;
    return !stop;
  });
  for (std::thread& thread : pool) thread.join();
  return !stop;
}

}  // namespace graspforce
