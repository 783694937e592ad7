// Gradients of a number L by everything in a problem, from its gradients by the answer.
//
// At an optimum ∇Phi(c) = Wᵀ nu and W c = f. With (x, y) the solution of the KKT system of
// factor.hpp for the gradient of L by c, the gradient by a parameter p is that of
//
//     −x·∇Phi(c) + x·Wᵀ nu + y·(f − W c)
//
// by p with x, y, c and nu held, and beside it what L depends on p by itself. All contacts count by
// the cone g = Σ ±(w y)² of Eq. (11), all linear limits as rows a·c ≤ b. Behind c and x stand the
// internal forces of the motors, which only the torques feel.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "graspforce/lanes.hpp"
#include "graspforce/layout.hpp"

namespace graspforce {

// Gradients of L by what an answer is judged by; null where it does not depend on it.
struct AnswerGradients {
  const double *c = nullptr, *internal_forces = nullptr, *tau = nullptr, *phi = nullptr;
  const double *friction_margins = nullptr, *torque_margins = nullptr;
};

class Adjoint {
 public:
  explicit Adjoint(const Layout& layout)
      : layout_(layout),
        tau_(layout.joints),
        to_tau_(layout.joints),
        along_c_(layout.joints),
        along_x_(layout.joints),
        x_tau_(layout.joints),
        counted_(layout.joints) {}

  // The right-hand side of the KKT system, g (m + r) then r = 0 (k). Here begins a row: `to` are
  // the gradients by its answer, `out` its fields' gradients, null where nobody wants them.
  void begin(const Problem& p, const double* c, const AnswerGradients& to,
             const Fields<double*>& out, double* rhs) {
    Fields<double*> sums = out;  // W and the arms of the torques are written at once, at the end
    sums.W = sums.J = sums.internal = nullptr;
    clear(sums);
    const int m = layout_.components();
    std::fill_n(rhs, force_count(layout_) + layout_.wrench_rows, 0.0);
    if (to.c != nullptr) std::copy_n(to.c, m, rhs);
    if (to.internal_forces != nullptr) std::copy_n(to.internal_forces, layout_.internals, rhs + m);
    if (to.tau != nullptr || to.torque_margins != nullptr) add_torques(p, c, to, rhs);
    if (to.friction_margins != nullptr) add_friction_margins(p, c, to, out, rhs);
  }

  // Adds what the solution (x, y) of the system says, from the answer's c and nu.
  void end(const Problem& p, const double* c, const double* nu, const AnswerGradients& to,
           const double* x, const double* y, const Fields<double*>& out) {
    const double phi = to.phi != nullptr ? *to.phi : 0;
    // What nobody wants is not looked at. By alpha every limit counts.
    const auto wanted = [&out](auto*... fields) {
      return out.alpha != nullptr || (... || (fields != nullptr));
    };
    add_wrench(p, c, nu, phi, x, y, out);
    double alpha = 0;
    if (wanted(out.tau_lo, out.tau_hi, out.tau_bias, out.J, out.internal))
      add_torque_limits(p, c, phi, x, alpha, to, out);
    if (wanted(out.c_max, out.c_min, out.engagement)) add_normal_limits(p, c, phi, x, alpha, out);
    if (layout_.rate_limits && wanted(out.c_last, out.dc_max))
      add_rate_limits(p, c, phi, x, alpha, out);
    if (wanted(out.A, out.b)) add_inequalities(p, c, phi, x, alpha, out);
    add(out.alpha, 0, alpha);
    if (out.mu != nullptr || out.gamma != nullptr || out.cone_weight != nullptr)
      add_cones(p, c, phi, x, out);
  }

  // Zeros, for a row without an answer.
  void clear(const Fields<double*>& out) const {
    const Layout& l = layout_;
#define GRASPFORCE_CLEAR(name, type, rows, columns, ...) \
  if (out.name != nullptr) std::fill_n(out.name, std::size_t(rows) * (columns), 0.0);
    GRASPFORCE_FIELDS(GRASPFORCE_CLEAR)
#undef GRASPFORCE_CLEAR
  }

 private:
  static void add(double* to, int i, double more) {
    if (to != nullptr) to[i] += more;
  }

