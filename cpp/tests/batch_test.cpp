// A batch against the engine, row by row; and that a row's answer is a matter of that row alone.
#include "graspforce/batch.hpp"

#include <cmath>
#include <cstring>
#include <numeric>
#include <vector>

#include "expect.hpp"
#include "graspforce/batch_derivatives.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

namespace {

// Rows of one layout and what a batch has found for them.
struct Rows {
  Layout layout;
  std::vector<double> packed, start;  // line by line; no start where that is empty
  std::vector<double> c, nu, decrement, violation;
  std::vector<int> status, newton_steps, starts, nearest;
  std::vector<BatchProof> proofs;
  bool share_limits = false;  // all rows are read with the first's numbers but for W, f and J

  std::size_t line() const { return Offsets(layout).size; }
  std::size_t forces() const { return force_count(layout); }
  std::size_t count() const { return packed.size() / line(); }

  void solve(int threads, Settings settings = {}) {
    const std::size_t B = count(), k = layout.wrench_rows;
    c.assign(B * forces(), -1), nu.assign(B * k, -1), decrement.assign(B, -1),
        violation.assign(B, -1);
    status.assign(B, -1), newton_steps.assign(B, -1), starts.assign(B, -1), nearest.assign(B, -1);
    const BatchRows rows = columns(settings);
    const BatchAnswers answers{c.data(),      nu.data(),      status.data(),    newton_steps.data(),
                               starts.data(), nearest.data(), decrement.data(), violation.data()};
    const auto found = solve_batch(rows, answers, threads, [] { return true; });
    EXPECT(found.has_value());
    proofs = *found;
  }

