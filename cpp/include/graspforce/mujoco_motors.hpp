// Torques sent to a MuJoCo model's actuators; mujoco.hpp shows it in a loop.
#pragma once

#include <mujoco/mujoco.h>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "graspforce/actuators.hpp"
#include "graspforce/span.hpp"

#if mjVERSION_HEADER < 3017000
#error "graspforce/mujoco.hpp: expected MuJoCo 3.17 or newer"
#endif

namespace graspforce {

namespace mujoco {

inline std::string name_of(const mjModel* model, mjtObj kind, int number) {
  const char* const name = mj_id2name(model, kind, number);
  return name != nullptr && *name ? name : mju_type2Str(kind) + (" " + std::to_string(number));
}

[[noreturn]] inline void refuse(const std::string& what, const std::string& came,
                                const std::string& expected) {
  throw std::invalid_argument(what + ": got " + came + ", expected " + expected);
}

inline bool moves(const mjModel* model, int dof, int body) {
  for (; body > 0; body = model->body_parentid[body])
    if (dof >= model->body_dofadr[body] &&
        dof < model->body_dofadr[body] + model->body_dofnum[body])
      return true;
  return false;
}

// Whether a connect or weld ties a degree of freedom: that moves one of its bodies and not the
// other. Those above both have no part in a loop, whatever its gap.
inline bool ties(const mjModel* model, int equality, int dof) {
  int bodies[] = {model->eq_obj1id[equality], model->eq_obj2id[equality]};
  for (int& body : bodies)
    if (model->eq_objtype[equality] == mjOBJ_SITE) body = model->site_bodyid[body];
  return moves(model, dof, bodies[0]) != moves(model, dof, bodies[1]);
}

// A joint or a tendon with motors.
struct Drive {
  bool tendon = false;
  int target = -1;             // its number
  std::vector<int> actuators;  // in the order of the model

  std::string name(const mjModel* model) const {
    return name_of(model, tendon ? mjOBJ_TENDON : mjOBJ_JOINT, target);
  }
};

// The drives of a model, in the order of their first actuators. Throws for actuators of others.
inline std::vector<Drive> drives(const mjModel* model) {
  std::vector<Drive> found;
  for (int i = 0; i < model->nactuator; ++i) {
    const int kind = model->actuator_trntype[i], target = model->actuator_trnid[2 * i];
    const bool tendon = kind == mjTRN_TENDON;
    const bool joint =
        (kind == mjTRN_JOINT || kind == mjTRN_JOINTINPARENT) &&
        (model->jnt_type[target] == mjJNT_HINGE || model->jnt_type[target] == mjJNT_SLIDE);
    if (!(tendon || joint) || model->actuator_gear[6 * model->actuator_outadr[i]] == 0)
      refuse("actuator '" + name_of(model, mjOBJ_ACTUATOR, i) + "'",
             "one without a joint or tendon",
             "a motor or servo of a hinge, a slide or a tendon, with a gear");
    const auto same = [&](const Drive& each) {
      return each.tendon == tendon && each.target == target;
    };
    const auto at = std::find_if(found.begin(), found.end(), same);
    (at == found.end() ? found.emplace_back(Drive{tendon, target, {}}) : *at)
        .actuators.push_back(i);
  }
  return found;
}

}  // namespace mujoco

// What to send to a model's actuators so that they make wanted torques: motors, position and
// velocity servos, cylinders, muscles, and other `general` actuators with fixed or affine gain and
// bias (actuators.hpp).
class MujocoMotors {
 public:
  // Throws std::invalid_argument for a name that has no motor, an actuator of another kind, or one
  // without a limit. `tau_max` bounds the torques besides [N·m; N for slides and tendons].
  MujocoMotors(const mjModel* model, const mjData* data, const std::vector<std::string>& joints,
               double tau_max = Actuators::kNone)
      : model_(model) {
    const std::vector<mujoco::Drive> known = mujoco::drives(model);
    int count = 0;
    for (const std::string& name : joints) {
      const auto at = std::find_if(known.begin(), known.end(), [&](const mujoco::Drive& each) {
        return each.name(model) == name;
      });
      if (at == known.end())
        mujoco::refuse("joints", "'" + name + "', which has no motor", "joints with motors");
      Range own{-tau_max, tau_max};
      const int target = at->target;
      if (at->tendon ? model->tendon_actfrclimited[target] : model->jnt_actfrclimited[target]) {
        const mjtNum* const range =
            (at->tendon ? model->tendon_actfrcrange : model->jnt_actfrcrange) + 2 * target;
        own = {std::max(own.low, range[0]), std::min(own.high, range[1])};
      }
      actuators_.add_drive(own);
      for (int number : at->actuators) {
        if (model->actuator_gaintype[number] == mjGAIN_MUSCLE) muscles_.push_back({number, count});
        actuators_.add(actuator(number));
        ++count;
      }
    }
    look_at_muscles(data);
    for (int i = 0; i < size(); ++i) {
      const Range range = actuators_.limits(numbers(data), i);
      if (!(std::abs(range.low) < Actuators::kNone && std::abs(range.high) < Actuators::kNone))
        mujoco::refuse("'" + joints[i] + "'", "a motor without a limit",
                       "a forcerange, or a ctrlrange of a motor or servo, or tau_max");
    }
  }

  int size() const { return actuators_.size(); }

  // Writes the torques that the motors reach as the joints are.
  void limits(const mjData* data, const Span<double>& low, const Span<double>& high) {
    look_at_muscles(data);
    for (int i = 0; i < size(); ++i) {
      const Range range = actuators_.limits(numbers(data), i);
      low[i] = range.low;
      high[i] = range.high;
    }
  }

