// What a control loop keeps from tick to tick: its contacts, its law, its motors.
#pragma once

#include <cmath>
#include <vector>

#include "arrays.hpp"
#include "graspforce/actuators.hpp"
#include "graspforce/contact_book.hpp"
#include "graspforce/object_law.hpp"

namespace graspforce {

// The core's ContactBook, of links that are numbered.
class PythonContactBook : public ContactBook {
 public:
  PythonContactBook(const std::vector<int>& counts, int spare, double ramp, double patience,
                    double reach)
      : ContactBook(in_order(counts), {ramp, patience, reach, spare}) {}

  // False, with nothing changed, when any argument is no plain array of its shape, or might not be
  // valid: Python then checks and converts.
  bool update(nb::handle points, nb::handle normals, const std::vector<int>& links, nb::handle dt,
              nb::handle position, nb::handle rotation) {
    const std::size_t k = links.size();
    const double* const point = find_entries<double>(points, 'f', {k, 3});
    const double* const normal = find_entries<double>(normals, 'f', {k, 3});
    const double* const place = find_entries<double>(position, 'f', {3});
    const double* const turned = find_entries<double>(rotation, 'f', {3, 3});
    if (!point || !normal || !place || !turned || !PyFloat_Check(dt.ptr())) return false;
    std::vector<Touch> touches(k);
    for (std::size_t i = 0; i < k; ++i)
      touches[i] = {links[i], vector(point + 3 * i), vector(normal + 3 * i)};
    if (int(k) > most_touches()) make_room(static_cast<int>(k));
    return ContactBook::update({touches.data(), int(k)}, PyFloat_AS_DOUBLE(dt.ptr()),
                               {vector(place), matrix3(turned)});
  }

  std::vector<int> links() const {
    std::vector<int> links(size());
    for (int i = 0; i < size(); ++i) links[i] = link(i);
    return links;
  }
  nb::object points() const {
    const Made made({count(), 3});
    for (int i = 0; i < size(); ++i) put(point(i), made.reals() + 3 * i);
    return made.object;
  }
  nb::object axes() const {
    const Made made({count(), 3, 3});
    for (int i = 0; i < size(); ++i) {
      const Matrix3 of_slot = ContactBook::axes(i);
      for (int d = 0; d < 3; ++d) put(of_slot[d], made.reals() + 9 * i + 3 * d);
    }
    return made.object;
  }
  nb::object engagement() const {
    const Made made({count()});
    for (int i = 0; i < size(); ++i) made.reals()[i] = ContactBook::engagement(i);
    return made.object;
  }
  nb::object cone_weights() const {
    const Made made({count()});
    write_cone_weights({made.reals(), size()});
    return made.object;
  }
  nb::object present() const {
    const Made made({count()}, NPY_BOOL);
    for (int i = 0; i < size(); ++i)
      static_cast<npy_bool*>(made.data())[i] = ContactBook::present(i);
    return made.object;
  }
  nb::object slots() const {
    const Made made({std::size_t(touches())}, NPY_INTP);
    for (int i = 0; i < touches(); ++i) static_cast<npy_intp*>(made.data())[i] = slot_of(i);
    return made.object;
  }

 private:
  static std::vector<Slots> in_order(const std::vector<int>& counts) {
    std::vector<Slots> slots;
    for (std::size_t i = 0; i < counts.size(); ++i) slots.push_back({int(i), counts[i]});
    return slots;
  }
  std::size_t count() const { return size(); }
  static void put(const Vector3& v, double* at) { std::copy(v.begin(), v.end(), at); }
};

inline nb::object rotation_vector_of(nb::handle R) {
  const Vector3 found = rotation_vector(matrix3(reals(R, {3, 3})));
  const Made made({3});
  std::copy(found.begin(), found.end(), made.reals());
  return made.object;
}

// Reads vectors and matrices as long as all of them are plain arrays.
struct Plain {
  bool all = true;

