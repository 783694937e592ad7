// The Servo of named fields: what it takes, what it refuses, what it tells.
#include "graspforce/servo.hpp"

#include <cmath>
#include <limits>
#include <string>

#include "allocations.hpp"
#include "expect.hpp"
#include "graspforce/contact.hpp"
#include "graspforce/position_command.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

// A cube of side 75 mm between four fingertips; their ceilings alone bound the grip.
static void grip(Servo& servo) {
  const Vector3 sides[] = {{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  for (int i = 0; i < 4; ++i) {
    const auto [x, y, z] = sides[i];
    write_contact(servo.W, 3 * i, Model::PCWF, {0.0375 * x, 0.0375 * y, 0}, {-x, -y, -z},
                  {0, 0, 1});
    servo.mu[i] = 0.5;
    servo.c_max[i] = 20;
  }
  servo.f[2] = 2.5;
}

static Layout four_fingers(int joints) {
  Layout layout;
  layout.models.assign(4, Model::PCWF);
  layout.joints = joints;
  layout.ceilings = true;
  return layout;
}

static void a_contact_gives_its_columns() {
  double numbers[24] = {};
  const Matrix W(numbers, 6, 4);
  write_contact(W, 0, Model::SFC, {0, 0, 0.5}, {0, 0, -2}, {3, 0, 7});
  const double expected[4][6] = {
      {0, 0, -1, 0, 0, 0}, {1, 0, 0, 0, 0.5, 0}, {0, -1, 0, 0.5, 0, 0}, {0, 0, 0, 0, 0, -1}};
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 6; ++r) EXPECT(std::abs(W(r, c) - expected[c][r]) < 1e-15);
}

static void a_tick_holds_the_cube() {
  Servo servo(four_fingers(1));
  grip(servo);
  for (int i = 0; i < 4; ++i) servo.J(3 * i, 0) = 0.1;  // one joint feels every normal force
  servo.tau_lo[0] = -10, servo.tau_hi[0] = 10, servo.tau_bias[0] = 0.25;
  EXPECT(servo.tick() == Status::Solved && !servo.refusal());
  const Margins margins = servo.margins();
  EXPECT(margins.inside() && margins.friction > 0.1 && margins.wrench_error < 1e-12);
  double normals = 0, largest = 0;
  for (int i = 0; i < 4; ++i) {
    normals += servo.c()[3 * i];
    largest = std::max(largest, servo.c()[3 * i]);
  }
  EXPECT(std::abs(servo.torque(0) - (0.1 * normals + 0.25)) < 1e-14);
  EXPECT(std::abs(margins.torque - (10 - servo.torque(0))) < 1e-14);
  EXPECT(std::abs(margins.limit - (20 - largest)) < 1e-14);
}

static void refused_numbers_leave_no_trace() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Servo servo(four_fingers(0)), clean(four_fingers(0));
  grip(servo), grip(clean);
  struct {
    double& number;
    double bad;
  } const wrong[] = {{servo.f[0], nan},   {servo.W(5, 11), kInfinity}, {servo.engagement[2], 1.5},
                     {servo.c_max[1], 0}, {servo.mu[0], -0.5},         {servo.gamma[3], -0.01},
                     {servo.alpha, 0}};
  const long before = allocations;
  for (const auto& each : wrong) {
    EXPECT(servo.tick() == Status::Solved && clean.tick() == Status::Solved);
    const double good = each.number;
    each.number = each.bad;
    EXPECT(servo.tick() == Status::InvalidNumbers && servo.refusal());
    for (int i = 0; i < 12; ++i) EXPECT(servo.c()[i] == clean.c()[i]);
    each.number = good;
    servo.f[1] += 0.1, clean.f[1] += 0.1;
    EXPECT(servo.tick() == Status::Solved && clean.tick() == Status::Solved);
    EXPECT(!servo.refusal());
    EXPECT(servo.result().newton_steps == clean.result().newton_steps);
    for (int i = 0; i < 12; ++i) EXPECT(servo.c()[i] == clean.c()[i]);
  }
  EXPECT(allocations == before);
}