  BatchRows columns(Settings settings = {}) const {
    BatchRows rows;
    rows.layout = layout;
    rows.settings = settings;
    rows.count = std::ptrdiff_t(count());
    const Offsets at(layout);
    const std::ptrdiff_t step = std::ptrdiff_t(line());
#define GRASPFORCE_COLUMN(name, ...) rows.fields.name = {packed.data() + at.name, step};
    GRASPFORCE_FIELDS(GRASPFORCE_COLUMN)
#undef GRASPFORCE_COLUMN
    if (share_limits) {
      const std::ptrdiff_t own[] = {rows.fields.W.step, rows.fields.f.step, rows.fields.J.step};
#define GRASPFORCE_SHARE(name, ...) rows.fields.name.step = 0;
      GRASPFORCE_FIELDS(GRASPFORCE_SHARE)
#undef GRASPFORCE_SHARE
      rows.fields.W.step = own[0], rows.fields.f.step = own[1], rows.fields.J.step = own[2];
    }
    if (!start.empty()) rows.start = {start.data(), std::ptrdiff_t(forces())};
    return rows;
  }
};

// Problems of all kinds: possible and impossible ones, with contacts out of the grasp, coupled or
// missing joints, dependent rows of W, numbers that make no problem.
Rows random_rows(Random& random, const Layout& layout, int count) {
  Rows rows;
  rows.layout = layout;
  for (int i = 0; i < count; ++i) {
    RandomGrasp grasp(random, layout);
    if (random.chance(0.05)) grasp.couple(random);
    if (random.chance(0.1)) grasp.lose_joint(random);
    if (random.chance(0.05)) grasp.lose_joints();
    if (random.chance(0.05)) grasp.flatten();
    if (layout.ceilings && random.chance(0.1))
      grasp.data.engagement[0] = random.chance(0.5) ? 0 : random.uniform(0, 1);
    grasp.data.alpha = std::pow(10, random.uniform(-2, 3));
    grasp.wish(random, random.chance(0.1) ? 20 : random.uniform(0, 1));
    if (random.chance(0.03))
      grasp.data.packed()[random.below(int(rows.line()))] = random.chance(0.5)   ? std::nan("")
                                                            : random.chance(0.5) ? kInfinity
                                                                                 : -1;
    rows.packed.insert(rows.packed.end(), grasp.data.packed(),
                       grasp.data.packed() + grasp.data.packed_size());
  }
  return rows;
}

bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

bool same_answers(const Rows& a, const Rows& b) {
  return same_bits(a.c, b.c) && same_bits(a.nu, b.nu) && same_bits(a.decrement, b.decrement) &&
         same_bits(a.violation, b.violation) && a.status == b.status &&
         a.newton_steps == b.newton_steps && a.starts == b.starts && a.nearest == b.nearest;
}

// Each row as the engine by itself answers it: the same verdict and start, forces to rounding.
void agree_with_engine(const Rows& rows, int& solved) {
  Engine engine(rows.layout);
  const std::size_t forces = rows.forces();
  std::size_t proof = 0;
  for (std::size_t i = 0; i < rows.count(); ++i) {
    const double* packed = rows.packed.data() + i * rows.line();
    if (find_flaw(rows.layout, packed)) {
      EXPECT(rows.status[i] == int(Status::InvalidNumbers));
      continue;
    }
    engine.forget();
    const Result& result =
        engine.solve(packed, {}, rows.start.empty() ? nullptr : rows.start.data() + i * forces);
    EXPECT(rows.status[i] == int(result.status));
    EXPECT(rows.nearest[i] == int(result.nearest));
    if (result.nearest)
      EXPECT(std::equal(engine.forces(), engine.forces() + forces, rows.c.data() + i * forces));
    if (result.status == Status::Infeasible) {
      EXPECT(proof < rows.proofs.size() && rows.proofs[proof].row == std::ptrdiff_t(i));
      EXPECT(rows.proofs[proof].numbers[0] == engine.certificate_y()[0]);
      ++proof;
    }
    if (result.status != Status::Solved) continue;
    ++solved;
    EXPECT(rows.starts[i] == int(result.start));
    double largest = 0, off = 0;
    for (std::size_t j = 0; j < forces; ++j) {
      largest = std::max(largest, std::abs(engine.forces()[j]));
      off = std::max(off, std::abs(engine.forces()[j] - rows.c[i * forces + j]));
    }
    EXPECT(off <= 1e-9 * largest);
  }
  EXPECT(proof == rows.proofs.size());
}

void rows_are_solved_as_the_engine_does() {
  Random random(1);
  int solved = 0;
  for (int trial = 0; trial < 40; ++trial) {
    Rows rows = random_rows(random, random_layout(random, 10), 60);
    rows.solve(1);
    agree_with_engine(rows, solved);
    rows.start = rows.c;
    for (double& force : rows.start) force *= random.chance(0.1) ? -1 : 1.001;
    rows.solve(2);
    agree_with_engine(rows, solved);
  }
  EXPECT(solved > 2000);
}

// Limits that all rows share, joint by joint others, where joints go from finger to finger.
void rows_may_share_their_limits() {
  Random random(5);
  Layout layout;
  layout.models.assign(4, Model::PCWF);
  layout.joints = 12;
  layout.ceilings = true;
  const RandomGrasp limits(random, layout);
  Rows rows;
  rows.layout = layout;
  rows.share_limits = true;
  for (int i = 0; i < 500; ++i) {
    RandomGrasp grasp(random, layout);
    for (int j = 0; j < layout.joints; ++j) {
      grasp.data.tau_lo[j] = -0.05 * (1 + j * j);
      grasp.data.tau_hi[j] = 0.1 * (1 + j);
    }
    for (int j = 0; j < layout.joints && random.chance(0.3); ++j) {
      const int other = random.below(layout.joints);
      for (int c = 0; c < layout.components(); ++c)
        std::swap(grasp.data.J(c, j), grasp.data.J(c, other));
    }
    for (int k = 0; k < layout.contacts(); ++k) {
      grasp.data.mu[k] = limits.data.mu[k];
      grasp.data.c_max[k] = limits.data.c_max[k];
    }
    grasp.data.alpha = 10;
    grasp.wish(random, random.chance(0.1) ? 20 : random.uniform(0, 0.3));
    rows.packed.insert(rows.packed.end(), grasp.data.packed(),
                       grasp.data.packed() + grasp.data.packed_size());
  }
  int solved = 0;
  rows.solve(1);
  agree_with_engine(rows, solved);
  EXPECT(solved > 200);
}

// Bit for bit, whatever the number of threads, the order and the neighbours.
void a_row_depends_on_itself_alone() {
  Random random(2);
  for (int trial = 0; trial < 12; ++trial) {
    Rows rows = random_rows(random, random_layout(random, 8), 600);
    rows.solve(1);
    for (int threads : {2, 7}) {
      Rows again = rows;
      again.solve(threads);
      EXPECT(same_answers(rows, again));
    }
    // Every second row, from the last to the first, solved without the others.
    Rows some;
    some.layout = rows.layout;
    const std::size_t line = rows.line(), forces = rows.forces();
    std::vector<std::size_t> kept;
    for (std::size_t i = rows.count(); i >= 2; i -= 2) kept.push_back(i - 1);
    for (std::size_t i : kept)
      some.packed.insert(some.packed.end(), rows.packed.begin() + i * line,
                         rows.packed.begin() + (i + 1) * line);
    some.solve(1);
    for (std::size_t i = 0; i < kept.size(); ++i) {
      EXPECT(std::memcmp(&some.c[i * forces], &rows.c[kept[i] * forces], forces * sizeof(double)) ==
             0);
      EXPECT(some.status[i] == rows.status[kept[i]]);
      EXPECT(some.newton_steps[i] == rows.newton_steps[kept[i]]);
    }
  }
}

// The KKT systems of a batch have the solutions that the factor of each row has, and rows without
// an answer zeros.
void kkt_systems_are_solved_as_by_the_factor() {
  Random random(6);
  for (int trial = 0; trial < 20; ++trial) {
    Rows rows = random_rows(random, random_layout(random, 9), 100);
    rows.solve(1);
    const std::size_t forces = rows.forces(), line = forces + rows.layout.wrench_rows;
    std::vector<double> sides(rows.count() * line);
    for (std::size_t i = 0; i < sides.size(); ++i)
      sides[i] = i % line < forces ? random.normal() : 0;  // in the range of any W
    std::vector<double> x = sides;
    const std::unique_ptr<bool[]> wanted(new bool[rows.count()]);
    for (std::size_t i = 0; i < rows.count(); ++i)
      wanted[i] = rows.status[i] == int(Status::Solved);
    const BatchRows columns = rows.columns();
    const BatchOptima optima{rows.c.data(), rows.nu.data(), wanted.get()};
    EXPECT(solve_batch_kkt(columns, optima, x.data(), 2, [] { return true; }));
    Factor factor(rows.layout);
    for (std::size_t i = 0; i < rows.count(); ++i) {
      double* const own = sides.data() + i * line;
      const double* const found = x.data() + i * line;
      if (!wanted[i]) {
        EXPECT(std::count(found, found + line, 0.0) == std::ptrdiff_t(line));
        continue;
      }
      factor.forget();
      EXPECT(factor.at(rows.packed.data() + i * rows.line(), rows.c.data() + i * forces));
      factor.solve(own, 1);
      for (auto [first, last] : {std::pair(std::size_t(0), forces), std::pair(forces, line)}) {
        double largest = 0, off = 0;
        for (std::size_t j = first; j < last; ++j) {
          largest = std::max(largest, std::abs(own[j]));
          off = std::max(off, std::abs(own[j] - found[j]));
        }
        EXPECT(off <= 1e-9 * largest);
      }
    }
  }
}

// A limit on the steps and a tighter tolerance are those of each row.
void settings_hold_for_each_row() {
  Random random(3);
  Layout layout;
  layout.models.assign(4, Model::PCWF);
  layout.joints = 12;
  layout.ceilings = true;
  Rows rows = random_rows(random, layout, 400);
  Settings settings;
  settings.tol = 1e-15;
  rows.solve(1, settings);
  int solved = 0;
  for (std::size_t i = 0; i < rows.count(); ++i)
    if (rows.status[i] == int(Status::Solved)) {
      ++solved;
      EXPECT(rows.decrement[i] * rows.decrement[i] / 2 <= 1e-15);
    }
  EXPECT(solved > 200);
  settings.max_steps = 2;
  rows.solve(1, settings);
  for (std::size_t i = 0; i < rows.count(); ++i) EXPECT(rows.newton_steps[i] <= 2);
}

// A caller who says stop gets no answer, soon.
void a_batch_stops() {
  Random random(4);
  Layout layout;
  layout.models.assign(4, Model::PCWF);
  layout.ceilings = true;
  Rows rows = random_rows(random, layout, 5000);
  BatchRows all;
  all.layout = layout;
  all.count = std::ptrdiff_t(rows.count());
  const Offsets at(layout);
#define GRASPFORCE_COLUMN(name, ...) \
  all.fields.name = {rows.packed.data() + at.name, std::ptrdiff_t(at.size)};
  GRASPFORCE_FIELDS(GRASPFORCE_COLUMN)
#undef GRASPFORCE_COLUMN
  rows.solve(1);  // makes the arrays
  std::fill(rows.status.begin(), rows.status.end(), -1);
  const BatchAnswers answers{
      rows.c.data(),      rows.nu.data(),      rows.status.data(),    rows.newton_steps.data(),
      rows.starts.data(), rows.nearest.data(), rows.decrement.data(), rows.violation.data()};
  EXPECT(!solve_batch(all, answers, 2, [] { return false; }));
  EXPECT(rows.status.back() == -1);
}

}  // namespace

int main() {
  rows_are_solved_as_the_engine_does();
  rows_may_share_their_limits();
  a_row_depends_on_itself_alone();
  kkt_systems_are_solved_as_by_the_factor();
  settings_hold_for_each_row();
  a_batch_stops();
  return verdict("batch");
}
