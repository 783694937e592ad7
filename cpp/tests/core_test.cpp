// Tests of the core by itself: what Python cannot see from outside, or would hide.
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "expect.hpp"
#include "graspforce/engine.hpp"
#include "graspforce/validity.hpp"
#include "judge.hpp"

using namespace graspforce;

static const Settings kSettings{1e-9, 200};

// Four fingers of three joints around a cube of side 2 cm; J is a scaled rotation for each.
struct Cube {
  Layout layout;
  std::vector<double> packed;

  explicit Cube(bool ceilings) {
    for (int i = 0; i < 4; ++i) layout.models.push_back(Model::PCWF);
    layout.joints = 12;
    layout.ceilings = ceilings;
    packed.assign(Offsets(layout).size, 0.0);
    const double normals[4][3] = {{-1, 0, 0}, {0, -1, 0}, {1, 0, 0}, {0, 1, 0}};
    for (int i = 0; i < 4; ++i) {
      const double* n = normals[i];
      const double axes[3][3] = {{n[0], n[1], 0}, {0, 0, 1}, {n[1], -n[0], 0}};
      const double p[3] = {-0.01 * n[0], -0.01 * n[1], 0};
      for (int a = 0; a < 3; ++a) {
        const double* e = axes[a];
        const double torque[3] = {p[1] * e[2] - p[2] * e[1], p[2] * e[0] - p[0] * e[2],
                                  p[0] * e[1] - p[1] * e[0]};
        for (int r = 0; r < 3; ++r) {
          at(&Problem::W)[r * 12 + 3 * i + a] = e[r];
          at(&Problem::W)[(3 + r) * 12 + 3 * i + a] = torque[r];
        }
        for (int j = 0; j < 3; ++j)
          at(&Problem::J)[(3 * i + a) * 12 + 3 * i + j] = a == j ? 0.07 : 0.02 * (a - j);
      }
      at(&Problem::mu)[i] = 0.5;
      at(&Problem::gamma)[i] = 1;
      at(&Problem::engagement)[i] = 1;
      if (ceilings) at(&Problem::c_max)[i] = 20;
    }
    for (int j = 0; j < 12; ++j) {
      at(&Problem::tau_lo)[j] = -0.5;
      at(&Problem::tau_hi)[j] = 0.5;
    }
    at(&Problem::f)[2] = 2.5;
    at(&Problem::alpha)[0] = 5;
  }
  double* at(const double* Problem::* field) {
    return const_cast<double*>(Problem(layout, packed.data()).*field);
  }
};

static void step_to_the_boundary() {
  // The ray runs along the cone's generator direction: the quadratic loses its leading term.
  const double s[3] = {2, 1, 0}, d[3] = {-1, 1, 0};
  EXPECT(std::abs(lorentz::step_limit(s, d, 3) - 0.5) < 1e-15);
  const double inward[3] = {1, 0, 0}, sideways[3] = {0, 1, 0};
  EXPECT(lorentz::step_limit(s, inward, 3) == kInfinity);
  EXPECT(std::abs(lorentz::step_limit(s, sideways, 3) - 1) < 1e-15);
  // Against bisection, on random rays.
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 2000; ++trial) {
    double point[4], ray[4];
    for (int i = 1; i < 4; ++i) point[i] = normal(random);
    for (double& value : ray) value = normal(random);
    point[0] = lorentz::radius(point, 4) * (1 + std::exp(3 * normal(random)));
    const double limit = lorentz::step_limit(point, ray, 4);
    auto inside = [&](double t) {
      double moved[4];
      for (int i = 0; i < 4; ++i) moved[i] = point[i] + t * ray[i];
      return moved[0] > lorentz::radius(moved, 4);
    };
    if (limit == kInfinity) {
      EXPECT(inside(1e3) && inside(1e6));
    } else {
      EXPECT(inside(limit * (1 - 1e-6)) && !inside(limit * (1 + 1e-6)));
    }
  }
}

