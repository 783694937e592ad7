// The friction cone as one unit: slack, gradient, Hessian, step to the boundary, dual margin.
//
// A contact's components are y = [n, t_1, …]; its cone is mu n > ‖w t‖ with w = 1 for the
// tangential forces and mu/gamma for the torsion of a soft finger. FPC has no t. The barrier is
// −ln g, g = (mu n)² − ‖w t‖², Eq. (9). Phase 1 moves the apex: mu n + shift takes the place of
// mu n. Everything near the boundary goes through the factored form g = (h − ‖w t‖)(h + ‖w t‖),
// which keeps its digits where h² − ‖w t‖² has lost them.
#pragma once

#include <cmath>
#include <limits>

namespace graspforce {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Cone {
  int dim;  // 1, 3 or 4
  double mu;
  double torsion;  // weight of the fourth component, mu/gamma

  double weight(int component) const { return component == 3 ? torsion : 1.0; }

  double tangential(const double* y) const {
    double sum = 0;
    for (int j = 1; j < dim; ++j) sum += weight(j) * weight(j) * y[j] * y[j];
    return std::sqrt(sum);
  }

  // mu n + shift − ‖w t‖: positive inside.
  double margin(const double* y, double shift = 0) const {
    return mu * y[0] + shift - tangential(y);
  }

  // Adds the barrier's gradient (Eq. 11) and the lower triangle of its Hessian (Eq. 13), times
  // `scale`; the Hessian's rows are `stride` apart. Returns false outside the cone.
  bool add_derivatives(const double* y, double shift, double scale, double* gradient,
                       double* hessian, int stride) const {
    const double height = mu * y[0] + shift, radius = tangential(y);
    const double g = (height - radius) * (height + radius);
    if (!(height > radius)) return false;
    const double twice = 2 / g;
    double first[4];
    first[0] = -twice * mu * height;
    for (int j = 1; j < dim; ++j) first[j] = twice * weight(j) * weight(j) * y[j];
    for (int i = 0; i < dim; ++i) {
      gradient[i] += scale * first[i];
      for (int j = 0; j < i; ++j) hessian[i * stride + j] += scale * first[i] * first[j];
    }
    // The corner first[0]² − 2 mu²/g of Eq. (13), without its difference of nearly equal terms.
    hessian[0] += scale * twice * mu * mu * (height * height + radius * radius) / g;
    for (int j = 1; j < dim; ++j)
      hessian[j * stride + j] += scale * (first[j] * first[j] + twice * weight(j) * weight(j));
    return true;
  }

  // Largest t for which y + t d (with shifts) stays inside; infinite when the ray never leaves.
  double step_limit(const double* y, const double* d, double shift = 0, double dshift = 0) const {
    const double height = mu * y[0] + shift, rise = mu * d[0] + dshift;
    const double radius = tangential(y);
    double a = rise * rise, b = height * rise;
    for (int j = 1; j < dim; ++j) {
      const double w2 = weight(j) * weight(j);
      a -= w2 * d[j] * d[j];
      b -= w2 * y[j] * d[j];
    }
    const double c = (height - radius) * (height + radius);
    // g(t) = a t² + 2 b t + c with c > 0; its smallest positive root leaves the double cone. On
    // the way the apex may be passed only through g = 0, so that root is the limit.
    const double discriminant = b * b - a * c;
    if (discriminant < 0) return kInfinity;
    const double root = std::sqrt(discriminant);
    if (b < 0) return c / (root - b);            // also right for a = 0: c / (−2 b)
    return a < 0 ? (b + root) / -a : kInfinity;  // b ≥ 0: only a downward parabola comes back
  }

  // Margin of e in the dual cone {e : e·y ≥ 0 for all y in the cone}: e_n − mu ‖e_t / w‖.
  double dual_margin(const double* e) const {
    double sum = 0;
    for (int j = 1; j < dim; ++j) sum += (e[j] / weight(j)) * (e[j] / weight(j));
    return e[0] - mu * std::sqrt(sum);
  }
};

}  // namespace graspforce
