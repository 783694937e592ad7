// A grasp read from a MuJoCo simulation in every tick, and torques sent to its actuators.
//
//     MujocoGrasp grasp(model, data, "cube");       // fingers in contact
//     MujocoMotors motors(model, data, grasp.joints());
//     Servo servo(grasp.layout());
//     …
//     mj_step1(model, data);
//     grasp.update(data, dt);
//     grasp.write(servo);                            // W, J, tau_bias, engagement, mu, gamma
//     motors.limits(data, servo.tau_lo, servo.tau_hi);
//     servo.tick();
//     motors.write(data, tau, dt);
//     mj_step2(model, data);
//
// The same numbers as graspforce.hands.MujocoGrasp, control.ContactBook and hands.MujocoMotors in
// Python. After the constructors nothing allocates or throws. What they do not know they refuse
// with std::invalid_argument: adhesion, actuators whose force does not follow from their control,
// motors that are more than the motions that they move. Of joints at their stops nothing is known
// here.
#pragma once

#include "graspforce/linkages.hpp"
#include "graspforce/mujoco_motors.hpp"
#include "graspforce/object_law.hpp"
#include "graspforce/robot_grasp.hpp"

namespace graspforce {

// The grasp that a simulation is in. The object is a body that floats, with all that hangs on it.
class MujocoGrasp : public RobotGrasp {
 public:
  struct Options {
    ContactBook::Options book;
    // How many slots a link has at least of which a geom touches that is no ball: what touches of a
    // face comes and goes.
    int face_slots = 4;
    // Further links that may come to touch, by their bodies, with the slots of a face each.
    std::vector<std::string> further_links;
    // The coefficient of friction to count on; where 0, what the model says of each contact.
    double mu = 0;
  };

  // Slots are made for what touches now. The data have to be as mj_step1 or mj_forward leaves them.
  // Throws std::invalid_argument: nothing that a motor moves touches the object, a name that is not
  // there, a model that is not known how to hold.
  MujocoGrasp(const mjModel* model, const mjData* data, const char* object)
      : MujocoGrasp(model, data, object, Options()) {}
  MujocoGrasp(const mjModel* model, const mjData* data, const char* object, const Options& options)
      : MujocoGrasp(Opening(model, data, object, options), data) {}

  int object() const { return object_; }
  // Where the object's centre of mass is, and how it is turned.
  ObjectPose pose(const mjData* data) const {
    const mjtNum *p = data->subtree_com + 3 * object_, *R = data->xmat + 9 * object_;
    return {{p[0], p[1], p[2]}, {{{R[0], R[1], R[2]}, {R[3], R[4], R[5]}, {R[6], R[7], R[8]}}}};
  }
  // And how it moves, which MuJoCo computes when asked.
  ObjectState state(mjData* data) const {
    double velocity[6];  // angular before linear
    mj_subtreeVel(model_, data);
    mj_objectVelocity(model_, data, mjOBJ_XBODY, object_, velocity, 0);
    const mjtNum* const v = data->subtree_linvel + 3 * object_;
    return {pose(data), {v[0], v[1], v[2]}, {velocity[0], velocity[1], velocity[2]}};
  }
  // The law that moves it, of targets whose identity is how it is turned now.
  ObjectLaw law(const mjData* data) const {
    const mjtNum* const I = data->crb + 10 * object_;  // world axes: xx yy zz xy xz yz
    Matrix3 of_world{{{I[0], I[3], I[4]}, {I[3], I[1], I[5]}, {I[4], I[5], I[2]}}};
    // MuJoCo's is about the centre of mass of the whole tree.
    const double mass = model_->body_subtreemass[object_];
    const mjtNum* const root = data->subtree_com + 3 * model_->body_rootid[object_];
    const Vector3 arm = minus(pose(data).position, {root[0], root[1], root[2]});
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        of_world[i][j] -= mass * ((i == j ? dot(arm, arm) : 0) - arm[i] * arm[j]);
    const Matrix3 R = pose(data).rotation;
    const Matrix3 columns{
        {{R[0][0], R[1][0], R[2][0]}, {R[0][1], R[1][1], R[2][1]}, {R[0][2], R[1][2], R[2][2]}}};
    ObjectLaw law{mass, times_transposed(columns, times_transposed(columns, of_world))};
    law.turned = R;
    return law;
  }

