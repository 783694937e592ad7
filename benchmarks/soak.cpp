// Servos under everything that may happen to them, for millions of ticks: wandering and jumping
// wrenches, loads far out of reach, fingers that leave and come back, joints that come to be shared
// or lost, a W that loses its rank, tight budgets, refused numbers.
//
//     soak TICKS [SEED]
//
// No tick may allocate, every force has to be a number, every verdict has to stand before the
// judge, a cold solve of the same problem has to agree, and memory may not grow.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <vector>

#include "allocations.hpp"
#include "graspforce/servo.hpp"
#include "judge.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

static double resident_megabytes() {
  long pages = 0, resident = 0;
  if (std::FILE* file = std::fopen("/proc/self/statm", "r")) {
    if (std::fscanf(file, "%ld %ld", &pages, &resident) != 2) resident = 0;
    std::fclose(file);
  }
  return resident * double(sysconf(_SC_PAGESIZE)) / 1e6;
}

struct Tally {
  long ticks = 0, verdicts[8] = {}, refused = 0, steps = 0, longest = 0;
  long allocations = 0, faults = 0, compared = 0, disagreements = 0;
  double worst_drift = 0;
};

// One grasp and its servo, which live through it all.
class Stream {
 public:
  explicit Stream(unsigned seed)
      : random_(seed),
        grasp_(random_, random_layout(random_)),
        servo_(grasp_.layout),
        cold_(grasp_.layout),
        good_(grasp_.layout),
        last_(grasp_.layout.components()) {}

  void tick(Tally& tally) {
    ++tally.ticks;
    if (random_.chance(0.01)) return refuse(tally);
    move();
    servo_ = grasp_.data;
    servo_.settings.max_steps = random_.chance(0.02) ? 1 + random_.below(5) : 200;
    servo_.settings.budget_us = random_.chance(0.01) ? random_.uniform(0.1, 3) : kInfinity;
    if (random_.chance(1e-3)) servo_.reset();
    const long before = allocations;
    const Status status = servo_.tick();
    tally.allocations += allocations - before;
    ++tally.verdicts[static_cast<int>(status)];
    tally.steps += servo_.result().newton_steps;
    tally.longest = std::max(tally.longest, long(servo_.result().newton_steps));
    const char* fault = Judge(grasp_.layout, servo_.snapshot()->data())
                            .find_fault(servo_.engine(), servo_.result());
    std::copy(servo_.c_last.begin(), servo_.c_last.end(), grasp_.data.c_last.begin());
    if (fault == nullptr && servo_.refusal()) fault = "good numbers, refused";
    if (fault != nullptr) {
      ++tally.faults;
      std::printf("tick %ld: %s\n", tally.ticks, fault);
    }
    if (random_.chance(0.01)) compare(tally);
  }

 private:
  // What changes from one tick to the next.
  void move() {
    ProblemData& data = grasp_.data;
    const int n = grasp_.layout.contacts();
    for (double& entry : data.W.entries()) entry *= 1 + 1e-4 * random_.normal();
    for (double& entry : data.J.entries()) entry *= 1 + 1e-4 * random_.normal();
    grasp_.wander(random_, 3e-3);
    if (overloaded_ && random_.chance(0.3)) {
      overloaded_ = false;
      grasp_.wish(random_, 0.2);
    }
    if (random_.chance(0.01)) grasp_.wish(random_, random_.uniform(0.05, 0.5));
    if (random_.chance(0.003)) {
      overloaded_ = true;
      grasp_.wish(random_, random_.uniform(5, 100));
    }
    if (grasp_.layout.ceilings) ramp();
    if (random_.chance(0.001)) grasp_.couple(random_);
    if (random_.chance(0.001)) grasp_.lose_joint(random_);
    if (random_.chance(0.001)) grasp_.flatten();
    if (random_.chance(0.002)) {  // a new day
      grasp_.uncouple(random_);
      for (int i = 0; i < n; ++i) grasp_.place(random_, i);
      data.alpha = std::pow(10.0, random_.uniform(-2, 3));
      grasp_.wish(random_, 0.2);
    }
    if (random_.chance(0.002)) data.f[random_.below(6)] += 0.1;
  }

