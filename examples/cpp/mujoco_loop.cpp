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

// The wrench that takes the object back to where it was, and holds its weight.
struct ObjectLaw {
  const double stiffness = 400, damping = 40;  // [1/s²], [1/s]
  Vector3 place;
  double turned[4];
  double mass;

  ObjectLaw(const mjModel* model, const mjData* data, const MujocoGrasp& grasp)
      : place(grasp.pose(data).position), mass(model->body_subtreemass[grasp.object()]) {
    std::copy_n(data->xquat + 4 * grasp.object(), 4, turned);
  }

  void write(const mjModel* model, const mjData* data, const MujocoGrasp& grasp,
             const Span<double>& f) const {
    double velocity[6], off[3], back[3], spin[3];  // angular before linear
    mj_objectVelocity(model, data, mjOBJ_BODY, grasp.object(), velocity, 0);
    mju_subQuat(off, turned, data->xquat + 4 * grasp.object());
    mju_rotVecQuat(back, off, data->xquat + 4 * grasp.object());
    for (int i = 0; i < 3; ++i) {
      const double there = place[i] - grasp.origin()[i];
      f[i] = mass * (stiffness * there - damping * velocity[3 + i] - model->opt.gravity[i]);
      spin[i] = stiffness * back[i] - damping * velocity[i];
    }
    const mjtNum* const I = data->crb + 10 * grasp.object();  // xx yy zz xy xz yz
    f[3] = I[0] * spin[0] + I[3] * spin[1] + I[4] * spin[2];
    f[4] = I[3] * spin[0] + I[1] * spin[1] + I[5] * spin[2];
    f[5] = I[4] * spin[0] + I[5] * spin[1] + I[2] * spin[2];
  }
};

static void print(const double* numbers, int count) {
  for (int i = 0; i < count; ++i) std::printf("%.17g ", numbers[i]);
}

static int hold(const mjModel* model, mjData* data, const char* object, int ticks) {
  const double dt = model->opt.timestep;
  MujocoGrasp grasp(model, data, object);
  const MujocoMotors motors(model, data, grasp.joints());
  const ObjectLaw law(model, data, grasp);

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
    law.write(model, data, grasp, servo.f);
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
