// From a contact's place and direction to its columns of W (Eq. 1).
#pragma once

#include <array>
#include <cmath>

#include "graspforce/layout.hpp"
#include "graspforce/span.hpp"

namespace graspforce {

using Vector3 = std::array<double, 3>;
// Rows of a matrix, or the axes of a frame.
using Matrix3 = std::array<Vector3, 3>;

inline double dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Vector3 plus(const Vector3& a, const Vector3& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
inline Vector3 minus(const Vector3& a, const Vector3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline Vector3 times(double s, const Vector3& a) { return {s * a[0], s * a[1], s * a[2]}; }

inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline double length(const Vector3& a) {
  return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
}

inline Vector3 unit(const Vector3& a) {
  const double size = length(a);
  return {a[0] / size, a[1] / size, a[2] / size};
}

// A force and its torque, or a motion: what a joint carries moves by it at the joint's rate, linear
// at the point that torques are taken about.
struct Wrench {
  Vector3 force{}, torque{};
};
struct Screw {
  Vector3 linear{}, angular{};
};
inline double work(const Wrench& wrench, const Screw& screw) {
  return dot(wrench.force, screw.linear) + dot(wrench.torque, screw.angular);
}
// The screw of a motion that is known at another place: as seen from `arm` beyond it.
inline Screw seen_from(const Vector3& arm, const Vector3& linear, const Vector3& angular) {
  return {plus(linear, cross(angular, arm)), angular};
}

// The wrench of one component of a contact: along its normal, x or y, or its torsion (3).
inline Wrench component(int number, const Vector3& arm, const Matrix3& axes) {
  if (number == 3) return {{}, axes[0]};
  return {axes[number], cross(arm, axes[number])};
}

// Writes a column of W, of six rows or more.
inline void write_column(const Matrix& W, int column, const Wrench& wrench) {
  for (int r = 0; r < 3; ++r) {
    W(r, column) = wrench.force[r];
    W(3 + r, column) = wrench.torque[r];
  }
}

// Writes the columns of W, of six rows, that belong to one contact, the first of them `first`:
// forces along the contact's axes, their torques about the origin of `point`, and a soft finger's
// torsion. The normal points into the object; x is what of `tangent` is at right angles to it (of
// some other direction where `tangent` is along the normal), and y = normal × x. None need be of
// unit length.
inline void write_contact(const Matrix& W, int first, Model model, const Vector3& point,
                          const Vector3& normal, const Vector3& tangent) {
  const Vector3 n = unit(normal), aside = unit(tangent);
  Vector3 across = cross(n, aside);
  for (int axis = 0; axis < 3 && !(length(across) > 1e-6); ++axis)
    across = cross(n, Vector3{double(axis == 0), double(axis == 1), double(axis == 2)});
  const Vector3 y = unit(across), x = cross(y, n);
  for (int d = 0; d < static_cast<int>(model); ++d)
    write_column(W, first + d, component(d, point, {n, x, y}));
}

}  // namespace graspforce