  const double* numbers(nb::handle object, Shape shape) {
    const double* const found = find_entries<double>(object, 'f', shape);
    all = all && found != nullptr;
    return found;
  }
  Vector3 vector(nb::handle object) {
    const double* const found = numbers(object, {3});
    return found ? graspforce::vector(found) : Vector3{};
  }
  Matrix3 matrix(nb::handle object) {
    const double* const found = numbers(object, {3, 3});
    return found ? matrix3(found) : Matrix3{};
  }
  ObjectState state(nb::handle position, nb::handle rotation, nb::handle velocity,
                    nb::handle spin) {
    return {{vector(position), matrix(rotation)}, vector(velocity), vector(spin)};
  }
  // The two as an array; None where not all were plain, or numbers are not finite: Python then
  // converts or complains.
  nb::object both(const Vector3& first, const Vector3& second) const {
    const Made made({6});
    std::copy_n(first.begin(), 3, made.reals());
    std::copy_n(second.begin(), 3, made.reals() + 3);
    const auto finite = [](double x) { return std::isfinite(x); };
    return all && std::all_of(made.reals(), made.reals() + 6, finite) ? made.object : nb::none();
  }
};

// ObjectLaw's acceleration, (6,), of position, rotation, velocity and angular velocity, wanted and
// measured, and the wanted accelerations.
inline nb::object object_acceleration(double stiffness, double damping, nb::handle turned,
                                      nb::handle position, nb::handle rotation, nb::handle velocity,
                                      nb::handle spin, nb::handle linear, nb::handle angular,
                                      nb::handle position_now, nb::handle rotation_now,
                                      nb::handle velocity_now, nb::handle spin_now) {
  Plain plain;
  ObjectTarget target;
  static_cast<ObjectState&>(target) = plain.state(position, rotation, velocity, spin);
  target.acceleration = plain.vector(linear);
  target.angular_acceleration = plain.vector(angular);
  const ObjectState now = plain.state(position_now, rotation_now, velocity_now, spin_now);
  const ObjectLaw law{1, {}, stiffness, damping, plain.matrix(turned)};
  const Screw wanted = law.acceleration(target, now);
  return plain.both(wanted.linear, wanted.angular);
}
// Its wrench, (6,).
inline nb::object object_wrench(double mass, nb::handle inertia, nb::handle acceleration,
                                nb::handle rotation, nb::handle spin, nb::handle gravity) {
  Plain plain;
  ObjectState now;
  now.rotation = plain.matrix(rotation);
  now.angular_velocity = plain.vector(spin);
  const Vector3 weight = plain.vector(gravity);
  const double* const six = plain.numbers(acceleration, {6});
  const Screw wanted = six ? Screw{vector(six), vector(six + 3)} : Screw{};
  const Wrench f = ObjectLaw{mass, plain.matrix(inertia)}.wrench(wanted, now, weight);
  return plain.both(f.force, f.torque);
}

// The core's Actuators, of arrays that MuJoCo writes: the lengths and rates of all a model's
// outputs, the states and controls of all its actuators.
class PythonActuators {
 public:
  // Of n drives: their own limits, (n, 2), and how many actuators each has; of all these the places
  // of output, input and state, (k, 3), gears, gains and biases, (k, 3), the ranges of control,
  // force and x, (k, 2), how they lag, and in which times, (k, 2).
  PythonActuators(nb::handle own, const std::vector<int>& counts, nb::handle places,
                  nb::handle gears, nb::handle gains, nb::handle biases, nb::handle controls,
                  nb::handle forces, nb::handle x, const std::vector<int>& lags, nb::handle times) {
    const std::size_t n = counts.size(), k = lags.size();
    const double *const limit = reals(own, {n, 2}), *const gear = reals(gears, {k});
    const npy_intp* const place = entries<npy_intp>(places, 'i', {k, 3});
    const double *const gain = reals(gains, {k, 3}), *const bias = reals(biases, {k, 3});
    const double *const control = reals(controls, {k, 2}), *const force = reals(forces, {k, 2});
    const double *const reach = reals(x, {k, 2}), *const time = reals(times, {k, 2});
    std::size_t next = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (counts[i] < 1 || next + counts[i] > k) break;
      actuators_.add_drive({limit[2 * i], limit[2 * i + 1]});
      for (int j = 0; j < counts[i]; ++j, ++next) {
        Actuators::Actuator each;
        each.output = static_cast<int>(place[3 * next]);
        each.input = static_cast<int>(place[3 * next + 1]);
        each.state = static_cast<int>(place[3 * next + 2]);
        const bool known = lags[next] >= 0 && lags[next] <= int(Actuators::Lag::Muscle);
        if (each.output < 0 || each.input < 0 || each.state < -1 || !known)
          throw nb::index_error("no such place, or no such lag");
        each.gear = gear[next];
        each.gain = affine(gain + 3 * next);
        each.bias = affine(bias + 3 * next);
        each.control = range(control + 2 * next);
        each.force = range(force + 2 * next);
        each.x = range(reach + 2 * next);
        each.lag = static_cast<Actuators::Lag>(lags[next]);
        std::copy_n(time + 2 * next, 2, each.times);
        actuators_.add(each);
        outputs_ = std::max(outputs_, std::size_t(each.output + 1));
        inputs_ = std::max(inputs_, std::size_t(each.input + 1));
        states_ = std::max(states_, std::size_t(each.state + 1));
      }
    }
    if (std::size_t(actuators_.size()) != n || next != k)
      throw nb::value_error("expected as many actuators as the drives have, each one or more");
    actuators_count_ = k;
  }