  // Reads the simulation, which has to be as mj_step1 or mj_forward leaves it, dt after the last
  // update [s]. False, and problem() says why, where it makes no grasp: keep the last torques then.
  bool update(const mjData* data, double dt) {
    const ObjectPose pose = this->pose(data);
    read_contacts(data);
    if (!book_.update({touches_.data(), int(touches_.size())}, dt, pose))
      return fails("numbers that are not finite, or a dt that is not above 0");
    origin_ = pose.position;
    for (std::size_t i = 0; i < touches_.size(); ++i)
      if (const int slot = book_.slot_of(static_cast<int>(i)); slot >= 0)
        friction_[slot] = touching_[i];
    for (std::size_t i = 0; i < dofs_.size(); ++i) read_joint(data, static_cast<int>(i));
    read_couplings(data);
    read_drives(data);
    if (linkages_.open() > Linkages::kHopeless)
      return fails("a closed linkage that is open by more than a tenth of its size");
    if (!transmission_.update(linkages_.rows(), linkages_.count(), moments_.data()))
      return fails("motors that are more than the motions that they move");
    if (transmission_.free() > most_free_)
      return fails("more motions without a motor than at the start");
    return true;
  }
  const char* problem() const { return problem_; }

  // How many contacts of the last update count for nothing: of links without slots, or of loose or
  // deformable bodies.
  int left_out() const { return left_out_; }

 private:
  // What the base needs to know at its construction.
  struct Opening {
    const mjModel* model;
    Options options;
    int object = -1, top = -1;
    std::vector<char> inside;   // of each body: whether it is the object's
    std::vector<char> loose;    // whether it floats and is no robot's
    std::vector<char> moves;    // whether joints move it, relative to the object
    std::vector<double> above;  // nbody × nv: how a joint moves a body, relative to the object
    std::vector<mujoco::Drive> drives;  // those that count
    std::vector<int> dofs;
    std::vector<int> equalities;  // those between joints
    std::vector<ContactBook::Slots> slots;
    std::vector<Model> models;       // of each slot
    std::vector<Friction> friction;  // of each slot, as long as nothing has touched there
    std::vector<std::string> joints;

    Opening(const mjModel* m, const mjData* data, const char* name, const Options& given)
        : model(m), options(given) {
      object = mj_name2id(m, mjOBJ_BODY, name);
      if (object < 0) mujoco::refuse("object", "'" + std::string(name) + "'", "the name of a body");
      top = m->body_weldid[object];
      if (top == 0 || m->jnt_type[m->body_jntadr[m->body_rootid[top]]] != mjJNT_FREE)
        mujoco::refuse("object", "'" + std::string(name) + "', which does not float",
                       "a body with a free joint, or on one that has it");
      look_at_bodies();
      drives = mujoco::drives(m);
      open_slots(data);
      choose_dofs(data);
    }

    bool floats(int dof) const { return model->jnt_type[model->dof_jntid[dof]] == mjJNT_FREE; }

    void look_at_bodies() {
      const int nv = model->nv;
      inside.assign(model->nbody, false);
      loose.assign(model->nbody, false);
      moves.assign(model->nbody, false);
      above.assign(std::size_t(model->nbody) * nv, 0);
      std::vector<char> moved(std::size_t(model->nbody) * nv, false), carrying(nv, false);
      for (int body = 1; body < model->nbody; ++body) {  // a body comes after its parent
        const int parent = model->body_parentid[body];
        inside[body] = body == top || inside[parent];
        for (int dof = 0; dof < nv; ++dof)
          moved[body * nv + dof] = moved[parent * nv + dof] ||
                                   (dof >= model->body_dofadr[body] &&
                                    dof < model->body_dofadr[body] + model->body_dofnum[body]);
      }
      for (int dof = 0; dof < nv; ++dof) carrying[dof] = moved[top * nv + dof];
      for (int body = 1; body < model->nbody; ++body)
        for (int dof = 0; dof < nv; ++dof) {
          if (!moved[body * nv + dof] || floats(dof)) continue;
          const double way = !inside[body] ? 1 : carrying[dof] ? 0 : -1;
          above[std::size_t(body) * nv + dof] = way;
          moves[body] = moves[body] || way != 0;
        }
    }