  // Calls work(contact, its first component, its number of components).
  template <class Work>
  void each_contact(Work work) const {
    for (int i = 0, first = 0; i < layout_.contacts(); first += int(layout_.models[i++]))
      work(i, first, int(layout_.models[i]));
  }

  // Calls work(force, its arms at the joints): the contacts' forces, then the internal ones.
  template <class Work>
  void each_force(const Problem& p, Work work) const {
    const int m = layout_.components(), joints = layout_.joints;
    for (int i = 0; i < m; ++i) work(i, p.J + std::ptrdiff_t(i) * joints);
    for (int i = 0; i < layout_.internals; ++i)
      work(m + i, p.internal + std::ptrdiff_t(i) * joints);
  }

  // Which joints' limits count: not those that feel contacts, but none in the grasp.
  void find_counted(const Problem& p) {
    std::fill(counted_.begin(), counted_.end(), true);
    bool whole = true;
    for (int i = 0; i < layout_.contacts(); ++i) whole &= p.in_grasp(i);
    if (whole) return;
    const auto mark = [&](const double* arms, bool counts) {
      for (int j = 0; j < layout_.joints; ++j)
        if (arms[j] != 0) counted_[j] = counts;
    };
    for (bool in_grasp : {false, true})
      each_contact([&](int i, int first, int dim) {
        for (int d = first; d < first + dim && p.in_grasp(i) == in_grasp; ++d)
          mark(p.J + d * layout_.joints, in_grasp);
      });
    for (int i = 0; i < layout_.internals; ++i) mark(p.internal + i * layout_.joints, true);
  }

  // The joints' torques of the forces c, and of x alone; four joints at a time, whose sums stay in
  // registers.
  void find_torques(const Problem& p, const double* c, const double* x) {
    int j = 0;
    for (; j + kLanes <= layout_.joints; j += kLanes) {
      Lanes tau = four_at(p.tau_bias + j), x_tau = {};
      each_force(p, [&](int i, const double* arms) {
        const Lanes four = four_at(arms + j);
        tau += four * c[i];
        x_tau += four * x[i];
      });
      std::memcpy(&tau_[j], &tau, sizeof tau);
      std::memcpy(&x_tau_[j], &x_tau, sizeof x_tau);
    }
    for (; j < layout_.joints; ++j) {
      tau_[j] = p.tau_bias[j];
      x_tau_[j] = 0;
      each_force(p, [&](int i, const double* arms) {
        tau_[j] += arms[j] * c[i];
        x_tau_[j] += arms[j] * x[i];
      });
    }
  }

  // The gradient of L by a torque itself, and whether the upper limit is the nearer one.
  std::pair<double, bool> by_torque(const Problem& p, const AnswerGradients& to, int j) const {
    const bool upper = p.tau_hi[j] - tau_[j] < tau_[j] - p.tau_lo[j];
    double sum = to.tau != nullptr ? to.tau[j] : 0;
    if (to.torque_margins != nullptr) sum += upper ? -to.torque_margins[j] : to.torque_margins[j];
    return {sum, upper};
  }

  // ---- what L depends on by tau and the margins -------------------------------------------------

  void add_torques(const Problem& p, const double* c, const AnswerGradients& to, double* to_c) {
    const int joints = layout_.joints;
    find_torques(p, c, c);
    for (int j = 0; j < joints; ++j) to_tau_[j] = by_torque(p, to, j).first;
    each_force(p, [&](int i, const double* arms) {
      for (int j = 0; j < joints; ++j) to_c[i] += arms[j] * to_tau_[j];
    });
  }

  // Of mu n − ‖w t‖.
  void add_friction_margins(const Problem& p, const double* c, const AnswerGradients& to,
                            const Fields<double*>& out, double* to_c) const {
    each_contact([&](int i, int first, int dim) {
      if (!p.in_grasp(i)) return;
      const double margin = to.friction_margins[i], *y = c + first, torsion = p.mu[i] / p.gamma[i];
      double squared = 0;
      for (int d = 1; d < dim; ++d) squared += weight(d, torsion) * y[d] * y[d];
      const double radius = squared > 0 ? std::sqrt(squared) : 1;
      to_c[first] += p.mu[i] * margin;
      for (int d = 1; d < dim; ++d) to_c[first + d] -= margin * weight(d, torsion) * y[d] / radius;
      if (dim == 1) return;
      add(out.mu, i, margin * y[0]);
      if (dim > 3) add_torsion(p, i, -margin / (2 * radius) * y[3] * y[3], out);
    });
  }

