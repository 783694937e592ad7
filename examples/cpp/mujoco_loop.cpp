// Holds an object in a MuJoCo simulation, with whatever hand touches it:
//
//     mujoco_loop scene.xml cube 1000
//
// for so many steps, from the model's first keyframe, in which the fingers touch the object. Prints
// a line a tick, all digits: state, wrench, contact forces, torques, controls.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>

#include "graspforce/mujoco.hpp"
#include "graspforce/servo.hpp"

using namespace graspforce;

static void print(const double* numbers, int count) {
  for (int i = 0; i < count; ++i) std::printf("%.17g ", numbers[i]);
}

static int hold(const mjModel* model, mjData* data, const char* object, int ticks) {
  const double dt = model->opt.timestep;
  MujocoGrasp grasp(model, data, object);
  MujocoMotors motors(model, data, grasp.joints());
  const ObjectLaw law = grasp.law(data);
  ObjectTarget there;  // where it is now, and at rest
  there.position = grasp.pose(data).position;
  const Vector3 gravity{model->opt.gravity[0], model->opt.gravity[1], model->opt.gravity[2]};

  Layout layout = grasp.layout();
  layout.ceilings = layout.rate_limits = layout.soft_wrench = true;
  Servo servo(layout);
  const double weight = law.mass * 9.81;
  servo.alpha = 100;
  for (double& ceiling : servo.c_max) ceiling = 20 * weight;
  // By how much W c = f may be missed: two points cannot twist the object.
  for (int i = 0; i < layout.wrench_rows; ++i)
    servo.f_soft[i] = i < 3 ? 1e-3 * weight : i < 6 ? 3e-5 * weight : 1e-3 * weight;

  std::vector<double> tau(layout.joints, 0.0);
  for (int tick = 0; tick < ticks; ++tick) {
    mj_step1(model, data);
    if (!grasp.update(data, dt)) {
      std::fprintf(stderr, "tick %d: got %s\n", tick, grasp.problem());
      return 1;
    }
    grasp.write(servo);
    motors.limits(data, servo.tau_lo, servo.tau_hi);
    const ObjectState state = grasp.state(data);
    const Wrench f = law.wrench(law.acceleration(there, state), state, gravity);
    std::copy_n(f.force.begin(), 3, servo.f.begin());
    std::copy_n(f.torque.begin(), 3, servo.f.begin() + 3);
    for (double& change : servo.dc_max) change = tick == 0 ? 1000 : 500 * dt;  // [N], 500 N/s
    const Status status = servo.tick();
    if (status == Status::Solved || servo.result().nearest)  // else the last torques stay
      for (int j = 0; j < layout.joints; ++j) tau[j] = servo.torque(j);
    print(data->qpos, model->nq);
    print(data->qvel, model->nv);
    print(data->act, model->na);
    motors.write(data, tau.data(), dt, tick == 0);
    print(servo.f.data(), layout.wrench_rows);
    print(servo.c().data(), servo.c().size());
    print(tau.data(), layout.joints);
    print(data->ctrl, model->nu);
    std::printf("\n");
    mj_step2(model, data);
  }
  return 0;
}

int main(int count, char** arguments) {
  if (count != 4) {
    std::fprintf(stderr, "usage: %s scene.xml object ticks\n", arguments[0]);
    return 2;
  }
  const char* const path = arguments[1];
  const std::size_t size = std::strlen(path);
  const bool compiled = size > 4 && std::strcmp(path + size - 4, ".mjb") == 0;
  char error[1000] = "not a model that MuJoCo reads";
  mjModel* const model =
      compiled ? mj_loadModel(path, nullptr) : mj_loadXML(path, nullptr, error, sizeof error);
  if (model == nullptr) {
    std::fprintf(stderr, "%s: %s\n", path, error);
    return 1;
  }
  mjData* const data = mj_makeData(model);
  if (model->nkey > 0) mj_resetDataKeyframe(model, data, 0);
  mj_forward(model, data);
  int result = 1;
  try {
    result = hold(model, data, arguments[2], std::atoi(arguments[3]));
  } catch (const std::exception& refusal) {
    std::fprintf(stderr, "%s\n", refusal.what());
  }
  mj_deleteData(data);
  mj_deleteModel(model);
  return result;
}