    // Slots for what touches, by what makes it, in the order in which contacts are listed.
    void open_slots(const mjData* data) {
      look_for_loose(data);
      std::vector<char> face;
      const auto place = [&](int body) {
        for (std::size_t i = 0; i < slots.size(); ++i)
          if (slots[i].link == body) return i;
        slots.push_back({body, 0});
        face.push_back(false);
        return slots.size() - 1;
      };
      std::vector<Model> of_link;
      std::vector<Friction> rubs;
      for (int i = 0; i < data->ncon; ++i) {
        const Seen seen = see(model, inside, moves, data->contact[i]);
        if (seen.maker < 0 || loose[seen.maker]) continue;
        const std::size_t at = place(seen.touch.link);
        ++slots[at].count;
        const int kind = model->geom_type[seen.geom];
        face[at] = face[at] || !(kind == mjGEOM_SPHERE || kind == mjGEOM_ELLIPSOID);
        of_link.resize(slots.size());
        of_link[at] = seen.model;  // of a link's last contact
        rubs.resize(slots.size(), seen.friction);
        rubs[at].mu = std::min(rubs[at].mu, seen.friction.mu);
        rubs[at].gamma = std::min(rubs[at].gamma, seen.friction.gamma);
      }
      if (slots.empty())
        mujoco::refuse("data", "nothing that touches the object", "fingers in contact");
      for (std::size_t i = 0; i < slots.size(); ++i)
        if (face[i]) slots[i].count = std::max(slots[i].count, options.face_slots);
      for (const std::string& name : options.further_links) {
        const int body = mj_name2id(model, mjOBJ_BODY, name.c_str());
        if (body < 0) mujoco::refuse("further_links", "'" + name + "'", "names of bodies");
        const std::size_t at = place(body);
        slots[at].count = std::max(slots[at].count, options.face_slots);
        of_link.resize(slots.size(), Model::PCWF);
        rubs.resize(slots.size());
      }
      for (std::size_t i = 0; i < slots.size(); ++i) {
        models.insert(models.end(), slots[i].count, of_link[i]);
        friction.insert(friction.end(), slots[i].count, rubs[i]);
      }
    }

    // Bodies that float freely and that no motor moves, like an object on a table.
    void look_for_loose(const mjData* data) {
      std::vector<char> robot(model->nbody, false), floating(model->nbody, false);
      for (const mujoco::Drive& drive : drives) {
        const int row = model->actuator_outadr[drive.actuators[0]];
        for (int k = 0; k < data->moment_rownnz[row]; ++k)
          robot[root_of(data->moment_colind[data->moment_rowadr[row] + k])] = true;
      }
      for (int dof = 0; dof < model->nv; ++dof)
        if (floats(dof)) floating[root_of(dof)] = true;
      for (int body = 1; body < model->nbody; ++body) {
        const int root = model->body_rootid[body];
        loose[body] = floating[root] && !robot[root] && !inside[body];
      }
    }
    int root_of(int dof) const { return model->body_rootid[model->dof_bodyid[dof]]; }

