// The contacts that a loop counts on: matched between ticks, of a fixed number, without jumps.
//
// A simulator lists a contact only while two bodies overlap, and a tactile sensor is noisy:
// contacts flicker, change their order, come and go. A Servo wants a problem of one layout whose
// numbers change little. The book has a fixed number of slots for each link of the hand. What
// touches is matched to the slots by link and place on the object; a slot whose contact is missing
// keeps its last place for a while, and the engagement of a slot (Section III-C.3 of the paper)
// rises and falls by a ramp. The same as graspforce.control.ContactBook in Python.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "graspforce/object_state.hpp"

namespace graspforce {

// A contact as a simulator or a sensor gives it, world axes; the normal is of unit length, into the
// object.
struct Touch {
  int link = -1;  // what makes it, by the number that the slots were given for
  Vector3 point{}, normal{};
};

class ContactBook {
 public:
  struct Slots {
    int link = -1, count = 1;
  };
  // How long an engagement takes from 0 to 1 or back [s]: with ceilings c_max and forces that may
  // change by r newtons a second, c_max / r or more. How long a missing contact is believed to be
  // there [s]. How far one may have moved on the object between updates and be the same [m]. How
  // many further slots there are behind the others for contacts that come late: of links without
  // slots, or with more contacts than slots.
  struct Options {
    double ramp = 0.1, patience = 0.02, reach = 0.01;
    int spare = 0;
  };

  // The slots stand in the order of the links; a link has all of its own in one of them. Throws
  // std::invalid_argument without slots, or for a count, time or length that is not above 0.
  explicit ContactBook(const std::vector<Slots>& links) : ContactBook(links, Options()) {}
  ContactBook(const std::vector<Slots>& links, const Options& options) : options_(options) {
    for (const Slots& each : links) {
      if (each.count < 1)
        throw std::invalid_argument("slots: got " + std::to_string(each.count) + " for link " +
                                    std::to_string(each.link) + ", expected 1 or more");
      for (int i = 0; i < each.count; ++i) slots_.emplace_back().link = each.link;
    }
    own_ = size();
    if (slots_.empty()) throw std::invalid_argument("slots: got none, expected at least one link");
    for (double each : {options.ramp, options.patience, options.reach})
      if (!(each > 0 && each < std::numeric_limits<double>::infinity()))
        throw std::invalid_argument("ContactBook: got " + std::to_string(each) +
                                    ", expected a ramp, patience and reach above 0");
    if (options.spare < 0)
      throw std::invalid_argument("spare: got " + std::to_string(options.spare) +
                                  ", expected 0 or more");
    slots_.resize(slots_.size() + options.spare);
    taken_.reserve(slots_.size());
    make_room(64 + 4 * size());
  }

  int size() const { return static_cast<int>(slots_.size()); }
  // Of a spare slot that nothing has taken, −1.
  int link(int slot) const { return slots_[slot].link; }
  // Where the slot's contact is or last was, world axes [m].
  Vector3 point(int slot) const { return plus(pose_.position, pose_.to_world(slots_[slot].point)); }
  // Its normal (into the object), x and y, world axes. x turns no more than the normal does, so
  // that forces of one tick mean the same in the next.
  Matrix3 axes(int slot) const {
    const Matrix3& own = slots_[slot].axes;
    return {pose_.to_world(own[0]), pose_.to_world(own[1]), pose_.to_world(own[2])};
  }
  Vector3 normal(int slot) const { return pose_.to_world(slots_[slot].axes[0]); }
  double engagement(int slot) const { return slots_[slot].engagement; }
  // Whether something touched at the last update.
  bool present(int slot) const { return slots_[slot].missing == 0; }
  // How many contacts the last update had.
  int touches() const { return static_cast<int>(seen_.size()); }
  // The slot of its i-th; −1 without one.
  int slot_of(int touch) const { return of_touch_[touch]; }
  // How many contacts of the last update found no slot free.
  int without_slot() const { return without_slot_; }
  // As many contacts as an update takes.
  int most_touches() const { return most_touches_; }
  // Makes it take so many.
  void make_room(int touches) {
    most_touches_ = touches;
    of_touch_.reserve(touches);
    seen_.reserve(touches);
  }

  // The weights of the slots' cones: contacts of one patch share 1, as far as they are engaged.
  // Of one patch are those of a link whose normals agree, wholly up to 10° apart and not at all
  // from 30° on.
  void write_cone_weights(const Span<double>& weights) const {
    const double near = 0.984807753012208, far = 0.8660254037844387;  // cosines of these
    for (int i = 0; i < size(); ++i) {
      double count = 0;
      for (int j = 0; j < size(); ++j)
        if (link(j) == link(i)) {
          const double agree = (dot(slots_[i].axes[0], slots_[j].axes[0]) - far) / (near - far);
          count += std::clamp(agree, 0., 1.) * std::max(engagement(j), kLeast);
        }
      weights[i] = std::max(engagement(i), kLeast) / count;
    }
  }