  // Sets the controls that make torques, within the limits; of actuators that lag, by the end of
  // dt, as long as these controls stay [s]; or `at_once`, as for a simulation that begins.
  void write(mjData* data, const double* tau, double dt, bool at_once = false) {
    look_at_muscles(data);
    for (int i = 0; i < size(); ++i)
      actuators_.send(numbers(data), i, tau[i], {dt, model_->opt.timestep}, at_once);
  }

  // By how much a motor's torque falls with its joint's rate.
  double damping(const mjData* data, int joint) const {
    return actuators_.damping(numbers(data), joint);
  }
  // Where a motor's joint or tendon is, and how fast it moves.
  double length(const mjData* data, int joint) const {
    return actuators_.length(numbers(data), joint);
  }
  double rate(const mjData* data, int joint) const { return actuators_.rate(numbers(data), joint); }

 private:
  using Range = Actuators::Range;
  struct Muscle {
    int number, place;  // in the model, and among the actuators
  };

  static Actuators::Numbers numbers(const mjData* data) {
    return {data->actuator_length, data->actuator_velocity, data->act, data->ctrl};
  }

  Actuators::Actuator actuator(int i) const {
    const int gain = model_->actuator_gaintype[i], bias = model_->actuator_biastype[i];
    const int dynamics = model_->actuator_dyntype[i];
    const bool known =
        (gain == mjGAIN_FIXED || gain == mjGAIN_AFFINE || gain == mjGAIN_MUSCLE) &&
        (bias == mjBIAS_NONE || bias == mjBIAS_AFFINE || bias == mjBIAS_MUSCLE) &&
        (dynamics == mjDYN_NONE || dynamics == mjDYN_INTEGRATOR || dynamics == mjDYN_FILTER ||
         dynamics == mjDYN_FILTEREXACT || dynamics == mjDYN_MUSCLE) &&
        model_->actuator_ctrlnum[i] == 1;
    if (!known)
      mujoco::refuse("actuator '" + mujoco::name_of(model_, mjOBJ_ACTUATOR, i) + "'",
                     "one whose force does not follow from its control in a way known here",
                     "a <motor> or <position> in its place");
    Actuators::Actuator found;
    found.output = model_->actuator_outadr[i];
    found.input = model_->actuator_ctrladr[i];
    found.gear = model_->actuator_gear[6 * found.output];
    const mjtNum *const a = model_->actuator_gainprm + mjNGAIN * i, *const b =
                                                                        model_->actuator_biasprm +
                                                                        mjNBIAS * i;
    if (gain == mjGAIN_FIXED) found.gain = {a[0]};
    if (gain == mjGAIN_AFFINE) found.gain = {a[0], a[1], a[2]};
    if (bias == mjBIAS_AFFINE) found.bias = {b[0], b[1], b[2]};
    if (model_->actuator_ctrllimited[found.input])
      found.control = at(model_->actuator_ctrlrange, found.input);
    if (dynamics == mjDYN_MUSCLE)  // which cuts its control off there
      found.control = {std::clamp(found.control.low, 0., 1.),
                       std::clamp(found.control.high, 0., 1.)};
    if (model_->actuator_forcelimited[i]) found.force = at(model_->actuator_forcerange, i);
    if (model_->actuator_actnum[i] > 0)
      found.state = model_->actuator_actadr[i] + model_->actuator_actnum[i] - 1;
    // A state is confined by its own range; that of a filter by its control's, too.
    if (model_->actuator_actlimited[i]) found.x = at(model_->actuator_actrange, i);
    if (found.state < 0 || dynamics != mjDYN_INTEGRATOR)
      found.x = {std::max(found.x.low, found.control.low),
                 std::min(found.x.high, found.control.high)};
    if (gain == mjGAIN_MUSCLE) found.x = {0, 1};
    found.lag = dynamics == mjDYN_INTEGRATOR    ? Actuators::Lag::Integrator
                : dynamics == mjDYN_FILTER      ? Actuators::Lag::Filter
                : dynamics == mjDYN_FILTEREXACT ? Actuators::Lag::ExactFilter
                : dynamics == mjDYN_MUSCLE      ? Actuators::Lag::Muscle
                                                : Actuators::Lag::None;
    std::copy_n(model_->actuator_dynprm + mjNDYN * i, 2, found.times);
    return found;
  }
  static Range at(const mjtNum* ranges, int i) { return {ranges[2 * i], ranges[2 * i + 1]}; }

  // A muscle's gain and bias are curves: as they are just now.
  void look_at_muscles(const mjData* data) {
    for (const Muscle& each : muscles_) {
      Actuators::Actuator& muscle = actuators_.actuator(each.place);
      const double length = data->actuator_length[muscle.output];
      const double rate = data->actuator_velocity[muscle.output];
      const mjtNum* const between = model_->actuator_lengthrange + 2 * muscle.output;
      const double strength = model_->actuator_acc0[muscle.output];
      muscle.gain = {mju_muscleGain(length, rate, between, strength,
                                    model_->actuator_gainprm + mjNGAIN * each.number)};
      muscle.bias = {mju_muscleBias(length, between, strength,
                                    model_->actuator_biasprm + mjNBIAS * each.number)};
    }
  }

  const mjModel* model_;
  Actuators actuators_;
  std::vector<Muscle> muscles_;
};

}  // namespace graspforce