static void scaling_maps_slack_to_multiplier() {
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 200; ++trial) {
    double s[4], z[4], V[16], scaled[4];
    for (int i = 1; i < 4; ++i) s[i] = normal(random), z[i] = normal(random);
    s[0] = lorentz::radius(s, 4) * (1 + std::exp(normal(random)));
    z[0] = lorentz::radius(z, 4) * (1 + std::exp(normal(random)));
    lorentz::scale(s, z, 4, V, scaled);
    for (int i = 0; i < 4; ++i) {
      EXPECT(std::abs(dot(V + 4 * i, s, 4) - scaled[i]) < 1e-11 * scaled[0]);
      EXPECT(std::abs(dot(V + 4 * i, scaled, 4) - z[i]) < 1e-11 * z[0]);
      for (int j = 0; j < i; ++j) EXPECT(V[4 * i + j] == V[4 * j + i]);
    }
  }
}

static void contacts_leave_and_return() {
  for (bool deficient : {false, true}) {
    Cube cube(true);
    if (deficient)  // nothing turns the cube about z
      for (int c = 0; c < 12; ++c) cube.at(&Problem::W)[5 * 12 + c] = 0;
    Engine engine(cube.layout);
    EXPECT(engine.tick(cube.packed.data(), kSettings).status == Status::Solved);
    for (int tick = 0; tick < 400; ++tick) {
      const int finger = tick / 100;
      cube.at(&Problem::engagement)[finger] = std::abs((tick % 100) / 50.0 - 1);
      if (tick % 100 == 50) cube.at(&Problem::engagement)[finger] = 0;
      EXPECT(engine.tick(cube.packed.data(), kSettings).status == Status::Solved);
    }
  }
}

static void a_budget_ends_a_tick_with_forces_that_hold() {
  Cube cube(true);
  cube.at(&Problem::f)[0] = 3, cube.at(&Problem::alpha)[0] = 100;  // far from pure pushes
  Engine engine(cube.layout);
  const Result free = engine.solve(cube.packed.data(), kSettings);
  EXPECT(free.status == Status::Solved && free.newton_steps > 3 && free.elapsed_us == 0);
  for (int steps = 1; steps < free.newton_steps; ++steps) {
    const Result cut = engine.solve(cube.packed.data(), {1e-9, steps});
    EXPECT(cut.status == Status::MaxSteps && cut.newton_steps == steps);
    for (int i = 0; i < 4; ++i)
      EXPECT(0.5 * engine.forces()[3 * i] > lorentz::radius(engine.forces() + 3 * i, 3));
  }
  const Result hasty = engine.solve(cube.packed.data(), {1e-9, 200, 1e-6});
  EXPECT(hasty.status == Status::MaxSteps && hasty.newton_steps == 1 && hasty.elapsed_us > 0);
  const Result timed = engine.solve(cube.packed.data(), {1e-9, 200, 1e9});
  EXPECT(timed.status == Status::Solved && timed.newton_steps == free.newton_steps);
  EXPECT(timed.elapsed_us > 0);
}

static void blocks_follow_the_pattern() {
  Cube cube(false);
  Structure structure(cube.layout);
  const Problem problem(cube.layout, cube.packed.data());
  structure.find(problem);
  EXPECT(structure.blocks().size() == 4);
  EXPECT(structure.holds(problem));
  cube.at(&Problem::J)[0 * 12 + 5] = 1e-3;  // finger 2's last joint feels contact 1
  EXPECT(!structure.holds(problem));
  structure.find(problem);
  EXPECT(structure.blocks().size() == 3);
  cube.at(&Problem::engagement)[3] = 0;
  EXPECT(!structure.holds(problem));
  structure.find(problem);
  EXPECT(structure.blocks().size() == 2);
}

