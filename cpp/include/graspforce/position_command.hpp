// Torques through motors that take positions.
#pragma once

#include <algorithm>
#include <limits>

namespace graspforce {

// A position servo, which makes stiffness·(command − q) − damping·q̇ as far as its limit lets it.
struct PositionServo {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double stiffness, damping = 0;         // [N·m/rad], [N·m·s/rad]
  double q_min = -kNone, q_max = kNone;  // commands that it takes [rad]
  double tau_max = kNone;                // [N·m]

  // The position to command for a torque, of a joint that is at q and moves with q_dot.
  double command(double tau, double q, double q_dot = 0) const {
    const double wanted = std::clamp(tau, -tau_max, tau_max);
    return std::clamp(q + (wanted + damping * q_dot) / stiffness, q_min, q_max);
  }
  // The torque that comes of a command.
  double torque(double command, double q, double q_dot = 0) const {
    return std::clamp(stiffness * (command - q) - damping * q_dot, -tau_max, tau_max);
  }
};

}  // namespace graspforce
