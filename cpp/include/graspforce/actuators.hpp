// Controls that make wanted torques, whatever kind of actuator takes them.
//
// An actuator makes the force gain·x + bias, cut off at its own range, with gain and bias affine in
// the length and the velocity that it has: a torque source has no bias, a position servo the gain
// kp and the bias −kp·q − kv·q̇. x is the control or, of actuators that lag, a state that follows
// the control. Solved for x, a servo is told the position at which it makes the torque, and as far
// as its range of x reaches is its limit; an actuator that lags is told to go further. Several of
// one joint or tendon, a drive, share its torque in proportion to what each can give.
//
// What knows a robot fills in its actuators and says where their numbers stand, as
// mujoco_motors.hpp does.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace graspforce {

class Actuators {
 public:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  struct Range {
    double low = -kNone, high = kNone;

    double clip(double x) const { return std::min(std::max(x, low), high); }
  };
  // How x follows the control: at once; by its rate; as a filter of the first order, stepped by
  // Euler's method or exactly; as a muscle's activation.
  enum class Lag { None, Integrator, Filter, ExactFilter, Muscle };
  struct Affine {
    double constant = 0, by_length = 0, by_rate = 0;

    double at(double length, double rate) const {
      return constant + by_length * length + by_rate * rate;
    }
  };
  struct Actuator {
    int output = 0, input = 0, state = -1;  // places in Numbers; −1 where x is the control
    double gear = 1;                        // length by the drive's motion
    Affine gain, bias;
    Range control, force, x;
    Lag lag = Lag::None;
    double times[2] = {};  // of the filter, or of a muscle's activation and deactivation [s]
  };
  // Where the numbers of all a robot's actuators stand.
  struct Numbers {
    const double *lengths, *rates;
    double *states, *controls;
  };
  // How long controls stay, and in how long steps states follow them meanwhile [s].
  struct Time {
    double dt, step;
  };

  // A drive with torque limits beside those of its actuators, which are added next.
  void add_drive(Range own) { drives_.push_back({int(actuators_.size()), 0, own}); }
  void add(const Actuator& actuator) {
    actuators_.push_back(actuator);
    ++drives_.back().count;
  }
  int size() const { return static_cast<int>(drives_.size()); }
  // In the order in which they were added; whose gain and bias are not affine, a muscle's, can be
  // written before each use as they are just then.
  Actuator& actuator(int i) { return actuators_[i]; }

  // The torques that a drive reaches as it is. Those of a position servo depend on where it is; one
  // beyond its range has a single torque: nearly none to choose from.
  Range limits(const Numbers& now, int drive) const {
    const Range all = reach(now, drives_[drive]), own = drives_[drive].own;
    const double low = std::max(all.low, own.low), high = std::min(all.high, own.high);
    return {low, std::max(high, low + 1e-6 * std::max(std::abs(low), 1e-3))};
  }
  // Where it is, and how fast it moves.
  double length(const Numbers& now, int drive) const {
    const Actuator& first = actuators_[drives_[drive].first];
    return now.lengths[first.output] / first.gear;
  }
  double rate(const Numbers& now, int drive) const {
    const Actuator& first = actuators_[drives_[drive].first];
    return now.rates[first.output] / first.gear;
  }
  // By how much its torque falls with its rate.
  double damping(const Numbers& now, int drive) const {
    double sum = 0;
    for (const Actuator* each = begin(drive); each != end(drive); ++each) {
      const double x = each->state < 0 ? now.controls[each->input] : now.states[each->state];
      const double by_gain = each->gain.by_rate == 0 ? 0 : each->gain.by_rate * x;
      sum += each->gear * each->gear * std::max(-(by_gain + each->bias.by_rate), 0.);
    }
    return sum;
  }

  // Sets the controls that make a drive's torque, within its limits; of actuators that lag, by the
  // end of the time; or `at_once`, as for a simulation that begins.
  void send(const Numbers& now, int drive, double torque, Time time, bool at_once = false) const {
    const Drive& own = drives_[drive];
    const double wanted = own.own.clip(torque);
    const Range all = reach(now, own);
    const double share = std::clamp((wanted - all.low) / (all.high - all.low), 0., 1.);
    for (const Actuator* each = begin(drive); each != end(drive); ++each) {
      const Range able = reach(now, *each);
      double part = able.low + share * (able.high - able.low);
      if (!(std::abs(part) < kNone)) part = wanted / own.count;  // no limit of its own
      const double gain = this->gain(now, *each), force = part / each->gear - bias(now, *each);
      const double x = each->x.clip(gain == 0 ? 0 : force / gain);
      double control = x;
      if (each->state >= 0) {
        double& state = now.states[each->state];
        if (at_once) state = x;
        const double way = x - state;
        control = each->lag == Lag::Integrator ? way / time.dt
                                               : state + way / pace(*each, state, way, time);
      }
      now.controls[each->input] = each->control.clip(control);
    }
  }

  // The torque that comes of a drive's controls, by the end of the time.
  double torque(const Numbers& now, int drive, Time time) const {
    double sum = 0;
    for (const Actuator* each = begin(drive); each != end(drive); ++each) {
      double x = now.controls[each->input];
      if (each->state >= 0) {
        const double state = now.states[each->state], way = x - state;
        x = state +
            (each->lag == Lag::Integrator ? x * time.dt : way * pace(*each, state, way, time));
        x = each->x.clip(x);
      }
      sum += each->gear * each->force.clip(gain(now, *each) * x + bias(now, *each));
    }
    return drives_[drive].own.clip(sum);
  }

 private:
  struct Drive {
    int first, count;
    Range own;
  };

  const Actuator* begin(int drive) const { return actuators_.data() + drives_[drive].first; }
  const Actuator* end(int drive) const { return begin(drive) + drives_[drive].count; }

  static double gain(const Numbers& now, const Actuator& each) {
    return each.gain.at(now.lengths[each.output], now.rates[each.output]);
  }
  static double bias(const Numbers& now, const Actuator& each) {
    return each.bias.at(now.lengths[each.output], now.rates[each.output]);
  }
  // The least and the largest torque of an actuator at its drive, and of all of a drive's.
  static Range reach(const Numbers& now, const Actuator& each) {
    const double gain = Actuators::gain(now, each), bias = Actuators::bias(now, each);
    const auto torque = [&](double x) {
      return each.gear * each.force.clip((gain == 0 ? 0 : gain * x) + bias);
    };
    const double one = torque(each.x.low), other = torque(each.x.high);
    return {std::min(one, other), std::max(one, other)};
  }
  Range reach(const Numbers& now, const Drive& drive) const {
    Range sum{0, 0};
    for (int i = drive.first; i < drive.first + drive.count; ++i) {
      const Range each = reach(now, actuators_[i]);
      sum.low += each.low;
      sum.high += each.high;
    }
    return sum;
  }

  // Which share of the way to the control a state goes in the time.
  static double pace(const Actuator& each, double state, double way, Time time) {
    double tau = each.times[0];
    if (each.lag == Lag::Muscle) {
      const double scale = 0.5 + 1.5 * std::clamp(state, 0., 1.);
      tau = way > 0 ? tau * scale : each.times[1] / scale;
    }
    tau = std::max(tau, 1e-9);
    if (each.lag == Lag::ExactFilter) return -std::expm1(-time.dt / tau);
    const double steps = std::max(std::nearbyint(time.dt / time.step), 1.);
    return 1 - std::pow(1 - std::min(time.dt / steps / tau, 1.), steps);
  }

  std::vector<Drive> drives_;
  std::vector<Actuator> actuators_;  // of one drive side by side
};

}  // namespace graspforce
