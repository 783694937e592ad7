// Random grasps of a ball, and what can change in them from one tick to the next.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "graspforce/problem_data.hpp"

namespace graspforce {

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double normal() { return normal_(engine_); }
  double uniform(double from, double to) {
    return std::uniform_real_distribution<double>(from, to)(engine_);
  }
  int below(int count) { return std::uniform_int_distribution<int>(0, count - 1)(engine_); }
  bool chance(double probability) { return uniform(0, 1) < probability; }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> normal_;
};

inline Layout random_layout(Random& random, int most_contacts = 8) {
  Layout layout;
  const Model kinds[] = {Model::FPC, Model::PCWF, Model::SFC};
  const bool mixed = random.chance(0.4);
  for (int i = 2 + random.below(most_contacts - 1); i > 0; --i)
    layout.models.push_back(mixed ? kinds[random.below(3)] : Model::PCWF);
  layout.joints = random.chance(0.8) ? 3 * layout.contacts() : 0;
  layout.inequalities = random.chance(0.3) ? 1 + random.below(3) : 0;
  layout.ceilings = layout.joints == 0 || random.chance(0.7);
  layout.floors = random.chance(0.2);
  layout.rate_limits = random.chance(0.2);
  layout.soft_wrench = random.chance(0.2);
  layout.pulls = random.chance(0.2);
  layout.internals = layout.joints > 0 && random.chance(0.2) ? 1 + random.below(2) : 0;
  layout.cone_weights = random.chance(0.2);
  return layout;
}

// Contacts spread over a ball, each with its own three joints, as in a hand of fingertips.
class RandomGrasp {
 public:
  const Layout layout;
  ProblemData data;

  RandomGrasp(Random& random, const Layout& shape)
      : layout(shape),
        data(layout),
        alpha_(std::pow(10.0, random.uniform(-1, 2))),
        wished_(layout.components()) {
    for (int i = 0, c = 0; i < layout.contacts(); c += dim(i), ++i) {
      first_.push_back(c);
      place(random, i);
      data.mu[i] = layout.models[i] == Model::FPC ? 1 : random.uniform(0.3, 1);
      data.gamma[i] = layout.models[i] == Model::SFC ? random.uniform(0.003, 0.01) : 1;
      if (layout.ceilings) data.c_max[i] = random.uniform(5, 40);
      if (layout.floors) data.c_min[i] = random.uniform(0, 0.1);
    }
    // Rows of any softness, exact ones among them; torques are smaller than forces.
    for (int r = 0; r < layout.wrench_rows && layout.soft_wrench; ++r)
      data.f_soft[r] =
          random.chance(0.3) ? 0 : (r < 3 ? 1 : 0.05) * std::pow(10, random.uniform(-3, 1));
    for (double& most : data.pull) most = random.chance(0.3) ? 0 : random.uniform(0, 8);
    for (double& weight : data.cone_weight) weight = 1.0 / (1 + random.below(8));
    for (double& most : data.dc_max) most = random.uniform(0.5, 10);
    std::fill(data.tau_lo.begin(), data.tau_lo.end(), -0.8);
    std::fill(data.tau_hi.begin(), data.tau_hi.end(), 0.8);
    for (double& entry : data.A.entries()) entry = random.normal();
    std::fill(data.b.begin(), data.b.end(), 60.0);
    uncouple(random);
    data.alpha = alpha_;
    wish(random, 0.2);
  }

  int dim(int contact) const { return static_cast<int>(layout.models[contact]); }
  int first(int contact) const { return first_[contact]; }

  // Wishes for a wrench that forces inside the cones make, `firmness` times as large: within the
  // limits for small numbers, out of all reach for large ones.
  void wish(Random& random, double firmness) {
    for (int i = 0; i < layout.contacts(); ++i) {
      const bool there = data.engagement[i] > kRemovalThreshold;
      for (int d = 0; d < dim(i); ++d) wished_[first_[i] + d] = 0;
      if (!there) continue;
      wished_[first_[i]] = firmness * data.engagement[i] * random.uniform(1, 10);
      for (int d = 1; d < std::min(3, dim(i)); ++d)
        wished_[first_[i] + d] = 0.5 * data.mu[i] * wished_[first_[i]] * random.uniform(-1, 1);
    }
    ask();
  }

