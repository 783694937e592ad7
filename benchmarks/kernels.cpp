// What a Newton step costs by each of the kernels that fit a grasp, and what a servo tick costs by
// the number of contacts. benchmarks/kernels.py builds it, runs it and makes the tables.
//
//     kernels step KERNEL CONTACTS COMPONENTS COUNT    KERNEL: general, lanes3, lanes4,
//                                                      lanes3-single, lanes4-single
//     kernels servo CONTACTS COUNT                     ticks of a Servo
//     kernels engine CONTACTS COUNT                    ticks of an Engine, with kJacobianKept
//     kernels read CONTACTS COUNT                      readings of J, to see its pattern kept
//
// does COUNT of them and prints the median time of one [ns].
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "graspforce/servo.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

// Median time of one call, by batches that are long beside the clock's own time.
template <class Call>
static double time(int count, Call call) {
  using Clock = std::chrono::steady_clock;
  constexpr int kBatch = 10;
  std::vector<double> times;
  for (int done = 0; done < count; done += kBatch) {
    const Clock::time_point start = Clock::now();
    for (int i = 0; i < kBatch; ++i) call();
    times.push_back(std::chrono::duration<double, std::nano>(Clock::now() - start).count());
  }
  std::nth_element(times.begin(), times.begin() + times.size() / 2, times.end());
  return times[times.size() / 2] / kBatch;
}

static Layout fingers(int contacts, Model model) {
  Layout layout;
  layout.models.assign(contacts, model);
  layout.joints = 3 * contacts;
  return layout;
}

// What a tick does that takes one step: new W, f and J, the step, its certificate, the forces.
template <class Rows, class AnyBarrier>
static double time_steps(Rows& rows, AnyBarrier& barrier, const Problem& problem,
                         const std::vector<double>& c, int count) {
  rows.load(problem, kChangedAll);
  std::vector<double> forces(c);
  return time(count, [&] {
    rows.load(problem, kChangedMap | kChangedJacobian);
    barrier.set_forces(c.data());
    if (!barrier.evaluate() || !(barrier.newton() < 1)) std::abort();
    barrier.advance(1);
    if (!barrier.balanced() || !barrier.inside()) std::abort();
    barrier.get_forces(forces.data());
  });
}

template <int Q, Grasps grasps>
static double time_lanes(const Layout& layout, const Structure& structure, const Problem& problem,
                         const std::vector<double>& c, int count) {
  if (!LaneBarrier<Q, grasps>::fits(layout, structure)) std::abort();
  LaneBarrier<Q, grasps> barrier(layout);
  barrier.allot(structure);
  return time_steps(barrier, barrier, problem, c, count);
}

static double steps(const std::string& kernel, int contacts, Model model, int count) {
  Random random(contacts);
  const Layout layout = fingers(contacts, model);
  const RandomGrasp grasp(random, layout);
  const Problem problem(layout, grasp.data.packed());
  Engine engine(layout);
  if (engine.solve(grasp.data.packed(), {}).status != Status::Solved) std::abort();
  const std::vector<double> c(engine.forces(), engine.forces() + layout.components());
  Structure structure(layout);
  structure.find(problem);
  if (kernel == "lanes3") return time_lanes<3, Grasps::Any>(layout, structure, problem, c, count);
  if (kernel == "lanes4") return time_lanes<4, Grasps::Any>(layout, structure, problem, c, count);
  if (kernel == "lanes3-small")
    return time_lanes<3, Grasps::Small>(layout, structure, problem, c, count);
  if (kernel == "lanes4-small")
    return time_lanes<4, Grasps::Small>(layout, structure, problem, c, count);
  if (kernel == "lanes3-plain")
    return time_lanes<3, Grasps::Plain>(layout, structure, problem, c, count);
  if (kernel == "lanes4-plain")
    return time_lanes<4, Grasps::Plain>(layout, structure, problem, c, count);
  Blocks blocks(layout);
  blocks.allot(structure);
  Barrier barrier(blocks);
  barrier.allot();
  barrier.set_weights(*problem.alpha);
  return time_steps(blocks, barrier, problem, c, count);
}

// Ticks of one step, whose W, f and J swing a little: of a servo from its fields, which are written
// between the ticks, or of an engine that is told that J keeps its pattern.
static double ticks(bool of_servo, int contacts, int count) {
  constexpr int kSwing = 40;
  Random random(contacts);
  const Layout layout = fingers(contacts, Model::PCWF);
  const RandomGrasp grasp(random, layout);
  Servo servo(layout);
  servo = grasp.data;
  Engine engine(layout);
  if (servo.tick() != Status::Solved) std::abort();
  engine.tick(servo.packed(), {});
  using Clock = std::chrono::steady_clock;
  std::vector<double> times;
  for (int tick = -kSwing; tick < count; ++tick) {
    const double swing = 1 + 1e-3 * std::sin(2 * 3.14159265358979 * tick / kSwing);
    for (int r = 0; r < layout.wrench_rows; ++r) servo.f[r] = grasp.data.f[r] * swing;
    for (int i = 0; i < layout.components(); ++i)
      for (int j = i / 3 * 3; j < i / 3 * 3 + 3; ++j) servo.J(i, j) = grasp.data.J(i, j) * swing;
    const Clock::time_point start = Clock::now();
    const Status status =
        of_servo ? servo.tick()
                 : engine.tick(servo.packed(), {}, kChangedMap | kChangedJacobian | kJacobianKept)
                       .status;
    const Clock::time_point end = Clock::now();
    if (status != Status::Solved) std::abort();
    if (tick >= 0) times.push_back(std::chrono::duration<double, std::nano>(end - start).count());
  }
  std::nth_element(times.begin(), times.begin() + count / 2, times.end());
  return times[count / 2] - time(1000, [] { return Clock::now(); });
}

// Reads J to see that it has nothing outside its pattern.
static double reads(int contacts, int count) {
  Random random(contacts);
  const Layout layout = fingers(contacts, Model::PCWF);
  const RandomGrasp grasp(random, layout);
  const Problem problem(layout, grasp.data.packed());
  Structure structure(layout);
  structure.find(problem);
  return time(count, [&] {
    if (!structure.holds(problem, kChangedJacobian)) std::abort();
  });
}

int main(int count, char** arguments) {
  const std::string what = count > 1 ? arguments[1] : "";
  if (what == "step" && count == 6)
    std::printf("%.1f\n", steps(arguments[2], std::atoi(arguments[3]),
                                Model(std::atoi(arguments[4])), std::atoi(arguments[5])));
  else if ((what == "servo" || what == "engine") && count == 4)
    std::printf("%.1f\n", ticks(what == "servo", std::atoi(arguments[2]), std::atoi(arguments[3])));
  else if (what == "read" && count == 4)
    std::printf("%.1f\n", reads(std::atoi(arguments[2]), std::atoi(arguments[3])));
  else
    return 2;
}
