// Callers with another floating-point environment: traps on, another rounding mode, denormals
// flushed to zero. They get the bits that everybody gets, and their environment back.
#include <cfenv>
#include <cstring>

#include "expect.hpp"
#include "graspforce/engine.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

#if defined(__SSE2__)
static unsigned settings() { return _mm_getcsr() & ~0x3fu; }
static void trap() { _mm_setcsr(0x1f80 & ~(0x80 | 0x200 | 0x400)); }  // invalid, /0, overflow
static void flush_denormals() { _mm_setcsr(0x1f80 | 0x8040); }
static void reset() { _mm_setcsr(0x1f80); }
#else
static int settings() { return std::fegetround(); }
static void trap() {}  // not every processor has traps
static void flush_denormals() {}
static void reset() { std::fesetround(FE_TONEAREST); }
#endif
static void round_upwards() { std::fesetround(FE_UPWARD); }

// Forces of a cold solve and of two ticks, with `enter` called before each.
static std::vector<double> forces(const RandomGrasp& grasp, void (*enter)()) {
  std::vector<double> all;
  Engine engine(grasp.layout);
  for (int call = 0; call < 3; ++call) {
    enter();
    const auto before = settings();
    const Result& result = call == 0 ? engine.solve(grasp.data.packed(), Settings{})
                                     : engine.tick(grasp.data.packed(), Settings{});
    EXPECT(settings() == before);
    reset();
    all.push_back(static_cast<double>(result.status));
    all.insert(all.end(), engine.forces(), engine.forces() + grasp.layout.components());
  }
  return all;
}

int main() {
  Random random(11);
  bool seen[7] = {};
  for (int trial = 0; trial < 200; ++trial) {
    RandomGrasp grasp(random, random_layout(random));
    grasp.wish(random, trial % 2 == 0 ? 0.2 : 20);
    const std::vector<double> plain = forces(grasp, reset);
    seen[static_cast<int>(plain[0])] = true;
    for (auto enter : {trap, round_upwards, flush_denormals}) {
      const std::vector<double> same = forces(grasp, enter);
      EXPECT(std::memcmp(plain.data(), same.data(), plain.size() * sizeof(double)) == 0);
    }
  }
  EXPECT(seen[static_cast<int>(Status::Solved)] && seen[static_cast<int>(Status::Infeasible)]);
  return verdict("floating-point");
}
