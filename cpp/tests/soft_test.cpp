// A soft wrench: minima of Phi + ½‖(W c − f)/f_soft‖² by what defines them, in long double and with
// derivatives taken by differences; with contacts that pull and internal forces of motors as well.
#include <cmath>
#include <functional>
#include <vector>

#include "expect.hpp"
#include "graspforce/contact.hpp"
#include "graspforce/servo.hpp"
#include "judge.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

// Phi(c), from the formulas of the paper; the internal forces stand behind c.
static Real phi(const Layout& layout, const Problem& p, const std::vector<Real>& c) {
  const int m = layout.components(), joints = layout.joints;
  Real soc = 0, lin = 0;
  auto below = [&lin](Real slack) { lin -= std::log(slack); };
  for (int j = 0; j < joints; ++j) {
    Real tau = p.tau_bias[j];
    bool counts = false;
    for (int i = 0; i < m; ++i)
      tau += Real(p.J[i * joints + j]) * c[i], counts |= p.J[i * joints + j] != 0;
    for (int v = 0; v < layout.internals; ++v) {
      const Real arm = p.internal[v * joints + j];
      tau += arm * c[m + v], counts |= arm != 0;
    }
    if (counts) below(p.tau_hi[j] - tau), below(tau - p.tau_lo[j]);
  }
  for (int r = 0; r < layout.inequalities; ++r) {
    Real room = p.b[r];
    for (int i = 0; i < m; ++i) room -= Real(p.A[r * m + i]) * c[i];
    below(room);
  }
  for (int i = 0; i < layout.contacts(); ++i) {
    const int first = layout.first(i), dim = static_cast<int>(layout.models[i]);
    Real tangent = 0;
    for (int d = 1; d < dim; ++d) {
      const Real t = (d == 3 ? Real(p.mu[i]) / p.gamma[i] : 1) * c[first + d];
      tangent += t * t;
    }
    const Real mu = p.mu[i], normal = c[first];
    const Real weight = layout.cone_weights ? p.cone_weight[i] : 1;
    const Real loaded = normal + (layout.pulls ? Real(p.engagement[i]) * p.pull[i] : 0);
    soc -= weight * std::log(mu * mu * loaded * loaded - tangent);
    if (layout.ceilings) below(Real(p.engagement[i]) * p.c_max[i] - normal);
    if (layout.floors) below(normal - Real(p.engagement[i]) * p.c_min[i]);
    for (int d = 0; layout.rate_limits && d < dim; ++d) {
      below(Real(p.dc_max[first + d]) - (c[first + d] - p.c_last[first + d]));
      below(Real(p.dc_max[first + d]) + (c[first + d] - p.c_last[first + d]));
    }
  }
  return soc + *p.alpha * lin;
}

// f − W c of a row.
static Real missing(const Layout& layout, const Problem& p, const std::vector<Real>& c, int row) {
  Real sum = p.f[row];
  for (int i = 0; i < layout.components(); ++i)
    sum -= Real(p.W[row * layout.components() + i]) * c[i];
  return sum;
}

// Whether ∇Phi = Wᵀν as far as the bound λ on the decrement promises: what is left of a component
// is at most λ times the root of the Hessian's diagonal, and what the last digits of c are worth.
static bool is_stationary(const Layout& layout, const Problem& p, const std::vector<Real>& c,
                          const double* nu, Real lambda) {
  const Real weight = 1 / barrier_unit(layout, p), here = phi(layout, p, c);
  auto at = [&](int i, Real change) {
    std::vector<Real> other = c;
    other[i] += change;
    return phi(layout, p, other);
  };
  const int m = layout.components(), forces = m + layout.internals;
  std::vector<Real> step(forces), root(forces);  // of the differences; of the Hessian's diagonal
  Real rounding = 0;  // what the last digits of c are worth, in that measure
  for (int i = 0; i < forces; ++i) {
    step[i] = 1e-9L * (std::abs(c[i]) + 0.1L);
    const Real far = 1e3L * step[i];
    root[i] = std::sqrt(std::abs(at(i, far) + at(i, -far) - 2 * here)) / far;
    rounding += 1e-15L * root[i] * std::abs(c[i]);
  }
  for (int i = 0; i < forces; ++i) {
    Real left = (at(i, step[i]) - at(i, -step[i])) / (2 * step[i]);
    const Real of_differences =
        1e-5L * (1 + std::abs(left)) + 4 * std::pow(root[i], 3) * step[i] * step[i];
    for (int r = 0; r < layout.wrench_rows && i < m; ++r) left -= Real(p.W[r * m + i]) * nu[r];
    if (!(std::abs(left) <=
          root[i] * (1.1L * lambda / std::sqrt(weight) + rounding) + of_differences))
      return false;
  }
  return true;
}

static void answers_are_minima() {
  Random random(11);
  int solved = 0, far = 0, cold = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    Layout layout = random_layout(random);
    layout.soft_wrench = true;
    RandomGrasp grasp(random, layout);
    if (random.chance(0.3)) grasp.couple(random);
    // Wrenches that can be made, and wrenches out of all reach; the latter not so stiff that forces
    // are at their limits to the last digits.
    const bool far_out = random.chance(0.5);
    if (far_out) grasp.wish(random, 3);
    for (double& F : grasp.data.f_soft)
      if (F > 0) F = std::max(F, far_out ? 0.3 : 0.01);
    Engine engine(layout);
    const Problem p(layout, grasp.data.packed());
    const Result& result = engine.solve(grasp.data.packed(), {1e-13, 200});
    if (result.status != Status::Solved) continue;
    ++solved;
    cold += result.newton_steps > 12;
    const std::vector<Real> c(engine.forces(), engine.forces() + force_count(layout));
    EXPECT(Judge(layout, grasp.data.packed()).find_fault(engine, result) == nullptr);
    EXPECT(is_stationary(layout, p, c, engine.multipliers(), result.decrement));
    for (int r = 0; r < layout.wrench_rows; ++r) {
      const Real lacks = missing(layout, p, c, r), F = p.f_soft[r];
      const Real size = std::abs(Real(p.f[r])) + std::abs(lacks) + 1;
      EXPECT(std::abs(lacks - F * F * engine.multipliers()[r]) <=
             1.1L * result.decrement * F * std::sqrt(barrier_unit(layout, p)) + 1e-9L * size);
      far += std::abs(lacks) > 0.1L * std::abs(Real(p.f[r]));
    }
  }
  EXPECT(solved > 1000 && far > 500 && cold > 50);
}

