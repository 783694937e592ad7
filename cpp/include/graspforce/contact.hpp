// From a contact's place and direction to its columns of W (Eq. 1).
#pragma once

#include <array>
#include <cmath>

#include "graspforce/layout.hpp"
#include "graspforce/span.hpp"

namespace graspforce {

using Vector3 = std::array<double, 3>;

inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline Vector3 unit(const Vector3& a) {
  const double length = std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
  return {a[0] / length, a[1] / length, a[2] / length};
}

// Writes the columns of W, of six rows, that belong to one contact, the first of them `first`:
// forces along the contact's axes, their torques about the origin of `point`, and a soft finger's
// torsion. The normal points into the object; x is what of `tangent` is at right angles to it, and
// y = normal × x. None need be of unit length.
inline void write_contact(const Matrix& W, int first, Model model, const Vector3& point,
                          const Vector3& normal, const Vector3& tangent) {
  const Vector3 n = unit(normal), y = unit(cross(n, tangent)), x = cross(y, n);
  const Vector3* const axes[] = {&n, &x, &y};
  const int dim = static_cast<int>(model);
  for (int d = 0; d < dim; ++d) {
    const Vector3 force = d < 3 ? *axes[d] : Vector3{}, torque = d < 3 ? cross(point, force) : n;
    for (int r = 0; r < 3; ++r) {
      W(r, first + d) = force[r];
      W(3 + r, first + d) = torque[r];
    }
  }
}

}  // namespace graspforce
