// Every kernel that fits a grasp computes the same barrier: decrement, step, multipliers, slopes
// and limits of the general one, each beside the others at the same point of the same problem.
#include <cmath>
#include <string>
#include <vector>

#include "expect.hpp"
#include "graspforce/engine.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

// What a kernel finds at a point.
struct Found {
  double force = 0, lambda = 0, slope = 0, limit = 0, bound = 0, next_lambda = 0, wrench_error = 0;
  bool inside = false, balanced = false;
  std::vector<double> step, nu, next_nu;
};

static double size(const std::vector<double>& x) {
  double largest = 0;
  for (double each : x) largest = std::max(largest, std::abs(each));
  return largest;
}

template <class AnyBarrier>
static Found look(AnyBarrier& barrier, const Layout& layout, const std::vector<double>& c) {
  const int m = layout.components(), k = layout.wrench_rows;
  Found found;
  barrier.set_forces(c.data());
  found.force = size(c);
  found.inside = barrier.inside();
  found.balanced = barrier.balanced();
  found.wrench_error = barrier.wrench_error();
  EXPECT(barrier.evaluate());
  found.lambda = barrier.newton();
  found.slope = barrier.slope();
  found.limit = barrier.step_limit();
  found.nu.resize(k);
  barrier.get_multipliers(found.nu.data());
  found.step.resize(m);
  // A step that stays inside, however long the whole one is.
  const double t = std::min(1.0, 0.5 * found.limit);
  barrier.advance(t);
  barrier.get_forces(found.step.data());
  for (int i = 0; i < m; ++i) found.step[i] = (found.step[i] - c[i]) / t;
  if (found.lambda < 0.2) {
    barrier.advance(1 - t);
    found.bound = barrier.decrement_bound(found.lambda);
    found.next_nu.resize(k);
    barrier.get_multipliers(found.next_nu.data());
    EXPECT(barrier.evaluate());
    found.next_lambda = barrier.newton();
  }
  return found;
}

// Largest difference relative to the largest entry, or to `unit` where that is larger.
static double apart(const std::vector<double>& x, const std::vector<double>& y, double unit = 0) {
  double worst = 0;
  for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, std::abs(x[i] - y[i]));
  return worst / std::max({size(x), unit, 1e-300});
}

// In units of the forces. Rounding grows towards the boundary.
static std::vector<double> steps_apart;

static void agree(const Layout& layout, const Found& general, const Found& other,
                  const std::string& kernel) {
  const int before = failures;
  const double near = 1e-8;
  EXPECT(general.inside == other.inside && general.balanced == other.balanced);
  EXPECT(std::abs(general.wrench_error - other.wrench_error) <=
         1e-13 + near * general.wrench_error);
  EXPECT(std::abs(general.lambda - other.lambda) <= near * (general.lambda + 1e-4));
  EXPECT(std::abs(general.slope - other.slope) <=
         near * (1e3 * general.lambda + std::abs(general.slope)));
  EXPECT(std::abs(general.limit - other.limit) <= 1e-6 * general.limit ||
         general.limit == other.limit);
  steps_apart.push_back(apart(general.step, other.step, general.force));
  // Softness may be all that W's rank does not lack: the system is then as badly conditioned.
  EXPECT(steps_apart.back() <= (layout.soft_wrench ? 1e-8 : 1e-11));
  EXPECT(apart(general.nu, other.nu) <= near);
  EXPECT(std::abs(general.bound - other.bound) <= 1e-9 + 1e-6 * general.bound);
  for (const Found* each : {&general, &other})  // it is a bound
    EXPECT(each->next_lambda <= each->bound * (1 + 1e-6) + 1e-9);
  EXPECT(general.next_nu.size() == other.next_nu.size());
  if (general.next_nu.size() == other.next_nu.size() && !general.next_nu.empty())
    EXPECT(apart(general.next_nu, other.next_nu) <= near);
  if (failures > before) std::printf("  %s \n", kernel.c_str());
}

template <int Q, Grasps grasps>
static bool lanes(const Found& general, const Layout& layout, const Structure& structure,
                  const Problem& problem, const std::vector<double>& c) {
  if (!LaneBarrier<Q, grasps>::fits(layout, structure)) return false;
  LaneBarrier<Q, grasps> barrier(layout);
  barrier.allot(structure);
  barrier.load(problem, kChangedAll);
  agree(layout, general, look(barrier, layout, c),
        "lanes of " + std::to_string(Q) + ", grasps " + std::to_string(int(grasps)));
  return true;
}