// Whichever entry of whichever field changes, its kind of change is told.
static void every_change_is_found() {
  Layout layout = four_fingers(3);
  layout.inequalities = 2;
  layout.floors = layout.rate_limits = true;
  ProblemData before(layout), now(layout);
  const Offsets at(layout);
  each_field(layout, [&](const Field& field) {
    const std::string name = field.name;
    const unsigned expected = name == "W"   ? kChangedMap
                              : name == "f" ? kChangedNothing
                              : name == "J" ? kChangedJacobian
                                            : kChangedRest;
    for (std::size_t i = field.offset; i < field.offset + field.size(); ++i) {
      now = before;
      now.packed()[i] += 1;
      EXPECT(find_changes(at, before.packed(), now.packed()) == expected);
    }
  });
}

static void nothing_at_all_is_refused() {
  Servo servo(four_fingers(3));
  for (double* x = servo.packed(); x < servo.packed() + servo.packed_size(); ++x) *x = 0;
  EXPECT(servo.tick() == Status::InvalidNumbers && servo.refusal());
}

static void before_the_first_tick_nothing_is_inside() {
  Servo servo(four_fingers(3));
  EXPECT(!servo.margins().inside());
  servo.f[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT(servo.tick() == Status::InvalidNumbers && !servo.margins().inside());
  EXPECT(servo.torque(0) == 0);
}

static void a_tangent_along_the_normal_is_replaced() {
  const Layout layout = four_fingers(0);
  ProblemData data(layout);
  write_contact(data.W, 0, Model::PCWF, {0, 0, 0}, {0, 0, 2}, {0, 0, 1});
  for (int d = 0; d < 3; ++d) {
    double sum = 0;
    for (int r = 0; r < 3; ++r) sum += data.W(r, d) * data.W(r, d);
    EXPECT(std::abs(sum - 1) < 1e-12);
  }
}

static void settings_may_change_between_ticks() {
  Servo servo(four_fingers(0));
  grip(servo);
  servo.alpha = 100, servo.f[0] = 3;
  servo.settings.max_steps = 1;
  EXPECT(servo.tick() == Status::MaxSteps && servo.margins().inside());
  servo.settings.max_steps = 200;
  EXPECT(servo.tick() == Status::Solved && servo.result().start == Start::Held);
  servo.reset();
  EXPECT(servo.tick() == Status::Solved && servo.result().start == Start::Cold);
}

static void rates_are_limited_from_the_last_forces_found() {
  Layout layout = four_fingers(0);
  layout.rate_limits = true;
  Servo servo(layout);
  grip(servo);
  for (int i = 0; i < 4; ++i) servo.c_last[3 * i] = 9;
  std::fill(servo.dc_max.begin(), servo.dc_max.end(), 0.8);
  std::vector<double> last(servo.c_last.begin(), servo.c_last.end());
  int solved = 0, others = 0;
  for (int tick = 0; tick < 60; ++tick) {
    servo.f[0] = tick < 40 ? 0.1 * tick : 30;  // at last more than one tick may change
    const bool ok = servo.tick() == Status::Solved || servo.result().nearest;
    (servo.result().nearest ? others : solved) += 1;
    double change = 0;
    for (int i = 0; i < 12; ++i) change = std::max(change, std::abs(servo.c()[i] - last[i]));
    if (ok) {
      EXPECT(change < 0.8);
      EXPECT(servo.margins().limit <= 0.8 - change && servo.margins().limit > 0);
      last.assign(servo.c().begin(), servo.c().end());
    }
    for (int i = 0; i < 12; ++i) EXPECT(servo.c_last[i] == last[i]);
  }
  EXPECT(solved >= 40 && others > 0);
  // Forces that were not found are not followed.
  servo.f[0] = 300;
  servo.settings.max_steps = 1;
  EXPECT(servo.tick() == Status::MaxSteps);
  for (int i = 0; i < 12; ++i) EXPECT(servo.c_last[i] == last[i]);
}

// Both sides of a rate limit count in a proof: c_last far from zero alone proves nothing.
static void a_rate_limit_alone_proves_nothing() {
  Layout layout;
  layout.models = {Model::PCWF};
  layout.wrench_rows = 1;
  layout.rate_limits = true;
  ProblemData data(layout);
  std::fill(data.dc_max.begin(), data.dc_max.end(), 1.0);
  for (double last : {-5.0, 5.0}) {
    data.c_last[1] = last;
    const double y[1] = {}, z[6] = {0, 1, 0, 0, 1, 0};
    EXPECT(!proves_infeasible(layout, Problem(layout, data.packed()), y, z));
  }
}

// With many contacts a tick copies and compares only the entries of J inside their pattern. Against
// an engine that gets all numbers: whatever is written outside is noticed, at once.
static void a_large_jacobian_is_watched_outside_its_pattern() {
  for (unsigned seed = 0; seed < 20; ++seed) {
    Random random(seed);
    Layout layout;
    layout.models.assign(16, Model::PCWF);
    layout.joints = 48;
    layout.ceilings = true;
    RandomGrasp grasp(random, layout);
    Servo servo(layout);
    Engine engine(layout);
    std::vector<double> last(servo.packed_size());
    std::vector<Snapshot> kept;
    int coupled_row = 0, coupled_joint = 0;
    for (int tick = 0; tick < 120; ++tick) {
      for (double& entry : grasp.data.J.entries()) entry *= 1 + 1e-3 * random.normal();
      switch (random.below(12)) {
        case 0:
          coupled_row = random.below(48), coupled_joint = random.below(48);
          grasp.data.J(coupled_row, coupled_joint) = 0.01;
          break;
        case 1:
          grasp.uncouple(random);
          break;
        case 2:
          grasp.data.J(coupled_row, coupled_joint) = -0.0;
          break;
        case 3:  // blocks are found anew
          grasp.data.engagement[random.below(16)] = random.chance(0.5) ? 0 : 1;
          break;
        case 4:
          grasp.uncouple(random);
          grasp.data.engagement[random.below(16)] = random.chance(0.5) ? 0 : 1;
          break;
        case 5:
          kept.push_back(servo.snapshot());
          break;
        case 6:
          kept.clear();
          break;
        case 7: {
          const std::vector<double> before(servo.c().begin(), servo.c().end());
          servo = grasp.data;
          servo.J(random.below(48), random.below(48)) = std::numeric_limits<double>::quiet_NaN();
          EXPECT(servo.tick() == Status::InvalidNumbers && servo.refusal());
          EXPECT(std::equal(before.begin(), before.end(), servo.c().begin()));
        }
      }
      grasp.wander(random, 1e-3);
      servo = grasp.data;
      const double* packed = grasp.data.packed();
      const unsigned changed =
          tick == 0 ? kChangedAll : find_changes(servo.offsets(), last.data(), packed);
      engine.tick(packed, servo.settings, changed);
      servo.tick();
      EXPECT(servo.result().newton_steps == engine.result().newton_steps);
      for (int i = 0; i < 48; ++i) EXPECT(servo.c()[i] == engine.forces()[i]);
      for (int r = 0; r < 6; ++r) EXPECT(servo.nu()[r] == engine.multipliers()[r]);
      EXPECT(std::equal(packed, packed + last.size(), servo.snapshot()->begin()));
      last.assign(packed, packed + last.size());
    }
  }
}

static void a_position_servo_makes_the_torque() {
  PositionServo servo{3, 0.1};  // 3 N·m/rad, 0.1 N·m·s/rad
  const double command = servo.command(0.6, 0.5, 2);
  EXPECT(std::abs(command - (0.5 + (0.6 + 0.2) / 3)) < 1e-15);
  EXPECT(std::abs(servo.torque(command, 0.5, 2) - 0.6) < 1e-15);
  servo.tau_max = 0.4;
  EXPECT(std::abs(servo.torque(servo.command(0.6, 0.5, 2), 0.5, 2) - 0.4) < 1e-15);
  servo.q_max = 0.55;  // it cannot be told to go farther
  EXPECT(servo.command(0.6, 0.5) == 0.55);
  EXPECT(std::abs(servo.torque(0.55, 0.5) - 0.15) < 1e-15);
}

int main() {
  a_position_servo_makes_the_torque();
  a_large_jacobian_is_watched_outside_its_pattern();
  a_contact_gives_its_columns();
  a_tick_holds_the_cube();
  refused_numbers_leave_no_trace();
  every_change_is_found();
  nothing_at_all_is_refused();
  before_the_first_tick_nothing_is_inside();
  a_tangent_along_the_normal_is_replaced();
  settings_may_change_between_ticks();
  rates_are_limited_from_the_last_forces_found();
  a_rate_limit_alone_proves_nothing();
  return verdict("servo");
}