    // The degrees of freedom that move what has slots, all that couplings and drives tie to them,
    // and the drives among these.
    void choose_dofs(const mjData* data) {
      const int nv = model->nv;
      std::vector<char> chosen(nv, false);
      for (const ContactBook::Slots& each : slots)
        for (int dof = 0; dof < nv; ++dof)
          if (above[std::size_t(each.link) * nv + dof] != 0) chosen[dof] = true;
      std::vector<std::vector<int>> ties;
      for (const mujoco::Drive& drive : drives) {
        const int row = model->actuator_outadr[drive.actuators[0]];
        std::vector<int> tie;
        for (int k = 0; k < data->moment_rownnz[row]; ++k)
          if (data->actuator_moment[data->moment_rowadr[row] + k] != 0)
            tie.push_back(data->moment_colind[data->moment_rowadr[row] + k]);
        for (int dof : tie)  // a limit on what the tendons there do together
          if (drive.tendon && model->jnt_actfrclimited[model->dof_jntid[dof]])
            mujoco::refuse(
                "joint '" + mujoco::name_of(model, mjOBJ_JOINT, model->dof_jntid[dof]) + "'",
                "an actuatorfrcrange, and a motor at tendon '" + drive.name(model) + "'",
                "a forcerange of the motor in its place");
        ties.push_back(tie);
      }
      for (int i = 0; i < model->neq; ++i) {
        const std::vector<int> tie = tied_by(i);
        const bool free = std::any_of(tie.begin(), tie.end(), [&](int dof) { return floats(dof); });
        if (tie.empty() || free) continue;  // what holds a mount or an object ties no joints
        ties.push_back(tie);
        equalities.push_back(i);
      }
      for (bool wider = true; wider;) {
        wider = false;
        for (const std::vector<int>& tie : ties) {
          const bool part =
              std::any_of(tie.begin(), tie.end(), [&](int dof) { return chosen[dof]; });
          for (int dof : tie) {
            wider = wider || (part && !chosen[dof]);
            chosen[dof] = chosen[dof] || part;
          }
        }
      }
      for (int dof = 0; dof < nv; ++dof)
        if (chosen[dof]) dofs.push_back(dof);
      std::vector<std::pair<int, mujoco::Drive>>
          acting;  // in the order of the joints that they move
      for (std::size_t i = 0; i < drives.size(); ++i) {
        int first = nv;
        for (int dof : ties[i])
          if (chosen[dof]) first = std::min(first, dof);
        if (first < nv) acting.push_back({first, drives[i]});
      }
      std::stable_sort(acting.begin(), acting.end(),
                       [](const auto& a, const auto& b) { return a.first < b.first; });
      drives.clear();
      for (const auto& each : acting) {
        drives.push_back(each.second);
        joints.push_back(each.second.name(model));
      }
      if (drives.empty())
        mujoco::refuse("data", "contacts that no motor moves", "something that a motor moves");
    }

    // The degrees of freedom that an equality is between.
    std::vector<int> tied_by(int equality) const {
      const int kind = model->eq_type[equality];
      const int ends[] = {model->eq_obj1id[equality], model->eq_obj2id[equality]};
      std::vector<int> tie;
      if (kind == mjEQ_CONNECT || kind == mjEQ_WELD)
        for (int dof = 0; dof < model->nv; ++dof)
          if (mujoco::ties(model, equality, dof)) tie.push_back(dof);
      for (int end : ends) {
        if (kind == mjEQ_JOINT && end >= 0) tie.push_back(model->jnt_dofadr[end]);
        for (int k = 0; kind == mjEQ_TENDON && end >= 0 && k < model->ten_J_rownnz[end]; ++k)
          tie.push_back(model->ten_J_colind[model->ten_J_rowadr[end] + k]);
      }
      return tie;
    }

    int coupling_rows() const {
      int rows = 0;
      for (int each : equalities)
        rows += model->eq_type[each] == mjEQ_WELD      ? 6
                : model->eq_type[each] == mjEQ_CONNECT ? 3
                                                       : 1;
      return rows;
    }
    std::vector<char> turns() const {
      std::vector<char> found;
      for (int dof : dofs) found.push_back(model->jnt_type[model->dof_jntid[dof]] != mjJNT_SLIDE);
      return found;
    }
  };

  // A contact of the object with something else.
  struct Seen {
    int maker = -1, geom = -1;  // what makes it; −1 where it is none of the object's
    Model model = Model::FPC;
    Touch touch;
    Friction friction;
  };

