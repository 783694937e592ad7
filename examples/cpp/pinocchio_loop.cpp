// Torques of a hand that a URDF describes, for readings of its joints, its touch sensors and the
// object:
//
//     pinocchio_loop hand.urdf tip1 tip2 … joint=leader*1.5 … < readings.txt
//
// with the fingertips' links and the joints that follow others.
//
// A reading has q, v, the object's place and its rotation row by row, f, how many tips touch, and
// of each its number, point and normal. Prints a line for each, all digits: contact forces,
// torques.
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/parsers/urdf.hpp>

#include "graspforce/pinocchio.hpp"
#include "graspforce/servo.hpp"

using namespace graspforce;

template <class Numbers>
static bool read(Numbers&& numbers) {
  for (double& x : numbers)
    if (!(std::cin >> x)) return false;
  return true;
}

static void loop(const char* urdf, const std::vector<PinocchioGrasp::Link>& tips,
                 const PinocchioGrasp::Options& options) {
  const double dt = 1e-3;  // [s]
  pinocchio::Model model;
  pinocchio::urdf::buildModel(urdf, model);
  pinocchio::Data data(model);
  PinocchioGrasp grasp(model, tips, options);
  Layout layout = grasp.layout();
  layout.ceilings = true;
  Servo servo(layout);
  grasp.limits(servo.tau_lo, servo.tau_hi);
  for (double& ceiling : servo.c_max) ceiling = 20;  // [N]

  Eigen::VectorXd q(model.nq), v(model.nv);
  ObjectPose object;
  std::vector<Touch> touches(tips.size());
  std::vector<double> tau(layout.joints, 0.0);
  while (read(q) && read(v) && read(object.position) && read(object.rotation[0]) &&
         read(object.rotation[1]) && read(object.rotation[2])) {
    int count = 0;
    read(servo.f);
    std::cin >> count;
    for (int i = 0; i < count; ++i) {
      std::cin >> touches[i].link;
      read(touches[i].point);
      read(touches[i].normal);
    }
    pinocchio::computeJointJacobians(model, data, q);
    pinocchio::nonLinearEffects(model, data, q, v);
    if (!grasp.update(data, {touches.data(), count}, object, dt)) {
      std::fprintf(stderr, "got %s\n", grasp.problem());
      continue;  // the last torques stay
    }
    grasp.write(servo);
    const Status status = servo.tick();
    if (status == Status::Solved || servo.result().nearest)
      for (int j = 0; j < layout.joints; ++j) tau[j] = servo.torque(j);
    for (double force : servo.c()) std::printf("%.17g ", force);
    for (double torque : tau) std::printf("%.17g ", torque);
    std::printf("\n");
  }
}

int main(int count, char** arguments) {
  std::vector<PinocchioGrasp::Link> tips;
  PinocchioGrasp::Options options;
  for (int i = 2; i < count; ++i) {
    const std::string word = arguments[i];
    const std::size_t is = word.find('='), times = word.find('*');
    if (is < times && times < word.size())
      options.mimics.push_back({word.substr(0, is), word.substr(is + 1, times - is - 1),
                                std::atof(word.c_str() + times + 1)});
    else
      tips.push_back({word});
  }
  try {
    loop(count > 1 ? arguments[1] : "hand.urdf", tips, options);
  } catch (const std::exception& refusal) {
    std::fprintf(stderr, "%s\n", refusal.what());
    return 1;
  }
  return 0;
}
