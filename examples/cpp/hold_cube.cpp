// Four fingertips hold a cube of 250 g; one lets go and comes back. Prints the normal forces.
#include <cstdio>

#include "graspforce/contact.hpp"
#include "graspforce/servo.hpp"

using namespace graspforce;

int main() {
  Layout layout;
  layout.models.assign(4, Model::PCWF);  // four point contacts with friction
  layout.ceilings = true;                // each with a largest normal force
  Servo servo(layout);

  const double half = 0.0375;  // of the cube's side [m]
  const Vector3 sides[] = {{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  for (int i = 0; i < 4; ++i) {
    const auto [x, y, z] = sides[i];
    write_contact(servo.W, layout.first(i), layout.models[i], {half * x, half * y, half * z},
                  {-x, -y, -z}, {0, 0, 1});
    servo.mu[i] = 0.5;
    servo.c_max[i] = 20;  // [N]
  }
  servo.f[2] = 0.25 * 9.81;  // against gravity [N]

  for (double engagement : {1.0, 0.5, 0.1, 0.0, 0.1, 1.0}) {  // of the last finger
    servo.engagement[3] = engagement;
    const Status status = servo.tick();
    std::printf("%s, %d steps:", to_string(status), servo.result().newton_steps);
    for (int i = 0; i < 4; ++i) std::printf(" %6.3f", servo.c()[layout.first(i)]);
    std::printf(" N\n");
    if (status != Status::Solved) return 1;
  }
}
