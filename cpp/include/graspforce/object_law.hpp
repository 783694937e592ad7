// The wrench that brings a rigid object to where it should be: the same as control.ObjectLaw in
// Python. Everything is in the world's axes.
//
//     const ObjectLaw law{mass, inertia};
//     …
//     const Wrench f = law.wrench(law.acceleration(target, state), state, gravity);
//     std::copy_n(f.force.begin(), 3, servo.f.begin());
//     std::copy_n(f.torque.begin(), 3, servo.f.begin() + 3);
#pragma once

#include <cmath>

#include "graspforce/object_state.hpp"

namespace graspforce {

inline Matrix3 times_transposed(const Matrix3& A, const Matrix3& B) {
  Matrix3 C;
  for (int i = 0; i < 3; ++i) C[i] = {dot(A[i], B[0]), dot(A[i], B[1]), dot(A[i], B[2])};
  return C;
}

// Axis times angle of a rotation matrix; of length up to π.
inline Vector3 rotation_vector(const Matrix3& R) {
  const double xx = R[0][0], yy = R[1][1], zz = R[2][2];
  const double x = R[2][1] - R[1][2], y = R[0][2] - R[2][0], z = R[1][0] - R[0][1];
  const double xy = R[0][1] + R[1][0], xz = R[0][2] + R[2][0], yz = R[1][2] + R[2][1];
  // The quaternion (w, x, y, z) times 4 of its components: of that which is largest, so that none
  // is lost.
  const double of_each[4][4] = {{1 + xx + yy + zz, x, y, z},
                                {x, 1 + xx - yy - zz, xy, xz},
                                {y, xy, 1 - xx + yy - zz, yz},
                                {z, xz, yz, 1 - xx - yy + zz}};
  int largest = 0;
  for (int i = 1; i < 4; ++i)
    if (of_each[i][i] > of_each[largest][largest]) largest = i;
  const double* const q = of_each[largest];
  const Vector3 axis{q[1], q[2], q[3]};
  const double size = length(axis);
  if (size == 0) return {};
  return times(std::copysign(2 * std::atan2(size, std::abs(q[0])), q[0]) / size, axis);
}

// A spring and a damper from the object to its target, fed forward with its inertia: errors e fall
// off as ë + damping ė + stiffness e = 0, as far as the contacts give the wrench.
struct ObjectLaw {
  double mass;                           // [kg]
  Matrix3 inertia;                       // about its centre of mass, object axes [kg·m²]
  double stiffness = 400, damping = 40;  // [1/s²], [1/s]
  // How the object is turned where its target's rotation is the identity.
  Matrix3 turned{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

  // The acceleration that is wanted.
  Screw acceleration(const ObjectTarget& target, const ObjectState& state) const {
    const Vector3 off = rotation_vector(
        times_transposed(target.rotation, times_transposed(state.rotation, turned)));
    return {plus(target.acceleration,
                 pull(minus(target.position, state.position), target.velocity, state.velocity)),
            plus(target.angular_acceleration,
                 pull(off, target.angular_velocity, state.angular_velocity))};
  }

  // The wrench of the contacts that makes an acceleration, torque about the centre of mass: the f
  // of W c = f. What else pushes on the object has to be taken off.
  Wrench wrench(const Screw& acceleration, const ObjectState& state, const Vector3& gravity) const {
    const auto momentum = [&](const Vector3& spin) {
      const Vector3 own = state.to_object(spin);
      return state.to_world({dot(inertia[0], own), dot(inertia[1], own), dot(inertia[2], own)});
    };
    const Vector3& spin = state.angular_velocity;
    return {times(mass, minus(acceleration.linear, gravity)),
            plus(momentum(acceleration.angular), cross(spin, momentum(spin)))};
  }

 private:
  Vector3 pull(const Vector3& off, const Vector3& wanted, const Vector3& velocity) const {
    return plus(times(stiffness, off), times(damping, minus(wanted, velocity)));
  }
};

}  // namespace graspforce