  // The square of what a component counts with in the radius.
  static double weight(int d, double torsion) { return d == 3 ? torsion * torsion : 1; }

  // From the gradient by (mu/gamma)².
  static void add_torsion(const Problem& p, int i, double by_square, const Fields<double*>& out) {
    const double mu = p.mu[i], gamma = p.gamma[i], square = gamma * gamma;
    add(out.mu, i, 2 * mu / square * by_square);
    add(out.gamma, i, -2 * mu * mu / (square * gamma) * by_square);
  }

  // ---- what x and y say -------------------------------------------------------------------------

  // Of x·Wᵀ nu + y·(f − W c). Phi has the gradient Wᵀ nu by c, whose own x is 0 and y is nu in the
  // exact rows; a soft row adds ½ (f_soft nu)² to Phi.
  void add_wrench(const Problem& p, const double* c, const double* nu, double phi, const double* x,
                  const double* y, const Fields<double*>& out) const {
    const int m = layout_.components();
    double* __restrict W = out.W;
    for (int r = 0; r < layout_.wrench_rows; ++r) {
      const double by_f = y[r] + phi * nu[r];
      add(out.f, r, by_f);
      for (int i = 0; i < m && out.W != nullptr; ++i) *W++ = nu[r] * x[i] - by_f * c[i];
      if (layout_.soft_wrench) add(out.f_soft, r, -p.f_soft[r] * nu[r] * (2 * y[r] + phi * nu[r]));
    }
  }

  // One row a·c ≤ b, of this slack and with this a·x: returns the gradient by b and what beside
  // −c times it the gradient by a has, in x. Adds that by alpha.
  struct Limit {
    double by_b = 0, by_a_in_x = 0;
  };
  static Limit limit(double slack, double along, double weight, double phi, double& alpha) {
    const double inverse = 1 / slack;
    alpha -= along * inverse;
    if (phi != 0) alpha -= phi * std::log(slack);
    return {weight * inverse * (along * inverse - phi), -weight * inverse};
  }

  // And what L depends on by the torques themselves.
  void add_torque_limits(const Problem& p, const double* c, double phi, const double* x,
                         double& alpha, const AnswerGradients& to, const Fields<double*>& out) {
    const int joints = layout_.joints;
    find_counted(p);
    find_torques(p, c, x);
    for (int j = 0; j < joints; ++j) {
      Limit hi, lo;
      if (counted_[j]) {
        hi = limit(p.tau_hi[j] - tau_[j], x_tau_[j], *p.alpha, phi, alpha);
        lo = limit(tau_[j] - p.tau_lo[j], -x_tau_[j], *p.alpha, phi, alpha);
      }
      const auto [torque, upper] = by_torque(p, to, j);
      const double margin = to.torque_margins != nullptr ? to.torque_margins[j] : 0;
      along_c_[j] = torque + lo.by_b - hi.by_b;
      along_x_[j] = hi.by_a_in_x - lo.by_a_in_x;
      add(out.tau_hi, j, hi.by_b + (upper ? margin : 0));
      add(out.tau_lo, j, -lo.by_b - (upper ? 0 : margin));
      add(out.tau_bias, j, along_c_[j]);
    }
    const int m = layout_.components();
    add_arms(c, x, m, out.J);
    add_arms(c + m, x + m, layout_.internals, out.internal);
  }

  // The gradient by the arms of some forces, of which these are the c and x.
  void add_arms(const double* c, const double* x, int count, double* __restrict to) const {
    if (to == nullptr) return;
    const double *const along_c = along_c_.data(), *const along_x = along_x_.data();
    for (int i = 0; i < count; ++i)
      for (int j = 0; j < layout_.joints; ++j) *to++ = along_c[j] * c[i] + along_x[j] * x[i];
  }

