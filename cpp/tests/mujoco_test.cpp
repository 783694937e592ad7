// Between a simulation's numbers and its controls nothing allocates: built and run by
// tests/test_cpp_mujoco.py, where MuJoCo is.
//
//     mujoco_test model.mjb object
#include "allocations.hpp"
//
#include <cstdio>

#include "expect.hpp"
#include "graspforce/mujoco.hpp"
#include "graspforce/servo.hpp"

using namespace graspforce;

int main(int, char** arguments) {
  mjModel* const model = mj_loadModel(arguments[1], nullptr);
  mjData* const data = mj_makeData(model);
  mj_resetDataKeyframe(model, data, 0);
  mj_forward(model, data);
  MujocoGrasp grasp(model, data, arguments[2]);
  MujocoMotors motors(model, data, grasp.joints());
  Layout layout = grasp.layout();
  layout.ceilings = layout.rate_limits = layout.soft_wrench = true;
  Servo servo(layout);
  for (double& ceiling : servo.c_max) ceiling = 40;
  for (double& change : servo.dc_max) change = 1;
  for (double& soft : servo.f_soft) soft = 1e-3;
  servo.f[2] = 0.2 * 9.81;
  std::vector<double> tau(layout.joints);
  long most = 0;
  int answered = 0, dropped = 0;
  for (int tick = 0; tick < 300; ++tick) {
    mj_step1(model, data);
    const int contacts = data->ncon;
    if (tick % 10 == 5) data->ncon = 0;  // contacts that flicker
    dropped += contacts != data->ncon;
    const long before = allocations.load();
    const bool read = grasp.update(data, model->opt.timestep);
    grasp.write(servo);
    motors.limits(data, servo.tau_lo, servo.tau_hi);
    const Status status = servo.tick();
    for (int j = 0; j < layout.joints; ++j) tau[j] = servo.torque(j);
    motors.write(data, tau.data(), model->opt.timestep);
    most = std::max(most, allocations.load() - before);
    data->ncon = contacts;
    EXPECT(read);
    answered += status == Status::Solved || servo.result().nearest;
    mj_step2(model, data);
  }
  EXPECT(most == 0);
  EXPECT(answered == 300);
  EXPECT(dropped > 20);

  // A link that may touch later has slots from the start, and its joints their columns.
  MujocoGrasp::Options options;
  options.further_links = {mj_id2name(model, mjOBJ_BODY, 1)};
  mj_resetDataKeyframe(model, data, 0);
  mj_forward(model, data);
  const MujocoGrasp wider(model, data, arguments[2], options);
  EXPECT(wider.book().size() == grasp.book().size() + options.face_slots);
  EXPECT(wider.book().engagement(grasp.book().size()) == 0);
  EXPECT(wider.joints().size() >= grasp.joints().size());
  const auto refusal = [&]() -> std::string {
    try {
      const MujocoGrasp none(model, data, arguments[2], options);
    } catch (const std::invalid_argument& refused) {
      return refused.what();
    }
    return "";
  };
  options.book.spare = 1;  // whose joints would not be known
  EXPECT(refusal().find("book.spare: got 1") == 0);
  options.book.spare = 0;
  options.further_links = {"nothing of that name"};
  EXPECT(refusal().find("nothing of that name") != std::string::npos);

  // What makes no grasp is said, and the fields can still be written.
  data->subtree_com[3 * grasp.object()] = std::numeric_limits<double>::quiet_NaN();
  EXPECT(!grasp.update(data, model->opt.timestep));
  EXPECT(std::string(grasp.problem()).find("not finite") != std::string::npos);
  grasp.write(servo);
  EXPECT(servo.tick() == Status::Solved || servo.result().nearest);
  mj_deleteData(data);
  mj_deleteModel(model);
  return verdict("mujoco");
}
