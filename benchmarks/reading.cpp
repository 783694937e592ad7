// What a tick of a loop takes in C++ from MuJoCo's numbers to its controls: for reading.py.
//
//     reading model.mjb object rounds
//
// Prints the tenth of the times that is below, of reading, of the Servo and of the motors [µs].
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "graspforce/mujoco.hpp"
#include "graspforce/servo.hpp"

using namespace graspforce;
using Clock = std::chrono::steady_clock;

static double tenth(std::vector<double>& times) {
  std::nth_element(times.begin(), times.begin() + times.size() / 10, times.end());
  return times[times.size() / 10];
}

int main(int, char** arguments) {
  mjModel* const model = mj_loadModel(arguments[1], nullptr);
  mjData* const data = mj_makeData(model);
  mj_forward(model, data);
  MujocoGrasp grasp(model, data, arguments[2]);
  MujocoMotors motors(model, data, grasp.joints());
  Layout layout = grasp.layout();
  layout.ceilings = true;
  Servo servo(layout);
  for (double& ceiling : servo.c_max) ceiling = 20;
  std::vector<double> tau(layout.joints), parts[3];
  for (int round = std::atoi(arguments[3]); round > 0; --round) {
    const auto start = Clock::now();
    grasp.update(data, 1e-3);
    grasp.write(servo);
    motors.limits(data, servo.tau_lo, servo.tau_hi);
    const auto read = Clock::now();
    servo.f[2] = 0.2 * 9.81 + 1e-3 * (round % 7);
    const Status status = servo.tick();
    const auto solved = Clock::now();
    for (int j = 0; j < layout.joints; ++j) tau[j] = servo.torque(j);
    motors.write(data, tau.data(), 1e-3);
    const auto sent = Clock::now();
    if (status != Status::Solved) return 1;
    const Clock::time_point times[] = {start, read, solved, sent};
    for (int i = 0; i < 3; ++i)
      parts[i].push_back(
          std::chrono::duration<double, std::micro>(times[i + 1] - times[i]).count());
  }
  std::printf("%g %g %g\n", tenth(parts[0]), tenth(parts[1]), tenth(parts[2]));
  mj_deleteData(data);
  mj_deleteModel(model);
}