  // Takes what touches now; contacts of links without slots are passed over, as long as there is no
  // spare one. The first update takes it as a grasp that holds: its slots are engaged at once.
  // False, with nothing changed, for too many contacts, numbers that are not finite, a normal not
  // of unit length, or a dt not above 0.
  bool update(Span<const Touch> touches, double dt, const ObjectPose& pose) {
    if (touches.size() > most_touches() || !(dt > 0) || !finite(dt)) return false;
    for (const Vector3* each :
         {&pose.position, &pose.rotation[0], &pose.rotation[1], &pose.rotation[2]})
      if (!finite(*each)) return false;
    for (const Touch& each : touches)
      if (!finite(each.point) || !(std::abs(length(each.normal) - 1) <= 1e-6)) return false;
    pose_ = pose;
    seen_.assign(touches.begin(), touches.end());
    for (Touch& each : seen_) {
      each.point = pose.to_object(minus(each.point, pose.position));
      each.normal = pose.to_object(unit(each.normal));
    }
    match();
    for (Slot& slot : slots_) slot.missing += dt;
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      if (of_touch_[i] < 0) continue;
      Slot& slot = slots_[of_touch_[i]];
      slot.missing = 0;
      slot.point = seen_[i].point;
      slot.turn(seen_[i].normal);
    }
    const double change = dt / options_.ramp;
    for (Slot& slot : slots_) {
      const bool rising = slot.missing <= options_.patience;
      slot.engagement = started_ ? std::clamp(slot.engagement + (rising ? change : -change), 0., 1.)
                                 : double(rising);
    }
    started_ = true;
    return true;
  }

 private:
  struct Slot {
    int link = -1;
    // In the object's frame. A slot that never had a contact has axes all the same.
    Vector3 point{};
    Matrix3 axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    double missing = std::numeric_limits<double>::infinity();  // for how long [s]
    double engagement = 0;

    void turn(const Vector3& normal) {
      Vector3 x = across(engagement == 0 ? any_tangent(normal) : axes[1], normal);
      if (dot(x, x) < 0.01)
        x = across(any_tangent(normal), normal);  // the normal came to lie on it
      x = unit(x);
      axes = {normal, x, cross(normal, x)};
    }
    static Vector3 across(const Vector3& v, const Vector3& normal) {
      return minus(v, times(dot(v, normal), normal));
    }
    // The coordinate axis farthest from a normal.
    static Vector3 any_tangent(const Vector3& n) {
      int least = 0;
      for (int i = 1; i < 3; ++i)
        if (std::abs(n[i]) < std::abs(n[least])) least = i;
      return {double(least == 0), double(least == 1), double(least == 2)};
    }
  };

  static constexpr double kLeast = 1e-3;  // engagement with which a contact has a weight

  static bool finite(double x) { return std::abs(x) < std::numeric_limits<double>::infinity(); }
  static bool finite(const Vector3& v) { return finite(v[0]) && finite(v[1]) && finite(v[2]); }

  // Finds each contact's slot: nearest pairs first, then free slots.
  void match() {
    of_touch_.assign(seen_.size(), -1);
    taken_.assign(slots_.size(), false);
    while (match_nearest()) {}
    // The others are new. A slot that still lets go is not taken over: its force would jump.
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      for (int j = 0; j < size() && of_touch_[i] < 0; ++j) {
        if (taken_[j] || used(slots_[j])) continue;
        if (j >= own_ || slots_[j].link == seen_[i].link) take(static_cast<int>(i), j);
      }
    }
    without_slot_ = 0;
    for (std::size_t i = 0; i < seen_.size(); ++i)
      if (of_touch_[i] < 0 && (own_ < size() || has_slots(seen_[i].link))) ++without_slot_;
  }

  // Matches the nearest pair of a contact and a slot of its link that is left; false when there is
  // none within reach.
  bool match_nearest() {
    double least = options_.reach;
    int touch = -1, slot = -1;
    for (std::size_t i = 0; i < seen_.size(); ++i) {
      if (of_touch_[i] >= 0) continue;
      for (int j = 0; j < size(); ++j) {
        if (slots_[j].link != seen_[i].link || taken_[j] || !used(slots_[j])) continue;
        const double away = length(minus(seen_[i].point, slots_[j].point));
        if (away < least || (touch < 0 && away <= least)) {
          least = away;
          touch = static_cast<int>(i);
          slot = j;
        }
      }
    }
    if (touch < 0) return false;
    take(touch, slot);
    return true;
  }

  void take(int touch, int slot) {
    of_touch_[touch] = slot;
    taken_[slot] = true;
    slots_[slot].link = seen_[touch].link;
  }
  bool has_slots(int link) const {
    return std::any_of(slots_.begin(), slots_.end(),
                       [&](const Slot& each) { return each.link == link; });
  }

  bool used(const Slot& slot) const {
    return slot.engagement > 0 || slot.missing <= options_.patience;
  }

  std::vector<Slot> slots_;
  int own_ = 0;  // the spare ones stand behind
  int most_touches_ = 0;
  Options options_;
  ObjectPose pose_;
  std::vector<Touch> seen_;  // in the object's frame
  std::vector<int> of_touch_;
  std::vector<char> taken_;
  int without_slot_ = 0;
  bool started_ = false;
};

}  // namespace graspforce
