// Solutions of the KKT system against a dense Hessian in long double and Gaussian elimination, and
// against how the optimum really moves.
#include "graspforce/factor.hpp"

#include <cmath>
#include <vector>

#include "allocations.hpp"
#include "expect.hpp"
#include "graspforce/engine.hpp"
#include "random_grasp.hpp"

using namespace graspforce;
using Real = long double;
using Rows = std::vector<std::vector<Real>>;

// The Hessian of Phi at c, Eq. (7), (13) and (14), from the problem's numbers alone; ones on the
// diagonal for contacts out of the grasp.
static Rows dense_hessian(const Layout& layout, const Problem& p, const std::vector<double>& c) {
  const int m = layout.components();
  Rows H(m, std::vector<Real>(m));
  std::vector<bool> present(m);
  for (int i = 0; i < layout.contacts(); ++i) {
    const int first = layout.first(i), dim = static_cast<int>(layout.models[i]);
    const Real mu = p.mu[i], torsion = mu / p.gamma[i];
    const Real D[4] = {mu * mu, -1, -1, -torsion * torsion};
    const Real weight = layout.cone_weights ? p.cone_weight[i] : 1;
    Real radius = 0, slope[4];
    for (int a = 0; a < dim; ++a) present[first + a] = p.in_grasp(i);
    if (!p.in_grasp(i)) continue;
    for (int a = 1; a < dim; ++a) radius -= D[a] * c[first + a] * c[first + a];
    radius = std::sqrt(radius);
    const Real loaded = c[first] + (layout.pulls ? Real(p.engagement[i]) * p.pull[i] : 0);
    const Real q = (mu * loaded - radius) * (mu * loaded + radius);
    for (int a = 0; a < dim; ++a) slope[a] = 2 * D[a] * (a == 0 ? loaded : c[first + a]);
    for (int a = 0; a < dim; ++a)
      for (int b = 0; b < dim; ++b)
        H[first + a][first + b] +=
            weight * (slope[a] * slope[b] / (q * q) - (a == b ? 2 * D[a] / q : 0));
  }
  auto add = [&](auto entry, Real slack) {
    for (int a = 0; a < m; ++a)
      for (int b = 0; b < m; ++b)
        if (present[a] && present[b]) H[a][b] += *p.alpha * entry(a) * entry(b) / (slack * slack);
  };
  auto along = [&](auto entry) {
    Real sum = 0;
    for (int a = 0; a < m; ++a)
      if (present[a]) sum += entry(a) * c[a];
    return sum;
  };
  for (int j = 0; j < layout.joints; ++j) {
    auto entry = [&](int a) { return Real(p.J[a * layout.joints + j]); };
    add(entry, p.tau_hi[j] - along(entry) - p.tau_bias[j]);
    add(entry, along(entry) + p.tau_bias[j] - p.tau_lo[j]);
  }
  for (int r = 0; r < layout.inequalities; ++r) {
    auto entry = [&](int a) { return Real(p.A[r * m + a]); };
    add(entry, p.b[r] - along(entry));
  }
  for (int i = 0; i < layout.contacts(); ++i) {
    const int normal = layout.first(i);
    auto entry = [&](int a) { return Real(a == normal); };
    if (!p.in_grasp(i)) continue;
    if (layout.ceilings) add(entry, Real(p.engagement[i]) * p.c_max[i] - c[normal]);
    if (layout.floors) add(entry, c[normal] - Real(p.engagement[i]) * p.c_min[i]);
  }
  for (int a = 0; layout.rate_limits && a < m; ++a) {
    auto entry = [&](int b) { return Real(a == b); };
    add(entry, Real(p.c_last[a]) + p.dc_max[a] - c[a]);
    add(entry, c[a] - Real(p.c_last[a]) + p.dc_max[a]);
  }
  for (int a = 0; a < m; ++a)
    if (!present[a]) H[a][a] = 1;
  return H;
}