  // The wish wanders, and follows what W has become.
  void wander(Random& random, double step) {
    for (double& force : wished_) force *= 1 + step * random.normal();
    ask();
  }

  // Every finger moves its own contact.
  void uncouple(Random& random) {
    for (double& entry : data.J.entries()) entry = 0;
    for (int i = 0; i < layout.contacts() && layout.joints > 0; ++i)
      for (int d = 0; d < dim(i); ++d)
        for (int j = 0; j < 3; ++j)
          data.J(first_[i] + d, 3 * i + j) = (d == j ? 0.07 : 0.02 * random.normal());
    // The last of a finger's motors pulls against the others.
    for (double& entry : data.internal.entries()) entry = 0;
    for (int v = 0; v < layout.internals && v < layout.contacts(); ++v) {
      for (int d = 0; d < dim(v); ++d) data.J(first_[v] + d, 3 * v + 2) = 0;
      data.internal(v, 3 * v + 2) = 1;
      for (int j = 0; j < 2; ++j) data.internal(v, 3 * v + j) = random.uniform(-1, 1);
    }
  }

  // A joint comes to feel a contact of another finger.
  void couple(Random& random) {
    if (layout.joints > 0)
      data.J(random.below(layout.components()), random.below(layout.joints)) = 0.01;
  }

  // A joint is taken out of the hand.
  void lose_joint(Random& random) {
    if (layout.joints == 0) return;
    const int joint = random.below(layout.joints);
    for (int c = 0; c < layout.components(); ++c) data.J(c, joint) = 0;
  }

  void lose_joints() {
    for (double& entry : data.J.entries()) entry = 0;
  }

  // Nothing turns the ball about z any more (with six rows): W loses a row.
  void flatten() {
    const int last = layout.wrench_rows - 1;
    for (int c = 0; c < layout.components(); ++c) put(last, c, 0);
    data.f[last] = 0;
  }

  void place(Random& random, int i) {
    double n[3], x[3], y[3], length = 0, along = 0;
    for (int a = 0; a < 3; ++a) n[a] = random.normal(), x[a] = random.normal();
    if (layout.contacts() < 4 || i < 4) {  // the first four around the ball, as fingers would
      const double angle = 1.5707963 * i + 0.2 * random.normal();
      n[0] = std::cos(angle), n[1] = std::sin(angle), n[2] = 0.3 * random.normal();
    }
    for (double value : n) length += value * value;
    for (int a = 0; a < 3; ++a) n[a] /= std::sqrt(length), along += n[a] * x[a];
    length = 0;
    for (int a = 0; a < 3; ++a) x[a] -= along * n[a], length += x[a] * x[a];
    for (double& value : x) value /= std::sqrt(length);
    for (int a = 0; a < 3; ++a)
      y[a] = n[(a + 1) % 3] * x[(a + 2) % 3] - n[(a + 2) % 3] * x[(a + 1) % 3];
    const double* axes[3] = {n, x, y};
    for (int d = 0; d < dim(i); ++d) {
      const double* e = axes[d % 3];
      for (int a = 0; a < 3; ++a) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        const double torque = -0.04 * (n[b] * e[c] - n[c] * e[b]);  // the contact is at −.04 n
        put(a, first_[i] + d, d < 3 ? e[a] : 0);
        put(3 + a, first_[i] + d, d < 3 ? torque : n[a]);
      }
      for (int r = 6; r < layout.wrench_rows; ++r)  // passive joints
        put(r, first_[i] + d, random.chance(0.3) ? 0.05 * random.normal() : 0);
    }
  }

 private:
  // Fewer rows than six are the first of them.
  void put(int row, int column, double entry) {
    if (row < layout.wrench_rows) data.W(row, column) = entry;
  }

  void ask() {
    for (int r = 0; r < layout.wrench_rows; ++r) {
      data.f[r] = 0;
      for (int j = 0; j < layout.components(); ++j) data.f[r] += data.W(r, j) * wished_[j];
    }
  }

  double alpha_;
  std::vector<int> first_;
  std::vector<double> wished_;  // forces
};

}  // namespace graspforce