// Every single entry of J outside the blocks is watched, whatever stands beside it.
static void every_entry_outside_is_watched() {
  for (int contacts : {2, 3, 5}) {
    Layout layout;
    layout.models.assign(contacts, Model::PCWF);
    layout.models.back() = Model::FPC;
    layout.joints = 2 * contacts;
    const int m = layout.components();
    std::vector<double> packed(Offsets(layout).size, 1.0);
    Problem problem(layout, packed.data());
    double* J = const_cast<double*>(problem.J);
    const auto inside = [&](int c, int j) { return std::min(c / 3, contacts - 1) == j / 2; };
    for (int c = 0; c < m; ++c)
      for (int j = 0; j < layout.joints; ++j) J[c * layout.joints + j] = inside(c, j);
    Structure structure(layout);
    structure.find(problem);
    EXPECT(int(structure.blocks().size()) == contacts);
    for (int c = 0; c < m; ++c)
      for (int j = 0; j < layout.joints; ++j) {
        double& entry = J[c * layout.joints + j];
        const double before = entry;
        entry = 1e-300;
        EXPECT(structure.holds(problem, kChangedJacobian) == inside(c, j));
        entry = -0.0;
        EXPECT(structure.holds(problem, kChangedJacobian));
        entry = before;
      }
  }
}

static void infeasible_ticks_are_proved_and_forgotten() {
  Cube cube(true);
  Engine engine(cube.layout);
  const Result good = engine.tick(cube.packed.data(), kSettings);
  std::vector<double> heavy = cube.packed;
  const_cast<double*>(Problem(cube.layout, heavy.data()).f)[2] = 500;
  const Result bad = engine.tick(heavy.data(), kSettings);
  EXPECT(bad.status == Status::Infeasible && bad.violation > 0);
  EXPECT(proves_infeasible(cube.layout, Problem(cube.layout, heavy.data()), engine.certificate_y(),
                           engine.certificate_z()));
  EXPECT(!proves_infeasible(cube.layout, Problem(cube.layout, cube.packed.data()),
                            engine.certificate_y(), engine.certificate_z()));
  const Result again = engine.tick(cube.packed.data(), kSettings);
  EXPECT(again.status == Status::Solved && again.newton_steps == good.newton_steps);
}

static void a_solve_between_ticks_leaves_no_numbers_behind() {
  Cube cube(true), other(true);
  for (int i = 0; i < 144; ++i) other.at(&Problem::J)[i] *= 1.5;
  Engine engine(cube.layout), alone(cube.layout);
  for (Engine* each : {&engine, &alone}) each->tick(cube.packed.data(), kSettings);
  engine.solve(other.packed.data(), kSettings);
  cube.at(&Problem::f)[0] = 0.3;
  engine.tick(cube.packed.data(), kSettings, 0);
  alone.tick(cube.packed.data(), kSettings, 0);
  for (int c = 0; c < 12; ++c) EXPECT(engine.forces()[c] == alone.forces()[c]);
}

// What the caller knows of J's pattern is known of the last tick's blocks, not of a solve's.
static void a_solve_between_ticks_keeps_no_pattern() {
  Cube cube(true), coupled(true), without(true);
  coupled.at(&Problem::J)[5] = 1e-3;
  without.at(&Problem::engagement)[3] = 0;
  Engine engine(cube.layout);
  engine.tick(coupled.packed.data(), kSettings);
  EXPECT(engine.kernels() == Kernels::Kind::General);
  engine.solve(without.packed.data(), kSettings);
  engine.solve(cube.packed.data(), kSettings);
  EXPECT(engine.kernels() == Kernels::Kind::Lanes3Plain);
  engine.tick(coupled.packed.data(), kSettings, kChangedJacobian | kJacobianKept);
  EXPECT(engine.kernels() == Kernels::Kind::General);
}

// The rank of W is looked at in each tick that needs it, whatever was found before.
static void a_rank_is_not_remembered() {
  Cube cube(true), flat(true);
  for (int c = 0; c < 12; ++c) flat.at(&Problem::W)[5 * 12 + c] = 0;
  Engine engine(cube.layout);
  for (int round = 0; round < 2; ++round) {
    cube.at(&Problem::f)[2] = 500;  // out of reach of the limits, not of W
    EXPECT(engine.tick(cube.packed.data(), kSettings).status == Status::Infeasible);
    flat.at(&Problem::f)[5] = 0.01;
    EXPECT(engine.tick(flat.packed.data(), kSettings).status == Status::WrenchUnreachable);
    flat.at(&Problem::f)[5] = 0;
    EXPECT(engine.tick(flat.packed.data(), kSettings).status == Status::Solved);
  }
}

