// Wrenches that cannot be had, or only on the edge: the forces for the nearest one, by what defines
// it, and a Servo that holds it.
#include <cmath>
#include <vector>

#include "expect.hpp"
#include "graspforce/contact.hpp"
#include "graspforce/servo.hpp"
#include "judge.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

// (f − W c)/scale² of every exact row, and the distance ‖(f − W c)/scale‖.
static std::vector<double> pull(const Layout& layout, const Problem& p, const double* c,
                                double& distance) {
  const int k = layout.wrench_rows, m = layout.components();
  std::vector<double> scale(k), y(k);
  wrench_scales(layout, p, scale.data());
  distance = 0;
  for (int r = 0; r < k; ++r) {
    if (layout.soft_wrench && p.f_soft[r] > 0) continue;
    double missing = p.f[r];
    for (int i = 0; i < m; ++i) missing -= p.W[r * m + i] * c[i];
    y[r] = missing / scale[r] / scale[r];
    distance += missing / scale[r] * (missing / scale[r]);
  }
  distance = std::sqrt(distance);
  return y;
}

// No forces inside the limits go further along the pull than those found: W c is then the
// projection of f. Others are drawn by solving for other wrenches.
static void nothing_is_nearer() {
  int judged = 0, others = 0;
  for (unsigned seed = 0; seed < 300; ++seed) {
    Random random(seed);
    const Layout layout = random_layout(random);
    RandomGrasp grasp(random, layout);
    if (random.chance(0.3)) grasp.flatten();
    grasp.wish(random, random.uniform(1, 30));
    if (random.chance(0.3)) grasp.data.f[5] += 0.01;
    Engine engine(layout);
    const Result result = engine.solve(grasp.data.packed(), Settings{1e-9, 1000});
    const Problem problem(layout, grasp.data.packed());
    const char* fault = Judge(layout, grasp.data.packed()).find_fault(engine, result);
    if (fault != nullptr) std::printf("seed %u: %s\n", seed, fault);
    EXPECT(fault == nullptr);
    if (result.status != Status::Infeasible && result.status != Status::WrenchUnreachable) continue;
    EXPECT(result.nearest);
    ++judged;
    const int m = layout.components();
    const std::vector<double> c(engine.forces(), engine.forces() + m);
    double distance;
    const std::vector<double> y = pull(layout, problem, c.data(), distance);
    const auto along = [&](const double* forces) {
      double sum = 0;
      for (int r = 0; r < layout.wrench_rows; ++r)
        for (int i = 0; i < m; ++i) sum += y[r] * problem.W[r * m + i] * forces[i];
      return sum;
    };
    double size = distance;
    for (int r = 0; r < layout.wrench_rows; ++r) size = std::max(size, std::abs(problem.f[r]));
    const std::vector<double> f(grasp.data.f.begin(), grasp.data.f.end());
    for (int other = 0; other < 5; ++other) {
      for (int r = 0; r < layout.wrench_rows; ++r) grasp.data.f[r] = random.uniform(0, 1.2) * f[r];
      const Result& there = engine.solve(grasp.data.packed(), Settings{});
      if (there.status != Status::Solved && !there.nearest) continue;
      ++others;
      EXPECT(along(engine.forces()) - along(c.data()) <= 1e-6 * distance * size);
    }
  }
  EXPECT(judged > 150 && others > 500);
}

// Two point contacts, and a centre of mass beside the line between them, from tick to tick: W loses
// a row where nothing of f lacks, and the wrench is out of reach everywhere else.
static void pinch(Servo& servo, Model model, double offset) {
  for (int side : {-1, 1})
    write_contact(servo.W, side < 0 ? 0 : static_cast<int>(model), model, {0.02 * side, -offset, 0},
                  {-1.0 * side, 0, 0}, {0, 1, 0});
}

static Layout pinch_layout(Model model) {
  Layout layout;
  layout.models.assign(2, model);
  layout.ceilings = true;
  return layout;
}

static void prepare(Servo& servo, double gamma) {
  for (int i = 0; i < 2; ++i) servo.mu[i] = 0.7, servo.gamma[i] = gamma, servo.c_max[i] = 20;
  servo.f[2] = 1.96;
}

