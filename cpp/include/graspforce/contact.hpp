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

inline double length(const Vector3& a) {
  return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
}

inline Vector3 unit(const Vector3& a) {
  const double size = length(a);
  return {a[0] / size, a[1] / size, a[2] / size};
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