static void a_proof_allows_for_rounding() {
  Layout layout;
  layout.models = {Model::FPC};
  layout.wrench_rows = 4;
  layout.ceilings = true;
  // y·f is −1/2, and +1/2 when it is added up in double precision.
  std::vector<double> packed(Offsets(layout).size, 0.0);
  const Problem problem(layout, packed.data());
  const double f[] = {1e16, -1, -1e16, 0.5}, y[] = {1, 1, 1, 1}, z[] = {0};
  std::copy_n(f, 4, const_cast<double*>(problem.f));
  const_cast<double*>(problem.engagement)[0] = const_cast<double*>(problem.c_max)[0] = 1;
  const_cast<double*>(problem.mu)[0] = const_cast<double*>(problem.gamma)[0] = 1;
  EXPECT(f[0] + f[1] + f[2] + f[3] > 0);
  EXPECT(!proves_infeasible(layout, problem, y, z));
}

// A squeeze that the limits hold only weakly is bounded all the same.
static void large_forces_are_not_unbounded() {
  Cube cube(false);
  for (int c = 0; c < 12; ++c)
    for (int j = 0; j < 12; ++j) cube.at(&Problem::J)[12 * c + j] *= c % 3 == 0 ? 1e-5 : 1;
  Engine engine(cube.layout);
  EXPECT(engine.solve(cube.packed.data(), kSettings).status == Status::Solved);
  EXPECT(engine.forces()[0] > 1e4);  // 1e3 times what the limits are made for
}

// Numbers of any size: a verdict that an independent judge bears out, and finite forces with it.
static void nonsense_gets_a_status() {
  for (double size : {1e-300, 1e-200, 1e-30, 1e30, 1e200, 1e300}) {
    Cube cube(true);
    for (double& value : cube.packed) value *= size;
    for (int i = 0; i < 4; ++i) cube.at(&Problem::engagement)[i] = 1;
    EXPECT(!find_flaw(cube.layout, cube.packed.data()));
    Engine engine(cube.layout);
    const Result result = engine.solve(cube.packed.data(), {1e-9, 50});
    const Judge judge(cube.layout, cube.packed.data());
    EXPECT(judge.find_fault(engine, result) == nullptr);
  }
}

// One number out of its range, wherever it stands, is a flaw that is named.
static void a_number_out_of_range_is_named() {
  Cube cube(true);
  EXPECT(!find_flaw(cube.layout, cube.packed.data()));
  each_field(cube.layout, [&](const Field& field) {
    for (int k = 0; k < int(field.size()); ++k) {
      double& number = cube.packed[field.offset + k];
      const double before = number;
      auto refused = [&](double bad) {
        number = bad;
        const Flaw flaw = find_flaw(cube.layout, cube.packed.data());
        EXPECT(flaw && std::string(flaw.field) == field.name && flaw.expected != nullptr);
        EXPECT(flaw.row * field.columns + flaw.column == k);
      };
      refused(kInfinity);
      refused(std::nan(""));
      if (field.range == Range::Share) refused(1.5);
      if (field.range != Range::Finite) refused(-1);
      if (field.range == Range::Positive) refused(0);
      number = before;
    }
  });
  for (auto field : {&Problem::mu, &Problem::gamma, &Problem::alpha}) {
    const double before = cube.at(field)[0];
    cube.at(field)[0] = 0;  // whatever the table of fields says of their ranges
    EXPECT(find_flaw(cube.layout, cube.packed.data()));
    cube.at(field)[0] = before;
  }
}

int main() {
  step_to_the_boundary();
  scaling_maps_slack_to_multiplier();
  contacts_leave_and_return();
  a_budget_ends_a_tick_with_forces_that_hold();
  blocks_follow_the_pattern();
  every_entry_outside_is_watched();
  infeasible_ticks_are_proved_and_forgotten();
  a_solve_between_ticks_leaves_no_numbers_behind();
  a_solve_between_ticks_keeps_no_pattern();
  a_rank_is_not_remembered();
  a_proof_allows_for_rounding();
  large_forces_are_not_unbounded();
  nonsense_gets_a_status();
  a_number_out_of_range_is_named();
  return verdict("core");
}