// One contact pushing up under a ceiling against a load: with u the push, the minimum of
// −2 ln u − α ln(c_max − u) + ½((u − f)/F)².
static void a_single_push_has_a_known_minimum() {
  Layout layout;
  layout.models = {Model::FPC};
  layout.wrench_rows = 1;
  layout.ceilings = layout.soft_wrench = true;
  for (double F : {1e-3, 0.1, 2.0, 50.0})
    for (double load : {-30.0, 0.0, 5.0, 200.0}) {
      ProblemData data(layout);
      data.W(0, 0) = 1;
      data.c_max[0] = 10;
      data.f_soft[0] = F;
      data.f[0] = load;
      Engine engine(layout);
      EXPECT(engine.solve(data.packed(), {1e-13, 200}).status == Status::Solved);
      Real low = 0, high = 10;
      for (int i = 0; i < 200; ++i) {
        const Real u = (low + high) / 2;
        (-2 / u + 5 / (10 - u) + (u - load) / F / F > 0 ? high : low) = u;
      }
      EXPECT(std::abs(engine.forces()[0] - low) <= 1e-6L * low);
    }
}

// Two soft-finger-less contacts on a line cannot turn the ball about it: with that row soft the
// pinch holds, however the load leans.
static void a_pinch_holds_an_offset_load() {
  Layout layout;
  layout.models = {Model::PCWF, Model::PCWF};
  layout.ceilings = layout.soft_wrench = true;
  Servo servo(layout);
  write_contact(servo.W, 0, Model::PCWF, {-0.03, 0, 0}, {1, 0, 0}, {0, 1, 0});
  write_contact(servo.W, 3, Model::PCWF, {0.03, 0, 0}, {-1, 0, 0}, {0, 1, 0});
  for (int i = 0; i < 2; ++i) servo.mu[i] = 0.6, servo.c_max[i] = 20;
  servo.f_soft[3] = 1e-3;
  servo.f[2] = 3;
  double before = 0;
  for (int tick = 0; tick <= 1000; ++tick) {
    servo.f[3] = 3 * 0.005 * std::sin(3.14159265 * tick / 1000);  // the load is 5 mm off, and back
    EXPECT(servo.tick() == Status::Solved);
    EXPECT(servo.result().newton_steps <= 3 || tick == 0);
    EXPECT(servo.c()[0] > 1);
    if (tick > 0) EXPECT(std::abs(servo.c()[0] - before) < 1e-3);
    before = servo.c()[0];
  }
}

// A change of softness counts, and rows may become exact and soft again.
static void softness_may_change_from_tick_to_tick() {
  Random random(3);
  Layout layout;
  layout.models.assign(4, Model::PCWF);
  layout.joints = 12;
  layout.ceilings = layout.soft_wrench = true;
  RandomGrasp grasp(random, layout);
  Servo servo(layout);
  servo = grasp.data;
  for (int tick = 0; tick < 200; ++tick) {
    for (int r = 0; r < 6; ++r)
      if (random.chance(0.1)) servo.f_soft[r] = random.chance(0.5) ? 0 : random.uniform(0.01, 1);
    const Status status = servo.tick();
    Engine engine(layout);
    EXPECT(engine.solve(servo.packed(), {1e-9, 200}).status == status);
    if (status != Status::Solved) continue;
    for (int i = 0; i < 12; ++i) EXPECT(std::abs(engine.forces()[i] - servo.c()[i]) < 2e-3);
  }
}

// What exact rows and limits forbid is infeasible whatever the soft rows; the proof is silent on
// those, and one that is not is none.
static void proofs_speak_of_exact_rows_alone() {
  Random random(5);
  int proved = 0;
  for (int trial = 0; trial < 300; ++trial) {
    Layout layout = random_layout(random);
    layout.soft_wrench = true;
    RandomGrasp grasp(random, layout);
    grasp.wish(random, 8);
    Engine engine(layout);
    const Result& result = engine.solve(grasp.data.packed(), {1e-9, 200});
    EXPECT(Judge(layout, grasp.data.packed()).find_fault(engine, result) == nullptr);
    if (result.status != Status::Infeasible) continue;
    ++proved;
    std::vector<double> y(engine.certificate_y(), engine.certificate_y() + layout.wrench_rows);
    for (int r = 0; r < layout.wrench_rows; ++r) {
      if (grasp.data.f_soft[r] == 0) continue;
      EXPECT(y[r] == 0);
      y[r] = 1e-30;
      const Problem p(layout, grasp.data.packed());
      EXPECT(!proves_infeasible(layout, p, y.data(), engine.certificate_z()));
      y[r] = 0;
    }
  }
  EXPECT(proved > 50);
}

int main() {
  answers_are_minima();
  a_single_push_has_a_known_minimum();
  a_pinch_holds_an_offset_load();
  softness_may_change_from_tick_to_tick();
  proofs_speak_of_exact_rows_alone();
  return verdict("soft");
}
