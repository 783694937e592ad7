// The friction cone as one unit: slack, gradient, Hessian, step to the boundary, dual cone.
//
// A contact's components are y = [n, t_1, …]; its cone is mu n > ‖w t‖ with w = 1 for the
// tangential forces and mu/gamma for the torsion of a soft finger. FPC has no t. In Lorentz
// coordinates s = (mu n, w t) it is s_0 > ‖ŝ‖, with the barrier −ln det s, det s = s_0² − ‖ŝ‖²
// (Eq. 9). Near the boundary the determinant is taken as (s_0 − ‖ŝ‖)(s_0 + ‖ŝ‖), which keeps the
// digits that the difference of squares has lost.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace graspforce {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

namespace lorentz {

inline double radius(const double* s, int n) {
  double sum = 0;
  for (int i = 1; i < n; ++i) sum += s[i] * s[i];
  return std::sqrt(sum);
}

inline bool inside(const double* s, int n) { return s[0] > radius(s, n); }

inline double determinant(const double* s, int n) {
  const double r = radius(s, n);
  return (s[0] - r) * (s[0] + r);
}

// Largest t for which s + t d stays in the cone; infinite when the ray never leaves it.
inline double step_limit(const double* s, const double* d, int n) {
  double a = d[0] * d[0], b = s[0] * d[0];
  for (int i = 1; i < n; ++i) {
    a -= d[i] * d[i];
    b -= s[i] * d[i];
  }
  // det(s + t d) = a t² + 2 b t + c with c > 0. Leaving the cone, or passing through its apex,
  // means that this vanishes: the limit is its smallest positive root.
  const double c = determinant(s, n), discriminant = b * b - a * c;
  if (!(discriminant < kInfinity)) return 0;  // the step's square overflows
  // Below zero only by rounding: b² ≥ a c for s inside the cone, b² = a c with one component.
  const double root = std::sqrt(std::max(0.0, discriminant));
  if (b < 0) return c / (root - b);            // right for a = 0 as well: c / (−2 b)
  return a < 0 ? (b + root) / -a : kInfinity;  // b ≥ 0: only a downward parabola has a root t > 0
}

// The multiplier of s on the central path, z = −weight·∇(−ln det s).
inline void center(const double* s, int n, double weight, double* z) {
  const double twice = 2 * weight / determinant(s, n);
  for (int i = 0; i < n; ++i) z[i] = (i == 0 ? twice : -twice) * s[i];
}

// The Nesterov-Todd scaling of s and z inside the cone: the symmetric n × n matrix V with
// V s = V⁻¹ z, which is returned as `scaled`; V² takes the place of the barrier's Hessian.
inline void scale(const double* s, const double* z, int n, double* V, double* scaled) {
  const double ds = std::sqrt(determinant(s, n)), dz = std::sqrt(determinant(z, n));
  double inner = 0;
  for (int i = 0; i < n; ++i) inner += s[i] / ds * (z[i] / dz);
  const double norm = 1 / std::sqrt(2 * (1 + inner)), size = std::sqrt(dz / ds);
  // V = size·(the boost that takes the cone's axis to w), w = (z/dz + (s_0, −ŝ)/ds)·norm.
  double w[4];
  for (int i = 0; i < n; ++i) w[i] = norm * (z[i] / dz + (i == 0 ? s[i] : -s[i]) / ds);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      V[i * n + j] = size * (i == 0 || j == 0 ? w[i + j] : (i == j) + w[i] * w[j] / (1 + w[0]));
  for (int i = 0; i < n; ++i) {
    scaled[i] = 0;
    for (int j = 0; j < n; ++j) scaled[i] += V[i * n + j] * s[j];
  }
}

}  // namespace lorentz

struct Cone {
  int dim;  // 1, 3 or 4
  double mu;
  double torsion;  // weight of the fourth component, mu/gamma

  // Lorentz coordinates per component.
  double weight(int component) const {
    return component == 0 ? mu : component == 3 ? torsion : 1.0;
  }
  void lift(const double* y, double* s) const {
    for (int i = 0; i < dim; ++i) s[i] = weight(i) * y[i];
  }

  // mu n − ‖w t‖: positive inside.
  double margin(const double* y) const {
    double s[4] = {};
    lift(y, s);
    return s[0] - lorentz::radius(s, dim);
  }

  // Adds the barrier's gradient (Eq. 11) and, unless null, the lower triangle of its Hessian
  // (Eq. 13), times `scale`; the Hessian's rows are `stride` apart. False outside the cone.
  bool add_derivatives(const double* y, double scale, double* gradient, double* hessian,
                       int stride) const {
    double s[4] = {}, first[4];
    lift(y, s);
    const double r = lorentz::radius(s, dim), det = (s[0] - r) * (s[0] + r);
    if (!(s[0] > r)) return false;
    const double twice = 2 / det;
    first[0] = -twice * mu * s[0];
    for (int j = 1; j < dim; ++j) first[j] = twice * weight(j) * s[j];
    for (int i = 0; i < dim; ++i) gradient[i] += scale * first[i];
    if (hessian == nullptr) return true;
    for (int i = 0; i < dim; ++i)
      for (int j = 0; j < i; ++j) hessian[i * stride + j] += scale * first[i] * first[j];
    // The corner first[0]² − 2 mu²/det of Eq. (13), without its difference of nearly equal terms.
    hessian[0] += scale * twice * mu * mu * ((s[0] * s[0] + r * r) / det);
    for (int j = 1; j < dim; ++j)
      hessian[j * (stride + 1)] += scale * (first[j] * first[j] + twice * weight(j) * weight(j));
    return true;
  }

  double step_limit(const double* y, const double* d) const {
    double s[4] = {}, ds[4] = {};
    lift(y, s);
    lift(d, ds);
    return lorentz::step_limit(s, ds, dim);
  }

  // Margin of e in the dual cone {e : e·y ≥ 0 for all y in the cone}: e_n − mu ‖e_t / w‖.
  double dual_margin(const double* e) const {
    double sum = 0;
    for (int j = 1; j < dim; ++j) sum += (e[j] / weight(j)) * (e[j] / weight(j));
    return e[0] - mu * std::sqrt(sum);
  }
};

}  // namespace graspforce