// Through 5 mm and back: the grip never opens, and no step is over five times those beside it.
static void a_servo_holds_a_pinch(Model model, double gamma, bool reachable) {
  Servo servo(pinch_layout(model));
  prepare(servo, gamma);
  const double turn = servo.f[3] = model == Model::PCWF ? 0.002 : 0;  // about the line
  const int ticks = 400, m = servo.layout().components();
  std::vector<std::vector<double>> c;
  int steps = 0, missed = 0;
  for (int tick = 0; tick <= ticks; ++tick) {
    const double offset = 5e-3 * (1 - std::abs(1 - 2.0 * tick / ticks));
    pinch(servo, model, offset);
    const Status status = servo.tick();
    if (model ==
        Model::PCWF) {  // a lift of F turns the object by −offset·F, which counts by `size`
      const double size = std::sqrt(2.0 / 3) * std::hypot(0.02, offset);
      double lift = 0;
      for (int i = 0; i < m; ++i) lift += servo.W(2, i) * servo.c()[i];
      EXPECT(std::abs(lift - (1.96 - offset * turn / size / size) /
                                 (1 + std::pow(offset / size, 2))) < 1e-9);
    }
    EXPECT(status == Status::Solved || servo.result().nearest);
    missed += status != Status::Solved;
    EXPECT(servo.margins().inside());
    EXPECT(servo.c()[0] > 3);
    c.emplace_back(servo.c().begin(), servo.c().end());
    steps += servo.result().newton_steps;
  }
  EXPECT((missed == 0) == reachable);
  const auto jump = [&](int tick) {
    double sum = 0;
    for (int i = 0; i < m; ++i) sum += std::pow(c[tick + 1][i] - c[tick][i], 2);
    return std::sqrt(sum);
  };
  for (int tick = 1; tick + 2 < ticks; ++tick)
    EXPECT(jump(tick) <= 5 * std::max({jump(tick - 1), jump(tick + 1), 1e-5}));
  // Out of the range of W the forces are those of a minimum, and the next tick goes on from them.
  if (model == Model::PCWF) EXPECT(steps < 3 * ticks);
}

// One step a tick, from the first: the forces stay inside and arrive.
static void a_budget_is_kept() {
  Servo servo(pinch_layout(Model::PCWF), {1e-9, 1});
  prepare(servo, 1);
  pinch(servo, Model::PCWF, 5e-3);
  int ticks = 0;
  for (; ticks < 30 && !(servo.ticked() && servo.result().nearest); ++ticks) {
    EXPECT(servo.tick() == Status::WrenchUnreachable);
    EXPECT(servo.result().newton_steps <= 1);
    EXPECT(servo.margins().inside());
  }
  EXPECT(ticks > 1 && ticks < 20);
  const std::vector<double> arrived(servo.c().begin(), servo.c().end());
  servo.settings.max_steps = 200;
  servo.reset();
  servo.tick();
  for (int i = 0; i < 6; ++i) EXPECT(std::abs(arrived[i] - servo.c()[i]) < 1e-4);

  // With any number of steps the verdict is right and the forces stay inside as far as any are
  // known.
  Random random(1);
  RandomGrasp grasp(random, random_layout(random));
  grasp.wish(random, 30);
  Engine engine(grasp.layout);
  const int all = engine.solve(grasp.data.packed(), Settings{}).newton_steps;
  EXPECT(engine.result().status == Status::Infeasible && engine.result().nearest);
  int cut = 0;
  for (int steps = 1; steps <= all; ++steps) {
    const Result& result = engine.solve(grasp.data.packed(), Settings{1e-9, steps});
    EXPECT(result.newton_steps <= steps);
    EXPECT(result.status == Status::Infeasible || result.status == Status::MaxSteps);
    EXPECT(result.nearest == (steps == all));
    if (result.status != Status::Infeasible || result.nearest) continue;
    ++cut;
    const Problem problem(grasp.layout, grasp.data.packed());
    EXPECT(find_margins(grasp.layout, problem, engine.forces()).inside());
  }
  EXPECT(cut > 5);
}

// With rate limits the last forces are those for the nearest wrench too.
static void last_forces_follow() {
  Layout layout = pinch_layout(Model::PCWF);
  layout.rate_limits = true;
  Servo servo(layout);
  prepare(servo, 1);
  pinch(servo, Model::PCWF, 1e-3);
  for (double& most : servo.dc_max) most = 0.2;
  servo.c_last[0] = servo.c_last[3] = 2;
  servo.c_last[2] = servo.c_last[5] = 0.5;
  for (int tick = 0; tick < 100; ++tick) {
    EXPECT(servo.tick() == Status::WrenchUnreachable && servo.result().nearest);
    for (int i = 0; i < 6; ++i) EXPECT(servo.c_last[i] == servo.c()[i]);
  }
  EXPECT(servo.c()[0] > 2);
}