// Rows of W that do not depend on those before them, columns of contacts out of the grasp zero; the
// soft ones, which nothing makes dependent, among them. `softness` gets that of each.
static Rows independent_rows(const Layout& layout, const Problem& p, std::vector<Real>& softness) {
  const int m = layout.components();
  Rows rows, basis;
  for (int r = 0; r < layout.wrench_rows; ++r) {
    std::vector<Real> row(m);
    for (int i = 0; i < layout.contacts(); ++i)
      for (int a = layout.first(i); a < layout.first(i) + int(layout.models[i]); ++a)
        row[a] = p.in_grasp(i) ? p.W[r * m + a] : 0;
    auto product = [&](const std::vector<Real>& x, const std::vector<Real>& y) {
      Real sum = 0;
      for (int a = 0; a < m; ++a) sum += x[a] * y[a];
      return sum;
    };
    const std::vector<Real> whole = row;
    if (layout.soft_wrench && p.f_soft[r] > 0) {
      rows.push_back(whole);
      softness.push_back(p.f_soft[r]);
      continue;
    }
    const Real before = product(row, row);
    for (int pass = 0; pass < 2; ++pass)
      for (const std::vector<Real>& unit : basis) {
        const Real share = product(row, unit);
        for (int a = 0; a < m; ++a) row[a] -= share * unit[a];
      }
    const Real left = product(row, row);
    if (!(left > 1e-16L * before)) continue;
    for (Real& entry : row) entry /= std::sqrt(left);
    basis.push_back(row);
    rows.push_back(whole);
    softness.push_back(0);
  }
  return rows;
}

// x of K x = y by Gaussian elimination with complete pivoting, after scaling K by its diagonal.
static std::vector<Real> eliminate(Rows K, std::vector<Real> y, int m) {
  const int n = static_cast<int>(K.size());
  std::vector<Real> scale(n, 1), x(n);
  for (int i = 0; i < m; ++i) scale[i] = 1 / std::sqrt(K[i][i]);
  for (int i = m; i < n; ++i) {
    Real sum = std::abs(K[i][i]);  // all that there is of a row of zeros with a softness
    for (int j = 0; j < m; ++j) sum += std::pow(K[i][j] * scale[j], 2);
    scale[i] = 1 / std::sqrt(sum);
  }
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) K[i][j] *= scale[i] * scale[j];
    y[i] *= scale[i];
  }
  std::vector<int> column(n);
  for (int i = 0; i < n; ++i) column[i] = i;
  for (int s = 0; s < n; ++s) {
    int row = s, best = s;
    for (int i = s; i < n; ++i)
      for (int j = s; j < n; ++j)
        if (std::abs(K[i][j]) > std::abs(K[row][best])) row = i, best = j;
    std::swap(K[s], K[row]), std::swap(y[s], y[row]), std::swap(column[s], column[best]);
    for (int i = 0; i < n; ++i) std::swap(K[i][s], K[i][best]);
    for (int i = s + 1; i < n; ++i) {
      const Real factor = K[i][s] / K[s][s];
      for (int j = s; j < n; ++j) K[i][j] -= factor * K[s][j];
      y[i] -= factor * y[s];
    }
  }
  for (int s = n - 1; s >= 0; --s) {
    Real sum = y[s];
    for (int j = s + 1; j < n; ++j) sum -= K[s][j] * x[column[j]];
    x[column[s]] = sum / K[s][s];
  }
  for (int i = 0; i < n; ++i) x[i] *= scale[i];
  return x;
}

static double largest(const std::vector<Real>& x) {
  Real most = 0;
  for (Real each : x)
    if (!(std::abs(each) <= most)) most = std::abs(each);  // NaN stays
  return double(most);
}