  static Seen see(const mjModel* model, const std::vector<char>& inside,
                  const std::vector<char>& moves, const mjContact& contact) {
    Seen seen;
    const int first = contact.geom[0], second = contact.geom[1];
    if (first < 0 || second < 0 || contact.exclude != 0) return seen;
    const int bodies[] = {model->geom_bodyid[first], model->geom_bodyid[second]};
    if (inside[bodies[0]] == inside[bodies[1]]) return seen;
    // MuJoCo's normal points from the first geom to the second.
    const int maker = inside[bodies[1]] ? 0 : 1;
    const double side = maker == 0 ? 1 : -1;
    seen.maker = bodies[maker];
    seen.geom = contact.geom[maker];
    // Where only the object's own joints move what touches, its own body stands for the contact.
    seen.touch.link = bodies[moves[bodies[maker]]       ? maker
                             : moves[bodies[1 - maker]] ? 1 - maker
                                                        : maker];
    for (int i = 0; i < 3; ++i) {
      seen.touch.point[i] = contact.pos[i];
      seen.touch.normal[i] = side * contact.frame[i];
    }
    // The cone that lies within MuJoCo's: of two coefficients the smaller. Its least one, which it
    // puts in place of 0, is no friction; rolling friction is not used.
    const double mu = std::min(contact.friction[0], contact.friction[1]);
    const double gamma = contact.friction[2];
    seen.model = contact.dim == 1 || mu <= mjMINMU      ? Model::FPC
                 : contact.dim == 3 || gamma <= mjMINMU ? Model::PCWF
                                                        : Model::SFC;
    seen.friction = {seen.model == Model::FPC ? 1 : mu, std::max(gamma, 1e-6)};
    return seen;
  }

  MujocoGrasp(const Opening& found, const mjData* data)
      : RobotGrasp(ContactBook(found.slots, found.options.book), found.models, found.joints,
                   static_cast<int>(found.dofs.size()), found.coupling_rows()),
        model_(found.model),
        object_(found.top),
        mu_(found.options.mu),
        inside_(found.inside),
        moves_(found.moves),
        loose_(found.loose),
        dofs_(found.dofs),
        place_(found.model->nv, -1),
        drives_(found.drives),
        is_tie_(found.model->neq, false),
        linkages_(found.turns(), found.coupling_rows(), int(found.equalities.size())),
        moments_(found.drives.size() * found.dofs.size()) {
    for (std::size_t i = 0; i < dofs_.size(); ++i) place_[dofs_[i]] = static_cast<int>(i);
    tied_.resize(model_->neq * dofs_.size());
    for (int each : found.equalities) {
      is_tie_[each] = true;
      const int kind = model_->eq_type[each];
      const bool loop = kind == mjEQ_CONNECT || kind == mjEQ_WELD;
      for (std::size_t i = 0; i < dofs_.size(); ++i)
        tied_[each * dofs_.size() + i] = !loop || mujoco::ties(model_, each, dofs_[i]);
    }
    for (int slot = 0; slot < book_.size(); ++slot)
      for (std::size_t i = 0; i < dofs_.size(); ++i)
        acting_[slot * dofs_.size() + i] =
            found.above[std::size_t(book_.link(slot)) * model_->nv + dofs_[i]];
    friction_ = found.friction;
    if (mu_ > 0)
      for (Friction& each : friction_) each.mu = mu_;
    touches_.reserve(book_.most_touches());
    touching_.reserve(book_.most_touches());
    most_free_ = static_cast<int>(dofs_.size());
    if (!update(data, model_->opt.timestep)) mujoco::refuse("data", problem_, "a grasp");
    most_free_ = transmission_.free();
  }

  bool fails(const char* why) {
    problem_ = why;
    return false;
  }

