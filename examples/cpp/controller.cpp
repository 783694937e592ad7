// A force controller: every tick the grasp's geometry and the wanted wrench come in, contact forces
// and joint torques go out. The task is read from a file, which write_task.py makes:
//
//     python write_task.py > task.txt
//     controller task.txt
//
// Prints the contact forces of every tick, all digits of them.
#include <cstdio>
#include <fstream>

#include "graspforce/servo.hpp"
#include "task.hpp"

using namespace graspforce;

static void send_torque(int, double) {}  // a real hand's driver

int main(int count, char** arguments) {
  std::ifstream task(count == 2 ? arguments[1] : "task.txt");
  Servo servo(read_layout(task));  // all memory is made here
  // Here a real hand's sensors and planner are asked.
  while (read_tick(task, servo.layout(), servo)) {
    const Status status = servo.tick();
    // Without a verdict in time the forces may still hold the grasp; forces that slip do not.
    const bool late = status == Status::MaxSteps || status == Status::Stalled;
    if (status != Status::Solved && !(late && servo.margins().inside())) {
      std::fprintf(stderr, "%s\n", to_string(status));
      if (const Flaw& flaw = servo.refusal(); flaw)
        std::fprintf(stderr, "%s[%d]: got %g, expected %s\n", flaw.field, flaw.row, flaw.got,
                     flaw.expected);
      return 1;
    }
    for (int joint = 0; joint < servo.layout().joints; ++joint)
      send_torque(joint, servo.torque(joint));
    for (double force : servo.c()) std::printf("%.17g ", force);
    std::printf("\n");
  }
  return 0;
}