// Two different right-hand sides side by side, g and r = W d of a d at random.
static void solutions_are_those_of_elimination() {
  Random random(11);
  int compared = 0, deficient = 0, limited = 0, coupled = 0, gone = 0, many_rows = 0, soft = 0;
  std::vector<double> apart;
  for (int trial = 0; trial < 1500; ++trial) {
    Layout layout = random_layout(random, 6);
    layout.internals = 0;  // of which the matrix below knows nothing
    if (random.chance(0.1)) layout.wrench_rows = 3 + random.below(5);
    RandomGrasp grasp(random, layout);
    const bool couple = random.chance(0.3);
    if (couple) grasp.couple(random);
    if (random.chance(0.2)) grasp.flatten();
    const bool leaves = layout.ceilings && layout.contacts() > 2 && random.chance(0.2);
    if (leaves) grasp.data.engagement[random.below(layout.contacts())] = 0;
    grasp.wish(random, 0.2);
    Engine engine(layout);
    if (engine.solve(grasp.data.packed(), Settings{}).status != Status::Solved) continue;
    const int m = layout.components(), k = layout.wrench_rows;
    const std::vector<double> c(engine.forces(), engine.forces() + m);
    const Problem problem(layout, grasp.data.packed());
    std::vector<Real> softness;
    const Rows W = independent_rows(layout, problem, softness);
    const int independent = static_cast<int>(W.size());
    Factor factor(layout);
    const long before = allocations;
    EXPECT(factor.at(grasp.data.packed(), c.data()));
    std::vector<double> rhs((m + k) * 2), x;
    EXPECT(allocations == before + 1);  // rhs
    for (int column = 0; column < 2; ++column) {
      std::vector<double> d(m);
      for (int a = 0; a < m; ++a) d[a] = random.normal(), rhs[2 * a + column] = random.normal();
      for (int i = 0; i < layout.contacts(); ++i)
        for (int a = layout.first(i); a < layout.first(i) + int(layout.models[i]); ++a)
          for (int r = 0; r < k && problem.in_grasp(i); ++r)
            rhs[2 * (m + r) + column] += problem.W[r * m + a] * d[a];
    }
    x = rhs;
    const long between = allocations;
    factor.solve(x.data(), 2);
    EXPECT(allocations == between);

    // Elimination, for the rows that are independent.
    const Rows H = dense_hessian(layout, problem, c);
    Rows K(m + independent, std::vector<Real>(m + independent));
    for (int a = 0; a < m; ++a) std::copy(H[a].begin(), H[a].end(), K[a].begin());
    for (int r = 0; r < independent; ++r)
      for (int a = 0; a < m; ++a) K[m + r][a] = K[a][m + r] = W[r][a];
    for (int r = 0; r < independent; ++r) K[m + r][m + r] = -softness[r] * softness[r];
    for (int column = 0; column < 2; ++column) {
      std::vector<Real> y(m + independent), off(m), push(m), push_off(m);
      for (int i = 0; i < layout.contacts(); ++i)
        for (int a = layout.first(i); a < layout.first(i) + int(layout.models[i]); ++a)
          y[a] = problem.in_grasp(i) ? rhs[2 * a + column] : 0;
      for (int r = 0, next = 0; next < independent; ++r) {
        bool same = true;
        for (int i = 0; i < layout.contacts(); ++i)
          for (int a = layout.first(i); a < layout.first(i) + int(layout.models[i]); ++a)
            same &= W[next][a] == (problem.in_grasp(i) ? Real(problem.W[r * m + a]) : 0);
        if (same) y[m + next++] = rhs[2 * (m + r) + column];
      }
      const std::vector<Real> expected = eliminate(K, y, m);
      // ν alone is not unique where rows depend on each other, Wᵀ ν is.
      for (int a = 0; a < m; ++a) {
        off[a] = x[2 * a + column] - expected[a];
        for (int r = 0; r < independent; ++r) push[a] += W[r][a] * expected[m + r];
        push_off[a] = -push[a];
        for (int r = 0; r < k; ++r)
          if (H[a][a] != 1) push_off[a] += Real(problem.W[r * m + a]) * x[2 * (m + r) + column];
      }
      const std::vector<Real> d(expected.begin(), expected.begin() + m);
      apart.push_back(largest(off) / largest(d));
      apart.push_back(largest(push_off) / largest(push));
      EXPECT(apart[apart.size() - 2] <= 1e-9 && apart.back() <= 1e-9);
    }
    ++compared;
    deficient += independent < k;
    limited += layout.rate_limits;
    soft += layout.soft_wrench;
    coupled += couple && layout.joints > 0;
    gone += leaves;
    many_rows += k > 6;
  }
  std::sort(apart.begin(), apart.end());
  std::printf("%d systems, 99 of 100 within %.1e, all within %.1e\n", compared,
              apart[apart.size() * 99 / 100], apart.back());
  EXPECT(apart[apart.size() * 99 / 100] <= 1e-12);
  for (int count : {deficient, limited, coupled, gone, many_rows, soft}) EXPECT(count > 20);
}