  // Gain and bias of one whose are not affine, as they are just now.
  void set_curves(std::size_t i, double gain, double bias) {
    if (i >= actuators_count_) throw nb::index_error("no such actuator");
    actuators_.actuator(static_cast<int>(i)).gain = {gain};
    actuators_.actuator(static_cast<int>(i)).bias = {bias};
  }
  Two limits(nb::handle lengths, nb::handle rates, nb::handle states, nb::handle controls) const {
    const Actuators::Numbers now = numbers(lengths, rates, states, controls);
    const Made low({count()}), high({count()});
    for (int i = 0; i < actuators_.size(); ++i) {
      const Actuators::Range each = actuators_.limits(now, i);
      low.reals()[i] = each.low;
      high.reals()[i] = each.high;
    }
    return {low.object, high.object};
  }
  template <double (Actuators::*of)(const Actuators::Numbers&, int) const>
  nb::object each(nb::handle lengths, nb::handle rates, nb::handle states,
                  nb::handle controls) const {
    const Actuators::Numbers now = numbers(lengths, rates, states, controls);
    const Made made({count()});
    for (int i = 0; i < actuators_.size(); ++i) made.reals()[i] = (actuators_.*of)(now, i);
    return made.object;
  }
  void send(nb::handle lengths, nb::handle rates, nb::handle states, nb::handle controls,
            nb::handle torques, double dt, double step, bool at_once) const {
    const Actuators::Numbers now = numbers(lengths, rates, states, controls);
    const double* const torque = reals(torques, {count()});
    for (int i = 0; i < actuators_.size(); ++i)
      actuators_.send(now, i, torque[i], {dt, step}, at_once);
  }
  nb::object torques(nb::handle lengths, nb::handle rates, nb::handle states, nb::handle controls,
                     double dt, double step) const {
    const Actuators::Numbers now = numbers(lengths, rates, states, controls);
    const Made made({count()});
    for (int i = 0; i < actuators_.size(); ++i)
      made.reals()[i] = actuators_.torque(now, i, {dt, step});
    return made.object;
  }

 private:
  static Actuators::Affine affine(const double* of) { return {of[0], of[1], of[2]}; }
  static Actuators::Range range(const double* of) { return {of[0], of[1]}; }
  std::size_t count() const { return actuators_.size(); }

  Actuators::Numbers numbers(nb::handle lengths, nb::handle rates, nb::handle states,
                             nb::handle controls) const {
    return {some(lengths, outputs_), some(rates, outputs_), writable(states, states_),
            writable(controls, inputs_)};
  }
  static const double* some(nb::handle object, std::size_t least) {
    const std::size_t size = graspforce::count(object);
    if (size < least) throw nb::value_error("expected the arrays of the model's actuators");
    return reals(object, {size});
  }
  static double* writable(nb::handle object, std::size_t least) {
    const double* const found = some(object, least);
    if (!PyArray_ISWRITEABLE(reinterpret_cast<PyArrayObject*>(object.ptr())))
      throw nb::value_error("expected arrays that can be written");
    return const_cast<double*>(found);
  }

  Actuators actuators_;
  std::size_t actuators_count_ = 0, outputs_ = 0, inputs_ = 0, states_ = 0;
};
}  // namespace graspforce