// The step of least squares against what defines it: W d = r, a gradient in the span of Wᵀ, and
// with the slack's column a total slope of zero; rows of sizes from 1e-4 to 1e4.
static void steps_of_least_squares_are_stationary() {
  Random random(8);
  for (int trial = 0; trial < 200; ++trial) {
    Layout layout;
    // Three at least: the W of two has dependent rows.
    layout.models.assign(3 + random.below(3), Model::PCWF);
    layout.joints = 3 * layout.contacts();
    layout.ceilings = true;
    RandomGrasp grasp(random, layout);
    if (trial % 2 == 0) grasp.couple(random);
    Structure structure(layout);
    const Problem problem(layout, grasp.data.packed());
    structure.find(problem);
    Blocks blocks(layout);
    blocks.allot(structure);
    blocks.load(problem);
    LeastSquares least_squares(blocks);
    least_squares.allot();
    least_squares.clear();
    // G, γ and h, block after block, kept here as well.
    const int m = layout.components(), k = layout.wrench_rows;
    std::vector<std::vector<double>> rows;
    std::vector<int> first;
    for (int b = 0, start = 0; b < int(blocks.parts().size()); start += blocks.parts()[b++].q) {
      const BlockData& part = blocks.parts()[b];
      first.push_back(start);
      for (int i = 0; i < part.q + part.rows; ++i) {
        const double size = std::pow(10.0, random.uniform(-4, 4));
        rows.emplace_back(m + 2);
        for (int j = 0; j < part.q + 2; ++j) {
          const double entry = size * random.normal();
          least_squares.row(b, i)[j] = entry;
          rows.back()[j < part.q ? start + j : m + j - part.q] = entry;
        }
      }
    }
    std::vector<double> r(k), nu(k), d(m), gradient(m), size(m);
    for (double& each : r) each = random.normal();
    least_squares.factor(r.data());
    const double tau = random.uniform(0.1, 2), delta = least_squares.slack_step(tau);
    least_squares.step(tau, delta, d.data());
    least_squares.multipliers(tau, delta, nu.data());
    double slope = 1, slopes = 1, length = 0;
    for (const std::vector<double>& row : rows) {
      double residual = tau * row[m] + delta * row[m + 1], terms = std::abs(residual);
      for (int i = 0; i < m; ++i) residual += row[i] * d[i], terms += std::abs(row[i] * d[i]);
      slope += row[m + 1] * residual, slopes += std::abs(row[m + 1]) * terms;
      for (int i = 0; i < m; ++i) {
        gradient[i] += row[i] * residual;
        size[i] += std::abs(row[i]) * terms;
      }
      length += residual * residual;
    }
    EXPECT(std::abs(slope) <= 1e-10 * slopes);
    std::vector<double> wrench(k), wrenches(k);
    for (std::size_t b = 0; b < first.size(); ++b)
      for (int i = 0; i < blocks.parts()[b].q; ++i)
        for (int row = 0; row < k; ++row) {
          const double entry = blocks.parts()[b].Wt[i * k + row];
          gradient[first[b] + i] -= entry * nu[row];
          size[first[b] + i] += std::abs(entry * nu[row]);
          wrench[row] += entry * d[first[b] + i];
          wrenches[row] += std::abs(entry * d[first[b] + i]);
        }
    for (int i = 0; i < m; ++i) EXPECT(std::abs(gradient[i]) <= 1e-8 * size[i]);
    for (int row = 0; row < k; ++row)
      EXPECT(std::abs(wrench[row] - r[row]) <= 1e-8 * (wrenches[row] + std::abs(r[row])));
  }
}

