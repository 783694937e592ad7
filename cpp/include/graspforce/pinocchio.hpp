// A grasp read from a Pinocchio model's data in every tick of a loop, and what touches.
//
//     PinocchioGrasp grasp(model, {{"index_tip"}, {"thumb_tip"}});
//     Servo servo(grasp.layout());
//     grasp.limits(servo.tau_lo, servo.tau_hi);
//     …
//     pinocchio::computeJointJacobians(model, data, q);
//     pinocchio::nonLinearEffects(model, data, q, v);
//     grasp.update(data, touches, object, dt);       // world axes of the model
//     grasp.write(servo);                            // W, J, tau_bias, engagement, mu, gamma
//     servo.tick();
//
// The same numbers as graspforce.hands.PinocchioGrasp and control.ContactBook in Python. After the
// constructor nothing allocates or throws. Joints of one degree of freedom have motors, but for
// those that follow others; those of more, as a floating base, are taken as held. Of joints at
// their stops nothing is known here.
#pragma once

#if __has_include(<pinocchio/multibody.hpp>)
#include <pinocchio/multibody.hpp>
#else
#include <pinocchio/multibody/data.hpp>
#include <pinocchio/multibody/model.hpp>
#endif

#include "graspforce/robot_grasp.hpp"

namespace graspforce {

class PinocchioGrasp : public RobotGrasp {
 public:
  // A frame of the model that touches the object; a Touch names it by its place in the list.
  struct Link {
    std::string frame;
    int slots = 1;  // contacts that it may have at once
    Model model = Model::PCWF;
    double mu = 0.5, gamma = 0.005;
  };
  // A joint that follows another, as URDFs say and Pinocchio's models, built without it, do not.
  struct Mimic {
    std::string joint, leader;
    double multiplier = 1;
  };
  struct Options {
    ContactBook::Options book;
    std::vector<Mimic> mimics;
  };

  // Throws std::invalid_argument: a name that is not there, links that no motor moves, a joint
  // without a torque limit, a model that has its mimic joints built in.
  PinocchioGrasp(const pinocchio::Model& model, const std::vector<Link>& links)
      : PinocchioGrasp(model, links, Options()) {}
  PinocchioGrasp(const pinocchio::Model& model, const std::vector<Link>& links,
                 const Options& options)
      : PinocchioGrasp(Opening(model, links, options)) {}

  // Reads the data, after computeJointJacobians and nonLinearEffects (or computeAllTerms), and what
  // touches, dt after the last update [s]. Torques are about the object's position. False, and
  // problem() says why, where it makes no grasp: keep the last torques then.
  bool update(const pinocchio::Data& data, Span<const Touch> touches, const ObjectPose& object,
              double dt) {
    if (!book_.update(touches, dt, object)) {
      problem_ = "numbers that are not finite, or a dt that is not above 0";
      return false;
    }
    origin_ = object.position;
    for (std::size_t i = 0; i < dofs_.size(); ++i) {
      const auto motion = data.J.col(dofs_[i]);  // linear at the world's origin, angular
      const Vector3 angular{motion[3], motion[4], motion[5]};
      screws_[i] = seen_from(origin_, {motion[0], motion[1], motion[2]}, angular);
      bias_[i] = data.nle[dofs_[i]];
    }
    return true;
  }
  const char* problem() const { return problem_; }

  // Writes the model's torque limits.
  void limits(const Span<double>& low, const Span<double>& high) const {
    std::copy(low_.begin(), low_.end(), low.begin());
    std::copy(high_.begin(), high_.end(), high.begin());
  }

  // The place of each motor's joint in q̇, in the order of joints().
  const std::vector<int>& places() const { return motors_; }

 private:
  [[noreturn]] static void refuse(const std::string& what) { throw std::invalid_argument(what); }

  struct Opening {
    std::vector<ContactBook::Slots> slots;
    std::vector<Model> models;
    std::vector<Friction> friction;
    std::vector<std::string> joints;
    std::vector<int> dofs, motors;
    std::vector<double> acting, couplings, drives, low, high;
    ContactBook::Options book;

