// The grasp of a robot as fields of a problem, whatever library knows the robot: mujoco.hpp and
// pinocchio.hpp fill in where its joints are.
//
// Each joint moves by a screw, the velocity of all that it carries; what makes a contact moves by
// those screws that carry it. So W has the contacts' wrenches, and J is their work along the
// screws, taken by the transmission to the motors. Contacts stand in the slots of a ContactBook, so
// the layout stays.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

#include "graspforce/contact_book.hpp"
#include "graspforce/problem_data.hpp"
#include "graspforce/transmission.hpp"

namespace graspforce {

class RobotGrasp {
 public:
  // The layout of a problem that `write` fills: a contact for every slot, the motors of joints(),
  // and rows of W for motions that no motor moves. Ceilings, rate limits and the rest are the
  // caller's to add.
  Layout layout() const {
    Layout layout;
    layout.wrench_rows = 6 + passive_rows();
    layout.models = models_;
    layout.joints = static_cast<int>(joints_.size());
    layout.cone_weights = true;
    return layout;
  }

  // The joints and tendons with motors that move what has slots, in the order of the columns of J.
  const std::vector<std::string>& joints() const { return joints_; }
  const ContactBook& book() const { return book_; }
  // What torques are taken about: f is [force; torque about here] [m].
  const Vector3& origin() const { return origin_; }
  // Rows of W behind its six, at most: what the contact forces have to balance among themselves, as
  // no motor does. Rows that no contact loads now are 0.
  int passive_rows() const { return most_free_; }

  // Writes W, J, tau_bias, engagement, mu, gamma, cone_weight as they were read, and f behind its
  // first six. tau_bias is what the joints need for themselves: gravity, Coriolis forces, springs,
  // damping.
  void write(ProblemData& problem) {
    const int joints = static_cast<int>(joints_.size()), dofs = transmission_.dofs();
    std::fill(problem.J.entries().begin(), problem.J.entries().end(), 0);
    for (int slot = 0, first = 0; slot < book_.size(); ++slot) {
      const Vector3 arm = minus(book_.point(slot), origin_);
      const Matrix3 axes = book_.axes(slot);
      const double* const acting = acting_.data() + std::size_t(slot) * dofs;
      const int dim = static_cast<int>(models_[slot]);
      for (int d = 0; d < dim; ++d) {
        const Wrench wrench = component(d, arm, axes);
        write_column(problem.W, first + d, wrench);
        double* const done = &full_[std::size_t(first + d) * dofs];
        for (int dof = 0; dof < dofs; ++dof)
          done[dof] = acting[dof] == 0 ? 0 : acting[dof] * work(wrench, screws_[dof]);
        for (const Transmission::Entry& each : transmission_.driven())
          problem.J(first + d, each.drive) += done[each.dof] * each.ratio;
      }
      first += dim;
    }
    for (int j = 0; j < joints; ++j) problem.tau_bias[j] = 0;
    for (const Transmission::Entry& each : transmission_.driven())
      problem.tau_bias[each.drive] += each.ratio * bias_[each.dof];
    for (int slot = 0; slot < book_.size(); ++slot) {
      problem.engagement[slot] = book_.engagement(slot);
      problem.mu[slot] = friction_[slot].mu;
      problem.gamma[slot] = friction_[slot].gamma;
    }
    if (problem.cone_weight.size() > 0) book_.write_cone_weights(problem.cone_weight);
    if (most_free_ > 0) write_passive_rows(problem);
  }

 protected:
  struct Friction {
    double mu = 1, gamma = 1;
  };

  RobotGrasp(ContactBook book, std::vector<Model> models, std::vector<std::string> joints, int dofs,
             int most_couplings)
      : book_(std::move(book)),
        models_(std::move(models)),
        joints_(std::move(joints)),
        friction_(models_.size()),
        transmission_(dofs, static_cast<int>(joints_.size()), most_couplings),
        screws_(dofs),
        bias_(dofs),
        acting_(models_.size() * dofs),
        loads_(dofs),
        basis_(dofs) {
    if (book_.size() != static_cast<int>(models_.size()))
      throw std::invalid_argument(
          "book.spare: got " + std::to_string(book_.size() - static_cast<int>(models_.size())) +
          ", expected 0: which joints move a spare slot's contact is not known beforehand");
    int m = 0;
    for (Model model : models_) m += static_cast<int>(model);
    full_.resize(std::size_t(m) * dofs);
    worked_.resize(full_.size());
    spanned_.resize(full_.size());
  }
  ~RobotGrasp() = default;
  RobotGrasp(const RobotGrasp&) = delete;
  RobotGrasp& operator=(const RobotGrasp&) = delete;

  ContactBook book_;
  std::vector<Model> models_;
  std::vector<std::string> joints_;
  std::vector<Friction> friction_;  // of each slot
  Transmission transmission_;
  Vector3 origin_{};
  std::vector<Screw> screws_;
  std::vector<double> bias_;
  // How the joints move what makes each slot's contact, relative to the object: 1, 0 or −1 each.
  std::vector<double> acting_;
  int most_free_ = 0;

 private:
  // Of the motions that no motor moves, those that contacts can load: rows of work that has to be
  // what weight and springs do along them.
  void write_passive_rows(ProblemData& problem) {
    const int dofs = transmission_.dofs(), free = transmission_.free();
    const int m = static_cast<int>(full_.size()) / std::max(dofs, 1);
    double most = 0;
    for (double each : full_) most = std::max(most, std::abs(each));
    // In coordinates along the free motions.
    Matrix worked(worked_.data(), m, dofs), spanned(spanned_.data(), m, dofs);
    for (int i = 0; i < m; ++i)
      for (int k = 0; k < dofs; ++k)
        worked(i, k) = k < free ? along(&full_[std::size_t(i) * dofs], k) : 0;
    for (int k = 0; k < free; ++k) loads_[k] = -along(bias_.data(), k);
    std::copy(worked_.begin(), worked_.end(), spanned_.begin());
    basis_.clear();
    const int rows = std::min(basis_.add_span(spanned, Transmission::kRank * most), most_free_);
    for (int r = 0; r < most_free_; ++r) {
      double load = 0;
      for (int k = 0; r < rows && k < free; ++k) load += basis_[r][k] * loads_[k];
      problem.f[6 + r] = load;
      for (int i = 0; i < m; ++i) {
        double work = 0;
        for (int k = 0; r < rows && k < free; ++k) work += basis_[r][k] * worked(i, k);
        problem.W(6 + r, i) = work;
      }
    }
  }
  double along(const double* joints, int motion) const {
    const double* const free = transmission_.free(motion);
    double sum = 0;
    for (int dof = 0; dof < transmission_.dofs(); ++dof) sum += free[dof] * joints[dof];
    return sum;
  }

  std::vector<double> full_, worked_, spanned_, loads_;
  Basis basis_;
};

}  // namespace graspforce
