// Servos in threads answer as they do alone: they share nothing. Run under ThreadSanitizer in CI.
#include <thread>
#include <vector>

#include "expect.hpp"
#include "graspforce/servo.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

// Every force of a stream of good, changing and impossible ticks.
static std::vector<double> a_stream(unsigned seed) {
  Random random(seed);
  RandomGrasp grasp(random, random_layout(random));
  Servo servo(grasp.layout);
  std::vector<double> forces;
  for (int tick = 0; tick < 100; ++tick) {
    if (random.chance(0.1)) grasp.couple(random);
    if (random.chance(0.1)) grasp.uncouple(random);
    if (grasp.layout.ceilings && random.chance(0.1))
      grasp.data.engagement[0] = random.chance(0.5) ? 0 : 1;
    if (random.chance(0.3)) grasp.wish(random, random.chance(0.1) ? 100 : 0.2);
    grasp.data.f[2] *= 1.001;
    servo = grasp.data;
    servo.tick();
    forces.insert(forces.end(), servo.c().begin(), servo.c().end());
  }
  return forces;
}

int main() {
  constexpr int kThreads = 4, kStreams = 5;
  std::vector<std::vector<double>> together(kThreads * kStreams);
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t)
    threads.emplace_back([&together, t] {
      for (int s = t; s < kThreads * kStreams; s += kThreads) together[s] = a_stream(s);
    });
  for (std::thread& thread : threads) thread.join();
  for (int s = 0; s < kThreads * kStreams; ++s) EXPECT(together[s] == a_stream(s));
  return verdict("thread");
}