    Opening(const pinocchio::Model& model, const std::vector<Link>& links, const Options& options)
        : book(options.book) {
      if (!model.mimicking_joints.empty())
        refuse(
            "model: got one built with mimic joints, expected it built without, and "
            "Options::mimics");
      std::vector<std::vector<char>> above;  // of each link, which joints carry it
      std::vector<char> chosen(model.nv, false), follows(model.nv, false);
      for (std::size_t i = 0; i < links.size(); ++i) {
        if (!model.existFrame(links[i].frame))
          refuse("links: got '" + links[i].frame + "', expected the name of a frame");
        std::vector<char> moving(model.nv, false);
        const auto& frame = model.frames[model.getFrameId(links[i].frame)];
        for (const auto joint : model.supports[frame.parentJoint])
          if (model.nvs[joint] == 1) moving[model.idx_vs[joint]] = true;
        above.push_back(moving);
        slots.push_back({static_cast<int>(i), links[i].slots});
        for (int dof = 0; dof < model.nv; ++dof) chosen[dof] = chosen[dof] || moving[dof];
      }
      for (std::size_t pass = 0; pass < options.mimics.size(); ++pass)
        for (const Mimic& each : options.mimics) {
          const int joint = place(model, each.joint), leader = place(model, each.leader);
          follows[joint] = true;
          chosen[joint] = chosen[leader] = chosen[joint] || chosen[leader];
        }
      for (int dof = 0; dof < model.nv; ++dof)
        if (chosen[dof]) dofs.push_back(dof);
      for (std::size_t i = 0; i < links.size(); ++i)
        for (int slot = 0; slot < links[i].slots; ++slot) {
          models.push_back(links[i].model);
          friction.push_back({links[i].model == Model::FPC ? 1 : links[i].mu, links[i].gamma});
          for (int dof : dofs) acting.push_back(above[i][dof]);
        }
      for (int joint = 1; joint < model.njoints; ++joint) {
        const int dof = model.idx_vs[joint];
        if (model.nvs[joint] == 1 && chosen[dof] && !follows[dof]) add_motor(model, joint);
      }
      if (joints.empty()) refuse("links: got some that no motor moves, expected a finger's");
      for (const Mimic& each : options.mimics)
        if (chosen[place(model, each.joint)])
          for (int dof : dofs)
            couplings.push_back(dof == place(model, each.joint)    ? 1
                                : dof == place(model, each.leader) ? -each.multiplier
                                                                   : 0);
    }

    static int place(const pinocchio::Model& model, const std::string& joint) {
      if (!model.existJointName(joint) || model.nvs[model.getJointId(joint)] != 1)
        refuse("mimics: got '" + joint + "', expected a joint of one degree of freedom");
      return model.idx_vs[model.getJointId(joint)];
    }

    void add_motor(const pinocchio::Model& model, int joint) {
      const int dof = model.idx_vs[joint];
      const double least = model.lowerEffortLimit[dof], most = model.upperEffortLimit[dof];
      // Pinocchio has its largest number where a file has none.
      if (!(least < most && std::max(-least, most) < 1e300))
        refuse("'" + model.names[joint] + "': got no torque limit, expected one");
      joints.push_back(model.names[joint]);
      motors.push_back(dof);
      low.push_back(least);
      high.push_back(most);
      for (int each : dofs) drives.push_back(each == dof);
    }
  };

  explicit PinocchioGrasp(const Opening& found)
      : RobotGrasp(ContactBook(found.slots, found.book), found.models, found.joints,
                   static_cast<int>(found.dofs.size()),
                   static_cast<int>(found.couplings.size() / found.dofs.size())),
        dofs_(found.dofs),
        motors_(found.motors),
        low_(found.low),
        high_(found.high) {
    friction_ = found.friction;
    acting_ = found.acting;
    const int ties = static_cast<int>(found.couplings.size() / dofs_.size());
    if (!transmission_.update(found.couplings.data(), ties, found.drives.data()))
      refuse("mimics: got joints that hold a motor still, expected one leader for each");
    most_free_ = transmission_.free();
  }

  std::vector<int> dofs_, motors_;
  std::vector<double> low_, high_;
  const char* problem_ = "";
};

}  // namespace graspforce