  // A finger lets go over fifty ticks, is away for a while and comes back.
  void ramp() {
    ProblemData& data = grasp_.data;
    if (ramp_ == 0) {
      if (random_.chance(0.01)) ramp_ = 150, finger_ = random_.below(grasp_.layout.contacts());
      return;
    }
    --ramp_;
    const double down = (ramp_ - 100) / 50.0, up = (50 - ramp_) / 50.0;
    data.engagement[finger_] = std::min(1.0, std::max({down, up, 0.0}));
    if (ramp_ == 49) grasp_.wish(random_, 0.1);  // it counts again: without, its share would be 0
    if (random_.chance(0.01)) {                  // or all at once
      data.engagement[finger_] = 1;
      ramp_ = 0;
    }
  }

  void refuse(Tally& tally) {
    const double wrong[] = {std::numeric_limits<double>::quiet_NaN(), kInfinity, -kInfinity};
    std::copy(servo_.c().begin(), servo_.c().end(), last_.begin());
    good_ = servo_;
    servo_.packed()[random_.below(int(servo_.packed_size()))] = wrong[random_.below(3)];
    const long before = allocations;
    const Status status = servo_.tick();
    tally.allocations += allocations - before;
    ++tally.refused;
    if (status != Status::InvalidNumbers || !servo_.refusal() ||
        !std::equal(last_.begin(), last_.end(), servo_.c().begin())) {
      ++tally.faults;
      std::printf("tick %ld: a refusal that leaves a trace\n", tally.ticks);
    }
    servo_ = good_;
  }

  // The same problem from nothing.
  void compare(Tally& tally) {
    const Status warm = servo_.result().status;
    const Result& cold = cold_.solve(servo_.snapshot()->data(), Settings{});
    ++tally.compared;
    if (warm == Status::Solved && cold.status == Status::Solved) {
      double apart = 0, size = 0;
      for (int i = 0; i < servo_.c().size(); ++i) {
        apart = std::max(apart, std::abs(servo_.c()[i] - cold_.forces()[i]));
        size = std::max(size, std::abs(cold_.forces()[i]));
      }
      if (size > 0) tally.worst_drift = std::max(tally.worst_drift, apart / size);
    } else if (warm != cold.status && warm != Status::MaxSteps) {
      ++tally.disagreements;
      std::printf("tick %ld: %s, and %s from nothing\n", tally.ticks, to_string(warm),
                  to_string(cold.status));
    }
  }

  Random random_;
  RandomGrasp grasp_;
  Servo servo_;
  Engine cold_;
  ProblemData good_;
  std::vector<double> last_;
  bool overloaded_ = false;
  int ramp_ = 0, finger_ = 0;
};

int main(int count, char** arguments) {
  const long ticks = count > 1 ? std::atol(arguments[1]) : 100000;
  const unsigned seed = count > 2 ? unsigned(std::atoi(arguments[2])) : 1;
  constexpr int kStreams = 20;
  std::vector<std::unique_ptr<Stream>> streams;
  for (unsigned s = 0; s < kStreams; ++s)
    streams.push_back(std::make_unique<Stream>(1000 * seed + s));
  Tally tally;
  double settled = 0;
  const auto start = std::chrono::steady_clock::now();
  for (long tick = 0; tick < ticks; ++tick) {
    streams[tick % kStreams]->tick(tally);
    if (tick == ticks / 10) settled = resident_megabytes();
  }
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
  const double grown = resident_megabytes() - settled;

  std::printf("%ld ticks of %d grasps in %.0f s, seed %u\n", ticks, kStreams, seconds.count(),
              seed);
  for (int status = 0; status < 8; ++status)
    std::printf("%-19s %10ld\n", to_string(Status(status)), tally.verdicts[status]);
  std::printf("refused             %10ld\n", tally.refused);
  std::printf("steps a tick        %10.2f on average, %ld at most\n",
              double(tally.steps) / double(ticks - tally.refused), tally.longest);
  std::printf("allocations         %10ld\n", tally.allocations);
  std::printf("faults              %10ld\n", tally.faults);
  std::printf("compared with cold  %10ld, %ld other verdicts, forces %.1e apart at most\n",
              tally.compared, tally.disagreements, tally.worst_drift);
  std::printf("resident memory     %10.1f MB, %+.1f MB since a tenth of the way\n", settled + grown,
              grown);
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  const bool flat = true;  // a sanitizer keeps what has been freed
#else
  const bool flat = grown < 1;
#endif
  const bool good = flat && tally.allocations == 0 && tally.faults == 0 &&
                    tally.disagreements == 0 && tally.worst_drift < 1e-3;
  return good ? 0 : 1;
}