// f on an extreme ray of feet, nothing asked of them, ceilings that carry all: forces on the edge.
static void the_edge_is_said() {
  int seen = 0;
  for (unsigned seed = 0; seed < 200; ++seed) {
    Random random(seed);
    Layout layout;
    layout.models.assign(2 + random.below(4), Model::PCWF);
    layout.ceilings = true;
    ProblemData data(layout);
    const int foot = random.below(layout.contacts()), kind = random.below(3);
    std::vector<double> c(layout.components());
    for (int i = 0; i < layout.contacts(); ++i) {
      write_contact(data.W, 3 * i, Model::PCWF,
                    {random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), 0}, {0, 0, 1},
                    {1, 0, 0});
      data.mu[i] = random.uniform(0.3, 1);
      data.c_max[i] = random.uniform(20, 60);
      const double angle = random.uniform(0, 6.28);
      if (kind == 1) c[3 * i] = data.c_max[i];
      if (kind != 2 || i != foot) continue;
      c[3 * i] = random.uniform(1, 10);
      c[3 * i + 1] = data.mu[i] * c[3 * i] * std::cos(angle);
      c[3 * i + 2] = data.mu[i] * c[3 * i] * std::sin(angle);
    }
    for (int r = 0; r < 6; ++r)
      for (int j = 0; j < layout.components(); ++j) data.f[r] += data.W(r, j) * c[j];
    Engine engine(layout);
    const Result& result = engine.solve(data.packed(), Settings{});
    EXPECT(result.status == Status::OnEdge || result.status == Status::Infeasible ||
           result.status == Status::Solved);
    const char* fault = Judge(layout, data.packed()).find_fault(engine, result);
    EXPECT(fault == nullptr);
    EXPECT(result.status == Status::Solved || result.nearest || kind == 0);
    if (kind == 0)  // none at all
      for (int j = 0; j < layout.components(); ++j) EXPECT(std::abs(engine.forces()[j]) < 1e-9);
    seen += result.status == Status::OnEdge;
    if (kind == 2)
      for (int j = 0; j < layout.components(); ++j)
        EXPECT(std::abs(engine.forces()[j] - c[j]) <= 1e-4 * c[3 * foot]);
  }
  EXPECT(seen > 150);
}

// A floor at the ceiling sets a normal force: cold, warm, as it ramps, and with other limits.
static void a_squeeze_is_set() {
  int solved = 0;
  for (unsigned seed = 0; seed < 100; ++seed) {
    Random random(seed);
    Layout layout = random_layout(random);
    layout.ceilings = layout.floors = true;
    layout.rate_limits = layout.soft_wrench = false;
    RandomGrasp grasp(random, layout);
    Engine engine(layout);
    grasp.wish(random, 0.2);
    Result result = engine.solve(grasp.data.packed(), Settings{});
    if (result.status != Status::Solved) continue;
    const int finger = random.below(layout.contacts());
    const double force = engine.forces()[grasp.first(finger)];
    for (int tick = 0; tick < 20; ++tick) {
      grasp.data.c_max[finger] = grasp.data.c_min[finger] = force * (1 + 1e-4 * tick);
      result = engine.tick(grasp.data.packed(), Settings{});
      EXPECT(Judge(layout, grasp.data.packed()).find_fault(engine, result) == nullptr);
      // Where the wrench alone sets the normal forces another is too much.
      EXPECT(result.status == Status::Solved || result.status == Status::Infeasible);
      if (result.status != Status::Solved) continue;
      ++solved;
      const double set = grasp.data.c_max[finger];
      const double pull = layout.pulls ? grasp.data.pull[finger] : 0;
      EXPECT(std::abs(engine.forces()[grasp.first(finger)] - set) <= 1e-9 * (set + pull));
    }
  }
  EXPECT(solved > 1000);
}

int main() {
  nothing_is_nearer();
  a_servo_holds_a_pinch(Model::PCWF, 1, false);
  a_servo_holds_a_pinch(Model::SFC, 0.005, true);
  a_servo_holds_a_pinch(Model::SFC, 2e-4, false);
  a_budget_is_kept();
  last_forces_follow();
  the_edge_is_said();
  a_squeeze_is_set();
  return verdict("nearest");
}