// The optimum's change with f by central differences.
static void the_optimum_moves_as_the_system_says() {
  Random random(12);
  int compared = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Layout layout = random_layout(random, 5);
    RandomGrasp grasp(random, layout);
    grasp.data.alpha = 5;
    const int m = force_count(layout), k = layout.wrench_rows;
    const Settings exact{1e-20, 200};
    Engine engine(layout);
    if (engine.solve(grasp.data.packed(), exact).status != Status::Solved) continue;
    Factor factor(layout);
    const std::vector<double> c(engine.forces(), engine.forces() + m);
    const std::vector<double> nu(engine.multipliers(), engine.multipliers() + k);
    EXPECT(factor.at(grasp.data.packed(), c.data()));
    std::vector<double> x(m + k), change(m + k), f(grasp.data.f.begin(), grasp.data.f.end());
    for (int a = 0; a < layout.components(); ++a) {
      const double push = random.normal();
      for (int r = 0; r < k; ++r) x[m + r] += grasp.data.W(r, a) * push;
    }
    const std::vector<double> df(x.begin() + m, x.end());
    const double step = 1e-4;
    bool solved = true;
    for (int sign : {1, -1}) {
      for (int r = 0; r < k; ++r) grasp.data.f[r] = f[r] + sign * step * df[r];
      solved &= engine.solve(grasp.data.packed(), exact, c.data()).status == Status::Solved;
      for (int a = 0; a < m; ++a) change[a] += sign * engine.forces()[a] / (2 * step);
      for (int r = 0; r < k; ++r) change[m + r] -= sign * engine.multipliers()[r] / (2 * step);
    }
    if (!solved) continue;
    ++compared;
    factor.solve(x.data(), 1);
    double forces = 0, multipliers = 0, most = 0, most_nu = 0;
    for (int i = 0; i < m + k; ++i) {
      (i < m ? forces : multipliers) =
          std::max(i < m ? forces : multipliers, std::abs(x[i] - change[i]));
      (i < m ? most : most_nu) = std::max(i < m ? most : most_nu, std::abs(x[i]));
    }
    EXPECT(forces <= 1e-3 * most);
    if (layout.contacts() > 2) EXPECT(multipliers <= 1e-3 * most_nu);
  }
  EXPECT(compared > 100);
}

static void outside_the_limits_there_is_nothing_to_factor() {
  Random random(13);
  Layout layout;
  layout.models.assign(3, Model::PCWF);
  layout.ceilings = true;
  RandomGrasp grasp(random, layout);
  Factor factor(layout);
  std::vector<double> c(9);
  for (int i = 0; i < 3; ++i) c[3 * i] = 1;
  EXPECT(factor.at(grasp.data.packed(), c.data()));
  c[1] = 2;  // slips
  EXPECT(!factor.at(grasp.data.packed(), c.data()));
  c[1] = 0, c[3] = 100;  // above its ceiling
  EXPECT(!factor.at(grasp.data.packed(), c.data()));
  grasp.data.engagement[1] = 0;  // it does not count any more
  EXPECT(factor.at(grasp.data.packed(), c.data()));
  for (double& share : grasp.data.engagement) share = 0;
  EXPECT(factor.at(grasp.data.packed(), c.data()));
  std::vector<double> x(15, 1.0);
  factor.solve(x.data(), 1);
  for (double each : x) EXPECT(each == 0);
}

int main() {
  solutions_are_those_of_elimination();
  the_optimum_moves_as_the_system_says();
  outside_the_limits_there_is_nothing_to_factor();
  return verdict("factor");
}
