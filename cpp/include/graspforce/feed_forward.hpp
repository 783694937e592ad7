// The torques that move a robot's own inertia so that its contacts go along with the object.
//
// Three steps: how the object's material accelerates at each contact, beyond what the robot's does
// by its joints' rates alone (follow); the inertia that the motors move (MotorInertia); and of all
// accelerations of the motors that make up for the first, the one nearest to a wished one
// (NearestMotion).
#pragma once

#include <algorithm>
#include <vector>

#include "graspforce/contact.hpp"
#include "graspforce/linalg.hpp"

namespace graspforce {

// How a rigid body moves: the velocity of its material at `centre`, and the acceleration there; of
// a robot's link, the one that it has while no joint accelerates.
struct BodyMotion {
  Vector3 centre{};
  Screw velocity, acceleration;

  Vector3 acceleration_at(const Vector3& point) const {
    const Vector3 arm = minus(point, centre), &spin = velocity.angular;
    return plus(plus(acceleration.linear, cross(acceleration.angular, arm)),
                cross(spin, cross(spin, arm)));
  }
};

// Writes what joints have to accelerate a contact by, component by component, for it to go along
// with the object.
inline void follow(const BodyMotion& object, const BodyMotion& link, const Vector3& point,
                   const Matrix3& axes, int components, double* wanted) {
  const Vector3 apart = minus(object.acceleration_at(point), link.acceleration_at(point));
  for (int d = 0; d < std::min(components, 3); ++d) wanted[d] = dot(axes[d], apart);
  if (components == 4)
    wanted[3] = dot(axes[0], minus(object.acceleration.angular, link.acceleration.angular));
}

// The inertia that n motors move, and a metric in which joints count the heavier, the nearer they
// are to an end of their range: the others go on in their place, and they come to rest before it.
class MotorInertia {
 public:
  // How many times its inertia a joint has more so far from the nearest end, by the distance from
  // which on it nears that.
  static double heavier(double left, double near) {
    const double share = std::clamp(left / near, 1e-3, 1.);
    return 1 / (share * share) - 1;
  }

  // Takes the k joints' inertia, what each has more of in the metric, their motions by the motors',
  // k × n, and what the motors have besides; writes both, n × n.
  void write(const Matrix& joints, const double* more, const Matrix& driven, const double* besides,
             const Matrix& inertia, const Matrix& metric) {
    const int k = driven.rows(), n = driven.columns();
    moved_.assign(std::size_t(k) * n, 0);
    std::fill_n(inertia.data(), n * n, 0);
    std::fill_n(metric.data(), n * n, 0);
    for (int i = 0; i < k; ++i)
      for (int a = 0; a < n; ++a)
        if (const double ratio = driven(i, a); ratio != 0)
          for (int j = 0; j < k; ++j) moved_[j * n + a] += joints(j, i) * ratio;
    for (int i = 0; i < k; ++i)
      for (int a = 0; a < n; ++a)
        if (const double ratio = driven(i, a); ratio != 0) {
          add_scaled(ratio, &moved_[i * n], n, &inertia(a, 0));
          add_scaled(ratio * more[i], &driven(i, 0), n, &metric(a, 0));
        }
    for (int a = 0; a < n; ++a) inertia(a, a) += besides[a];
    add_scaled(1, inertia.data(), n * n, metric.data());
  }

 private:
  std::vector<double> moved_;
};

// Of all accelerations q of n motors with J q = wanted, the one nearest in a metric to a wished
// one. Rows may be missed: they count up to an effective mass of weight² / give.
class NearestMotion {
 public:
  // `q` is the wished one before. A motor that moves nothing, whose row of the metric and column of
  // J are 0, keeps it. Rows without weight are left out.
  void find(const Matrix& metric, const Matrix& J, const double* wanted, const double* weights,
            double give, double* q) {
    const int n = J.columns();
    counted_.clear();
    for (int i = 0; i < J.rows(); ++i)
      if (weights[i] != 0) counted_.push_back(i);
    const int m = static_cast<int>(counted_.size());
    L_.assign(metric.data(), metric.data() + n * n);
    for (int a = 0; a < n; ++a)
      if (L_[a * n + a] == 0) L_[a * n + a] = 1;
    cholesky(L_.data(), n);
    easily_.resize(std::size_t(n) * m);  // L⁻¹ Jᵀ, weighted
    for (int a = 0; a < n; ++a)
      for (int i = 0; i < m; ++i) easily_[a * m + i] = weights[counted_[i]] * J(counted_[i], a);
    forward_substitute(L_.data(), n, easily_.data(), m);
    yields_.assign(std::size_t(m) * m, 0);
    for (int a = 0; a < n; ++a)
      for (int i = 0; i < m; ++i)
        add_scaled(easily_[a * m + i], &easily_[a * m], i + 1, &yields_[i * m]);
    pull_.resize(m);
    for (int i = 0; i < m; ++i) {
      const int row = counted_[i];
      yields_[i * (m + 1)] += give;
      pull_[i] = weights[row] * (wanted[row] - dot(&J(row, 0), q, n));
    }
    cholesky(yields_.data(), m);
    forward_substitute(yields_.data(), m, pull_.data());
    back_substitute(yields_.data(), m, pull_.data());
    change_.resize(n);
    for (int a = 0; a < n; ++a) change_[a] = dot(&easily_[a * m], pull_.data(), m);
    back_substitute(L_.data(), n, change_.data());
    for (int a = 0; a < n; ++a) q[a] += change_[a];
  }

 private:
  std::vector<int> counted_;
  std::vector<double> L_, easily_, yields_, pull_, change_;
};

}  // namespace graspforce