// The engine takes the narrowest kernels that fit, as contacts couple, leave and return.
static void the_engine_chooses_by_size_and_coupling() {
  using Kind = Kernels::Kind;
  const auto chosen = [](int contacts, Model model, int wrench_rows, auto change,
                         bool soft = false) {
    Random random(3);
    Layout layout;
    layout.soft_wrench = soft;
    layout.models.assign(contacts, model);
    layout.wrench_rows = wrench_rows;
    layout.joints = 3 * contacts;
    layout.ceilings = true;
    RandomGrasp grasp(random, layout);
    change(grasp, random);
    Engine engine(layout);
    engine.tick(grasp.data.packed(), Settings{});
    return engine.kernels();
  };
  const auto nothing = [](RandomGrasp&, Random&) {};
  const auto leave = [](RandomGrasp& grasp, Random&) { grasp.data.engagement[2] = 0; };
  const auto couple = [](RandomGrasp& grasp, Random&) { grasp.data.J(0, 5) = 0.01; };
  EXPECT(chosen(4, Model::PCWF, 6, nothing) == Kind::Lanes3Plain);
  EXPECT(chosen(4, Model::FPC, 6, nothing) == Kind::Lanes3Plain);
  EXPECT(chosen(4, Model::SFC, 6, nothing) == Kind::Lanes4Plain);
  EXPECT(chosen(5, Model::PCWF, 6, nothing) == Kind::Lanes3);
  EXPECT(chosen(5, Model::SFC, 6, nothing) == Kind::Lanes4);
  EXPECT(chosen(5, Model::PCWF, 6, leave) == Kind::Lanes3Plain);
  EXPECT(chosen(5, Model::SFC, 3, leave) == Kind::Lanes4Plain);
  const auto soften = [](RandomGrasp& grasp, Random&) { grasp.data.f_soft[1] = 0.1; };
  EXPECT(chosen(4, Model::PCWF, 6, soften, true) == Kind::Lanes3Soft);
  EXPECT(chosen(4, Model::SFC, 6, soften, true) == Kind::Lanes4Soft);
  EXPECT(chosen(4, Model::PCWF, 6, couple) == Kind::General);
  EXPECT(chosen(4, Model::PCWF, 7, nothing) == Kind::General);
}

int main() {
  the_engine_chooses_by_size_and_coupling();
  steps_of_least_squares_are_stationary();
  Random random(5);
  int compared = 0, kernels[9] = {}, close = 0;
  for (int trial = 0; trial < 6000; ++trial) {
    Layout layout = random_layout(random, 12);
    layout.pulls = false;  // which kernels do not see
    layout.internals = 0;  // which general blocks alone have
    RandomGrasp grasp(random, layout);
    if (random.chance(0.2)) grasp.couple(random);
    if (layout.ceilings && random.chance(0.3))
      grasp.data.engagement[random.below(layout.contacts())] = random.chance(0.5) ? 0 : 0.3;
    grasp.wish(random, 0.2);
    // The forces of this wrench are inside every limit; at them, another wrench is to be made.
    // As near to the boundary as weights of 1 let them be: the steps from there are weighed.
    const std::vector<double> weights(grasp.data.cone_weight.begin(), grasp.data.cone_weight.end());
    std::fill(grasp.data.cone_weight.begin(), grasp.data.cone_weight.end(), 1.0);
    Engine engine(layout);
    if (engine.solve(grasp.data.packed(), Settings{}).status != Status::Solved) continue;
    std::copy(weights.begin(), weights.end(), grasp.data.cone_weight.begin());
    const std::vector<double> c(engine.forces(), engine.forces() + layout.components());
    const bool near = random.chance(0.5);  // to the minimum
    for (double& each : grasp.data.f) each += (near ? 1e-5 : 0.3) * random.normal();

    const Problem problem(layout, grasp.data.packed());
    Structure structure(layout);
    structure.find(problem);
    if (structure.blocks().empty()) continue;
    RankExamination rank(layout);
    rank.run(problem);
    if (rank.deficient()) continue;
    Blocks blocks(layout);
    blocks.allot(structure);
    blocks.load(problem);
    Barrier barrier(blocks);
    barrier.allot();
    barrier.set_weights(problem);
    const Found general = look(barrier, layout, c);
    LeastSquares least_squares(blocks);
    least_squares.allot();
    OrthogonalBarrier orthogonal(blocks, least_squares);
    orthogonal.allot();
    orthogonal.set_weights(barrier.cone_weight(), barrier.limit_weight());
    agree(layout, general, look(orthogonal, layout, c), "orthogonal");
    ++compared;
    close += general.lambda < 0.2;
    ++kernels[0];
    const auto count = [&](auto kernel) { return kernel(general, layout, structure, problem, c); };
    kernels[1] += count(lanes<3, Grasps::Plain>);
    kernels[2] += count(lanes<4, Grasps::Plain>);
    kernels[3] += count(lanes<3, Grasps::Soft>);
    kernels[4] += count(lanes<4, Grasps::Soft>);
    kernels[5] += count(lanes<3, Grasps::Small>);
    kernels[6] += count(lanes<4, Grasps::Small>);
    kernels[7] += count(lanes<3, Grasps::Any>);
    kernels[8] += count(lanes<4, Grasps::Any>);
  }
  for (int count : kernels) EXPECT(count > 100);  // every kernel has been looked at
  EXPECT(close > 100);
  std::sort(steps_apart.begin(), steps_apart.end());
  EXPECT(steps_apart[steps_apart.size() * 99 / 100] <= 1e-12);
  std::printf("%d grasps\n", compared);
  return verdict("kernels");
}