  // How active equalities between joints tie them.
  void read_couplings(const mjData* data) {
    linkages_.clear();
    for (int row = 0; row < data->ne;) {
      const int equality = data->efc_id[row];
      int end = row + 1;
      while (end < data->ne && data->efc_id[end] == equality) ++end;
      if (is_tie_[equality]) {
        const int kind = model_->eq_type[equality];
        const bool loop = kind == mjEQ_CONNECT || kind == mjEQ_WELD;
        const int place = loop ? row + 3 : end;
        read_coupling(data, equality, row, place,
                      loop ? Linkages::Kind::Place : Linkages::Kind::Ratio);
        if (place < end) read_coupling(data, equality, place, end, Linkages::Kind::Turn);
      }
      row = end;
    }
    linkages_.find();
  }
  void read_coupling(const mjData* data, int equality, int row, int end, Linkages::Kind kind) {
    const int n = static_cast<int>(dofs_.size());
    double gap = 0;
    for (int r = row; r < end; ++r) gap += data->efc_pos[r] * data->efc_pos[r];
    double* ratios = linkages_.add(kind, end - row, std::sqrt(gap));
    const char* const tied = tied_.data() + std::size_t(equality) * n;
    for (; row < end; ++row, ratios += n) {
      const auto put = [&](int dof, double value) {
        if (const int at = place_[dof]; at >= 0 && tied[at]) ratios[at] = value;
      };
      if (mj_isSparse(model_)) {
        const int first = data->efc_J_rowadr[row];
        for (int k = first; k < first + data->efc_J_rownnz[row]; ++k)
          put(data->efc_J_colind[k], data->efc_J[k]);
      } else {
        for (int dof : dofs_) put(dof, data->efc_J[row * model_->nv + dof]);
      }
    }
  }

  // How joints move the drives.
  void read_drives(const mjData* data) {
    const int n = static_cast<int>(dofs_.size());
    std::fill(moments_.begin(), moments_.end(), 0);
    for (std::size_t d = 0; d < drives_.size(); ++d) {
      const int row = model_->actuator_outadr[drives_[d].actuators[0]];
      const int first = data->moment_rowadr[row];
      const double gear = model_->actuator_gear[6 * row];
      for (int k = first; k < first + data->moment_rownnz[row]; ++k)
        if (const int at = place_[data->moment_colind[k]]; at >= 0)
          moments_[d * n + at] = data->actuator_moment[k] / gear;
    }
  }

  void read_contacts(const mjData* data) {
    touches_.clear();
    touching_.clear();
    left_out_ = 0;
    for (int i = 0; i < data->ncon; ++i) {
      const Seen seen = see(model_, inside_, moves_, data->contact[i]);
      if (seen.maker < 0) continue;
      if (loose_[seen.maker] || int(touches_.size()) >= book_.most_touches()) {
        ++left_out_;
        continue;
      }
      touches_.push_back(seen.touch);
      touching_.push_back(mu_ > 0 ? Friction{mu_, seen.friction.gamma} : seen.friction);
    }
  }

  void read_joint(const mjData* data, int i) {
    const int dof = dofs_[i];
    // MuJoCo's motion of a joint: angular and linear, at the centre of mass of its tree.
    const mjtNum* const motion = data->cdof + 6 * dof;
    const mjtNum* const centre =
        data->subtree_com + 3 * model_->body_rootid[model_->dof_bodyid[dof]];
    const Vector3 angular{motion[0], motion[1], motion[2]};
    const Vector3 arm = minus(origin_, {centre[0], centre[1], centre[2]});
    screws_[i] = seen_from(arm, {motion[3], motion[4], motion[5]}, angular);
    const bool by_motor = model_->jnt_actgravcomp[model_->dof_jntid[dof]];
    bias_[i] =
        data->qfrc_bias[dof] - data->qfrc_passive[dof] - (by_motor ? data->qfrc_gravcomp[dof] : 0);
  }

  const mjModel* model_;
  int object_;
  double mu_;
  std::vector<char> inside_, moves_, loose_;
  std::vector<int> dofs_, place_;
  std::vector<mujoco::Drive> drives_;
  // Of each equality: whether it ties joints that count, and which.
  std::vector<char> is_tie_, tied_;
  Linkages linkages_;
  std::vector<double> moments_;
  int left_out_ = 0;
  std::vector<Touch> touches_;
  std::vector<Friction> touching_;  // of these
  const char* problem_ = "";
};

}  // namespace graspforce