  void add_normal_limits(const Problem& p, const double* c, double phi, const double* x,
                         double& alpha, const Fields<double*>& out) const {
    each_contact([&](int i, int first, int) {
      if (!p.in_grasp(i)) return;
      // Where a set squeeze moves a bound away from the other, that other is what it follows.
      const double share = p.engagement[i];
      if (layout_.ceilings) {
        const double most = normal_ceiling(layout_, p, i);
        const double b = limit(most - c[first], x[first], *p.alpha, phi, alpha).by_b;
        const bool raised = most > share * p.c_max[i];
        add(raised ? out.c_min : out.c_max, i, (raised ? 1 + kSqueeze : 1) * share * b);
        add(out.engagement, i, most / share * b);
      }
      if (layout_.floors) {
        const double least = normal_floor(layout_, p, i);
        const double b = limit(c[first] - least, -x[first], *p.alpha, phi, alpha).by_b;
        const bool lowered = least < share * p.c_min[i];
        add(lowered ? out.c_max : out.c_min, i, (lowered ? kSqueeze - 1 : -1) * share * b);
        add(out.engagement, i, -least / share * b);
      }
    });
  }

  void add_rate_limits(const Problem& p, const double* c, double phi, const double* x,
                       double& alpha, const Fields<double*>& out) const {
    each_contact([&](int contact, int first, int dim) {
      for (int i = first; i < first + dim && p.in_grasp(contact); ++i) {
        const double last = p.c_last[i], most = p.dc_max[i];
        const double up = limit(last + most - c[i], x[i], *p.alpha, phi, alpha).by_b;
        const double down = limit(c[i] - last + most, -x[i], *p.alpha, phi, alpha).by_b;
        add(out.c_last, i, up - down);
        add(out.dc_max, i, up + down);
      }
    });
  }

  void add_inequalities(const Problem& p, const double* c, double phi, const double* x,
                        double& alpha, const Fields<double*>& out) const {
    const int m = layout_.components();
    for (int r = 0; r < layout_.inequalities; ++r) {
      const double* a = p.A + r * m;
      double at_c = 0, at_x = 0;
      bool touches = false, counts = false;
      each_contact([&](int contact, int first, int dim) {
        for (int i = first; i < first + dim; ++i) {
          at_c += a[i] * c[i];
          at_x += a[i] * x[i];
          touches |= a[i] != 0;
          counts |= a[i] != 0 && p.in_grasp(contact);
        }
      });
      if (touches && !counts) continue;
      const Limit row = limit(p.b[r] - at_c, at_x, *p.alpha, phi, alpha);
      add(out.b, r, row.by_b);
      for (int i = 0; i < m && out.A != nullptr; ++i)
        out.A[r * m + i] += row.by_a_in_x * x[i] - row.by_b * c[i];
    }
  }

  // Of the cones' weights times x·∇ ln g − phi ln g, for g = (mu n)² − ‖w t‖².
  void add_cones(const Problem& p, const double* c, double phi, const double* x,
                 const Fields<double*>& out) const {
    each_contact([&](int i, int first, int dim) {
      if (!p.in_grasp(i) || (dim == 1 && !layout_.cone_weights)) return;
      const double *y = c + first, *z = x + first;
      const double mu = dim == 1 ? 1 : p.mu[i], torsion = mu / p.gamma[i];
      double g = mu * mu * y[0] * y[0], q = mu * mu * y[0] * z[0];
      for (int d = 1; d < dim; ++d) {
        g -= weight(d, torsion) * y[d] * y[d];
        q -= weight(d, torsion) * y[d] * z[d];
      }
      const double over = 1 / g;
      if (layout_.cone_weights) {
        add(out.cone_weight, i, 2 * q * over - (phi != 0 ? phi * std::log(g) : 0));
        if (dim == 1) return;
      }
      const double share = layout_.cone_weights ? p.cone_weight[i] : 1;
      auto by_square = [&](int d) {
        return share * over * y[d] * (2 * z[d] - (2 * q * over + phi) * y[d]);
      };
      add(out.mu, i, 2 * mu * by_square(0));
      if (dim > 3) add_torsion(p, i, -by_square(3), out);
    });
  }

  const Layout& layout_;
  std::vector<double> tau_, to_tau_;       // joint torques; the gradient by them
  std::vector<double> along_c_, along_x_;  // of the gradient by a joint's column of J
  std::vector<double> x_tau_;              // the torques of x
  std::vector<unsigned char> counted_;     // joints
};

}  // namespace graspforce
