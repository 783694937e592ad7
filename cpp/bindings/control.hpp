// What a control loop computes in every tick, of NumPy's arrays.
#pragma once

#include <initializer_list>

#include "graspforce/actuators.hpp"
#include "graspforce/contact_book.hpp"
#include "graspforce/feed_forward.hpp"
#include "graspforce/linkages.hpp"
#include "graspforce/object_law.hpp"
#include "graspforce/transmission.hpp"
#include "interpreter.hpp"

namespace graspforce {

using Shape = std::initializer_list<std::size_t>;

// The numbers of a plain array of that type and shape; null where it is another object.
template <class T>
const T* find_entries(nb::handle object, char kind, Shape shape) {
  auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
  const auto same = [](npy_intp a, std::size_t b) { return std::size_t(a) == b; };
  if (!PyArray_Check(object.ptr()) || PyArray_DESCR(array)->kind != kind ||
      PyArray_ITEMSIZE(array) != sizeof(T) || !PyArray_ISCARRAY_RO(array) ||
      !std::equal(PyArray_DIMS(array), PyArray_DIMS(array) + PyArray_NDIM(array), shape.begin(),
                  shape.end(), same))
    return nullptr;
  return static_cast<const T*>(PyArray_DATA(array));
}
template <class T>
const T* entries(nb::handle object, char kind, Shape shape) {
  const T* const found = find_entries<T>(object, kind, shape);
  if (found == nullptr) throw nb::value_error("expected a plain array of the right type and shape");
  return found;
}
inline const double* reals(nb::handle object, Shape shape) {
  return entries<double>(object, 'f', shape);
}
inline const npy_intp* indices(nb::handle object, std::size_t size) {
  return entries<npy_intp>(object, 'i', {size});
}
// Rows of plain numbers, which may stand apart, as in a list of structs.
class Rows {
 public:
  Rows(nb::handle object, std::size_t columns) {
    auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
    if (!PyArray_Check(object.ptr()) || PyArray_TYPE(array) != NPY_DOUBLE ||
        PyArray_NDIM(array) != 2 || std::size_t(PyArray_DIM(array, 1)) != columns ||
        PyArray_STRIDE(array, 1) != sizeof(double) || !PyArray_ISBEHAVED_RO(array))
      throw nb::value_error("expected rows of numbers");
    first_ = PyArray_BYTES(array);
    apart_ = PyArray_STRIDE(array, 0);
    count_ = PyArray_DIM(array, 0);
  }
  std::size_t count() const { return count_; }
  const double* operator[](std::size_t i) const {
    return reinterpret_cast<const double*>(first_ + apart_ * npy_intp(i));
  }

 private:
  const char* first_;
  npy_intp apart_;
  std::size_t count_;
};
inline Matrix matrix(double* first, std::size_t rows, std::size_t columns) {
  return {first, static_cast<int>(rows), static_cast<int>(columns)};
}
// Read, though a Matrix could be written.
inline Matrix matrix(nb::handle object, std::size_t rows, std::size_t columns) {
  return matrix(const_cast<double*>(reals(object, {rows, columns})), rows, columns);
}
inline std::size_t count(nb::handle object, int axis = 0) {
  auto* array = reinterpret_cast<PyArrayObject*>(object.ptr());
  if (!PyArray_Check(object.ptr()) || PyArray_NDIM(array) <= axis)
    throw nb::value_error("expected an array with more axes");
  return PyArray_DIM(array, axis);
}
inline Vector3 vector(const double* first) { return {first[0], first[1], first[2]}; }
inline Matrix3 matrix3(const double* first) {
  return {vector(first), vector(first + 3), vector(first + 6)};
}

using Two = std::tuple<nb::object, nb::object>;

// A new array.
struct Made {
  explicit Made(Shape shape, int type = NPY_DOUBLE)
      : object(nb::steal(PyArray_SimpleNew(
            static_cast<int>(shape.size()),
            reinterpret_cast<npy_intp*>(const_cast<std::size_t*>(shape.begin())), type))) {
    if (!object.is_valid()) nb::raise_python_error();
  }
  void* data() const { return PyArray_DATA(reinterpret_cast<PyArrayObject*>(object.ptr())); }
  double* reals() const { return static_cast<double*>(data()); }

  nb::object object;
};

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

// The core's ObjectLaw. Both functions return None where any argument is no plain array of its
// shape, and `wrench` where its numbers are not finite: Python then converts or complains.
class PythonObjectLaw {
 public:
  PythonObjectLaw(double mass, nb::handle inertia, double stiffness, double damping,
                  nb::handle turned)
      : law_{mass, matrix3(graspforce::reals(inertia, {3, 3})), stiffness, damping,
             matrix3(graspforce::reals(turned, {3, 3}))} {}

  // Of position, rotation, velocity and angular velocity, wanted and measured, and the wanted
  // accelerations.
  nb::object acceleration(nb::handle position, nb::handle rotation, nb::handle velocity,
                          nb::handle spin, nb::handle linear, nb::handle angular,
                          nb::handle position_now, nb::handle rotation_now, nb::handle velocity_now,
                          nb::handle spin_now) const {
    Plain plain;
    ObjectTarget target;
    static_cast<ObjectState&>(target) = plain.state(position, rotation, velocity, spin);
    target.acceleration = plain.vector(linear);
    target.angular_acceleration = plain.vector(angular);
    const ObjectState now = plain.state(position_now, rotation_now, velocity_now, spin_now);
    if (!plain.all) return nb::none();
    const Screw wanted = law_.acceleration(target, now);
    return six(wanted.linear, wanted.angular);
  }
  nb::object wrench(nb::handle acceleration, nb::handle rotation, nb::handle spin,
                    nb::handle gravity) const {
    Plain plain;
    const double* const wanted = find_entries<double>(acceleration, 'f', {6});
    ObjectState now;
    now.rotation = plain.matrix(rotation);
    now.angular_velocity = plain.vector(spin);
    const Vector3 weight = plain.vector(gravity);
    if (!plain.all || wanted == nullptr) return nb::none();
    const Wrench f = law_.wrench({vector(wanted), vector(wanted + 3)}, now, weight);
    // Whether all are finite: the sum is, or it overflows, and then something is wrong, too.
    const Vector3 sums = plus(f.force, f.torque);
    return std::isfinite(sums[0] + sums[1] + sums[2]) ? six(f.force, f.torque) : nb::none();
  }

 private:
  // Reads arrays as long as all of them are plain.
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
  };
  static nb::object six(const Vector3& first, const Vector3& second) {
    const Made made({6});
    std::copy_n(first.begin(), 3, made.reals());
    std::copy_n(second.begin(), 3, made.reals() + 3);
    return made.object;
  }

  ObjectLaw law_;
};

// The core's Actuators, of arrays that MuJoCo writes: the lengths and rates of all a model's
// outputs, the states and controls of all its actuators.
class PythonActuators {
 public:
  // Of n drives: their own limits, (n, 2), and how many actuators each has; of all these the places
  // of output, input and state, (k, 3), gears, gains and biases, (k, 3), the ranges of control,
  // force and x, (k, 2), how they lag, and in which times, (k, 2).
  PythonActuators(nb::handle own, const std::vector<int>& counts, nb::handle places,
                  nb::handle gears, nb::handle gains, nb::handle biases, nb::handle controls,
                  nb::handle forces, nb::handle x, const std::vector<int>& lags,
                  nb::handle times) {
    const std::size_t n = counts.size(), k = lags.size();
    const double *const limit = reals(own, {n, 2}), *const gear = reals(gears, {k});
    const npy_intp* const place = entries<npy_intp>(places, 'i', {k, 3});
    const double *const gain = reals(gains, {k, 3}), *const bias = reals(biases, {k, 3});
    const double *const control = reals(controls, {k, 2}), *const force = reals(forces, {k, 2});
    const double *const reach = reals(x, {k, 2}), *const time = reals(times, {k, 2});
    std::size_t next = 0;
    for (std::size_t i = 0; i < n; ++i) {
      actuators_.add_drive({limit[2 * i], limit[2 * i + 1]});
      for (int j = 0; j < counts[i]; ++j, ++next) {
        if (next >= k) throw nb::value_error("expected as many actuators as the drives have");
        Actuators::Actuator each;
        each.output = static_cast<int>(place[3 * next]);
        each.input = static_cast<int>(place[3 * next + 1]);
        each.state = static_cast<int>(place[3 * next + 2]);
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
    actuators_count_ = next;
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

// How joints move drives, (k, nv): the rows of MuJoCo's sparse moments at `outputs` over gears; an
// output beyond these rows stands for a degree of freedom by itself.
inline nb::object drive_rows(nb::handle moments, nb::handle counts, nb::handle starts,
                             nb::handle columns, nb::handle outputs, nb::handle gears,
                             std::size_t dofs) {
  const std::size_t k = count(outputs), rows = count(counts), size = count(moments);
  const npy_intp* const output = indices(outputs, k);
  const double *const moment = reals(moments, {size}), *const gear = reals(gears, {k});
  const auto ints = [](nb::handle object, std::size_t n) { return entries<int>(object, 'i', {n}); };
  const int *const length = ints(counts, rows), *const start = ints(starts, rows);
  const int* const column = ints(columns, size);
  const Made made({k, dofs});
  std::fill_n(made.reals(), k * dofs, 0);
  for (std::size_t i = 0; i < k; ++i) {
    double* const row = made.reals() + i * dofs;
    if (std::size_t(output[i]) >= rows)
      row[output[i] - rows] = 1 / gear[i];
    else
      for (int at = start[output[i]], end = at + length[output[i]]; at < end; ++at)
        row[column[at]] = moment[at] / gear[i];
  }
  return made.object;
}

// Whether any of the values at `places` is as low as its `low` or as high as its `high`.
inline bool any_at_end(nb::handle values, nb::handle places, nb::handle low, nb::handle high) {
  const std::size_t k = count(places);
  const double *const value = reals(values, {count(values)}), *const least = reals(low, {k});
  const double* const most = reals(high, {k});
  const npy_intp* const place = indices(places, k);
  for (std::size_t i = 0; i < k; ++i)
    if (value[place[i]] <= least[i] || value[place[i]] >= most[i]) return true;
  return false;
}

// Points, (k, 3), and axes, rows normal, x, y, (k, 3, 3), of MuJoCo's contacts at `places`; where
// `side` is −1 the normal points the other way, and y with it.
inline Two contact_axes(nb::handle points, nb::handle frames, nb::handle places, nb::handle side) {
  const Rows point(points, 3), frame(frames, 9);
  const std::size_t n = std::min(point.count(), frame.count()), k = count(places);
  const double* const way = reals(side, {k});
  const npy_intp* const place = indices(places, k);
  const Made at({k, 3}), axes({k, 3, 3});
  for (std::size_t i = 0; i < k; ++i) {
    if (std::size_t(place[i]) >= n) throw nb::index_error("no such contact");
    std::copy_n(point[place[i]], 3, at.reals() + 3 * i);
    for (int j = 0; j < 9; ++j)
      axes.reals()[9 * i + j] = (j / 3 == 1 ? 1 : way[i]) * frame[place[i]][j];
  }
  return {at.object, axes.object};
}

// The joints' screws about `origin`, (k, 6): of MuJoCo's cdof, each at the centre of its tree.
inline nb::object joint_screws(nb::handle cdof, nb::handle dofs, nb::handle centres,
                               nb::handle roots, nb::handle origin) {
  const std::size_t nv = count(cdof), k = count(dofs), bodies = count(centres);
  const double *const motion = reals(cdof, {nv, 6}), *const centre = reals(centres, {bodies, 3});
  const npy_intp *const of = indices(dofs, k), *const root = indices(roots, nv);
  const Vector3 at = vector(reals(origin, {3}));
  const Made made({k, 6});
  for (std::size_t i = 0; i < k; ++i) {
    const double* const own = motion + 6 * of[i];
    const Screw screw =
        seen_from(minus(at, vector(centre + 3 * root[of[i]])), vector(own + 3), vector(own));
    std::copy_n(screw.linear.begin(), 3, made.reals() + 6 * i);
    std::copy_n(screw.angular.begin(), 3, made.reals() + 6 * i + 3);
  }
  return made.object;
}

// W of contacts, (6, m), and the work of their components along the joints' screws, (m, k), as far
// as the joints move them: `moved`, n × nv.
inline Two contact_maps(nb::handle points, nb::handle axes, nb::handle dims, nb::handle origin,
                        nb::handle screws, nb::handle moved, nb::handle dofs) {
  const std::size_t n = count(points), k = count(dofs), nv = count(moved, 1);
  const double *const point = reals(points, {n, 3}), *const axis = reals(axes, {n, 3, 3});
  const double *const motion = reals(screws, {k, 6}), *const acting = reals(moved, {n, nv});
  const npy_intp *const dim = indices(dims, n), *const of = indices(dofs, k);
  const Vector3 at = vector(reals(origin, {3}));
  std::size_t m = 0;
  for (std::size_t i = 0; i < n; ++i) m += dim[i];
  const Made grasp_map({6, m}), done({m, k});
  const Matrix W = matrix(grasp_map.reals(), 6, m);
  double* row = done.reals();
  for (std::size_t i = 0, column = 0; i < n; ++i) {
    const Vector3 arm = minus(vector(point + 3 * i), at);
    const Matrix3 of_contact = matrix3(axis + 9 * i);
    for (int d = 0; d < dim[i]; ++d, ++column, row += k) {
      const Wrench wrench = component(d, arm, of_contact);
      write_column(W, static_cast<int>(column), wrench);
      for (std::size_t j = 0; j < k; ++j) {
        const double way = acting[i * nv + of[j]];
        const double* const own = motion + 6 * j;
        row[j] = way == 0 ? 0 : way * work(wrench, {vector(own), vector(own + 3)});
      }
    }
  }
  return {grasp_map.object, done.object};
}

// The joints and links of a simulation, whose arrays it keeps and MuJoCo writes in place.
class RobotMotion {
 public:
  // `ends`, nv × 2, are those of the joints' ranges, and `near` is from where on they near them;
  // `above` says which degrees of freedom move each body, nbody × nv. The rest is MuJoCo's.
  RobotMotion(nb::object mass_matrix, nb::object places, nb::object ends, nb::object near,
              nb::object above, nb::object roots, nb::object damping, nb::object qpos,
              nb::object qvel, nb::object subtree_com, nb::object cvel, nb::object cdof_dot)
      : kept_{mass_matrix, places, ends, near, above,       roots,
              damping,     qpos,   qvel, cvel, subtree_com, cdof_dot},
        bodies_(count(above)),
        dofs_(count(above, 1)),
        mass_(reals(mass_matrix, {dofs_, dofs_})),
        places_(indices(places, dofs_)),
        ends_(reals(ends, {dofs_, 2})),
        near_(reals(near, {dofs_})),
        above_(reals(above, {bodies_, dofs_})),
        roots_(indices(roots, bodies_)),
        damping_(reals(damping, {dofs_})),
        qpos_(reals(qpos, {count(qpos)})),
        qvel_(reals(qvel, {dofs_})),
        centres_(reals(subtree_com, {bodies_, 3})),
        cvel_(reals(cvel, {bodies_, 6})),
        cdof_dot_(reals(cdof_dot, {dofs_, 6})) {}

  // What the joints have to accelerate each contact by, (m,), for it to go along with the object,
  // which accelerates so, [linear; angular].
  nb::object follow(nb::handle points, nb::handle axes, nb::handle dims, nb::handle links,
                    nb::handle position, nb::handle spin, nb::handle acceleration) const {
    const std::size_t n = count(points);
    const double *const point = reals(points, {n, 3}), *const axis = reals(axes, {n, 3, 3});
    const npy_intp *const dim = indices(dims, n), *const link = indices(links, n);
    const double* const wanted = reals(acceleration, {6});
    const BodyMotion object{vector(reals(position, {3})),
                            {{}, vector(reals(spin, {3}))},
                            {vector(wanted), vector(wanted + 3)}};
    std::size_t m = 0;
    for (std::size_t i = 0; i < n; ++i) m += dim[i];
    const Made made({m});
    double* next = made.reals();
    for (std::size_t i = 0; i < n; next += dim[i++])
      graspforce::follow(object, motion(link[i]), vector(point + 3 * i), matrix3(axis + 9 * i),
                         static_cast<int>(dim[i]), next);
    return made.object;
  }

  // The inertia that motors move and the metric, both (n, n), of the joints' motions by the
  // motors', (k, n). Damping counts for so long [s] as if it were inertia, of the motors, too.
  Two inertia(nb::handle dofs, nb::handle driven, double time, nb::handle motor_damping) {
    const std::size_t k = count(dofs), n = count(driven, 1);
    const npy_intp* const of = indices(dofs, k);
    const double* const by_rate = reals(motor_damping, {n});
    const Matrix ratios = matrix(driven, k, n);
    joints_.resize(k * k);
    more_.resize(k);
    besides_.resize(n);
    for (std::size_t i = 0; i < k; ++i) {
      const double* const row = mass_ + dofs_ * of[i];
      for (std::size_t j = 0; j < k; ++j) joints_[i * k + j] = row[of[j]];
      const double at = qpos_[places_[of[i]]], *const range = ends_ + 2 * of[i];
      const double left = std::min(at - range[0], range[1] - at);
      more_[i] = MotorInertia::heavier(left, near_[of[i]]) * row[of[i]];
      joints_[i * (k + 1)] += time * damping_[of[i]];
    }
    for (std::size_t a = 0; a < n; ++a) {
      bool moves = false;
      for (std::size_t i = 0; i < k; ++i) moves = moves || ratios(int(i), int(a)) != 0;
      besides_[a] = moves ? time * by_rate[a] : 0;
    }
    const Made inertia({n, n}), metric({n, n});
    of_motors_.write(matrix(joints_.data(), k, k), more_.data(), ratios, besides_.data(),
                     matrix(inertia.reals(), n, n), matrix(metric.reals(), n, n));
    return {inertia.object, metric.object};
  }

 private:
  BodyMotion motion(npy_intp body) const {
    if (body < 0 || std::size_t(body) >= bodies_) throw nb::index_error("no such body");
    const double *const v = cvel_ + 6 * body, *const moved = above_ + dofs_ * body;
    double drift[6] = {};
    for (std::size_t dof = 0; dof < dofs_; ++dof)
      if (moved[dof] != 0) add_scaled(moved[dof] * qvel_[dof], cdof_dot_ + 6 * dof, 6, drift);
    // MuJoCo's are of the material that passes by the centre, whose velocity turns with the body.
    const Vector3 linear = vector(v + 3), angular = vector(v);
    return {vector(centres_ + 3 * roots_[body]),
            {linear, angular},
            {plus(vector(drift + 3), cross(angular, linear)), vector(drift)}};
  }

  nb::object kept_[12];
  std::size_t bodies_, dofs_;
  const double* mass_;
  const npy_intp* places_;
  const double *ends_, *near_, *above_;
  const npy_intp* roots_;
  const double *damping_, *qpos_, *qvel_, *centres_, *cvel_, *cdof_dot_;
  MotorInertia of_motors_;
  std::vector<double> joints_, more_, besides_;
};

// What couplings leave no joint motion along, (p, n), and by which share of its size the most open
// loop is open: each of a kind (0 a ratio, 1 a place, 2 a turn), with so many of the gradients,
// (r, n), and gaps, (r,). `turns` says which joints turn.
using RowsAndShare = std::tuple<nb::object, double>;
inline RowsAndShare linkage_rows(nb::handle turns, const std::vector<int>& kinds,
                                 const std::vector<int>& counts, nb::handle gradients,
                                 nb::handle gaps) {
  const std::size_t n = count(turns), rows = count(gradients);
  const npy_bool* const turn = entries<npy_bool>(turns, 'b', {n});
  const double *given = reals(gradients, {rows, n}), *gap = reals(gaps, {rows});
  Linkages linkages({turn, turn + n}, static_cast<int>(rows), static_cast<int>(kinds.size()));
  linkages.clear();
  std::size_t left = rows;
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    const std::size_t r = counts.at(i);
    if (r > left) throw nb::value_error("expected as many rows as the couplings have");
    left -= r;
    double squares = 0;
    for (std::size_t k = 0; k < r; ++k) squares += gap[k] * gap[k];
    const auto kind = static_cast<Linkages::Kind>(kinds[i]);
    std::copy_n(given, r * n, linkages.add(kind, static_cast<int>(r), std::sqrt(squares)));
    given += r * n;
    gap += r;
  }
  linkages.find();
  const Made made({std::size_t(linkages.count()), n});
  std::copy_n(linkages.rows(), linkages.count() * n, made.reals());
  return {made.object, linkages.open()};
}

// An orthonormal basis, (r, k), of what rows, (m, k), span, as far as it is longer than `least`.
inline nb::object span(nb::handle rows, double least) {
  const std::size_t m = count(rows), k = count(rows, 1);
  const double* const given = reals(rows, {m, k});
  std::vector<double> left(given, given + m * k);
  Basis basis(static_cast<int>(k));
  basis.add_span(matrix(left.data(), m, k), least);
  const Made made({std::size_t(basis.size()), k});
  if (basis.size() > 0) std::copy_n(basis[0], basis.size() * k, made.reals());
  return made.object;
}

// How n drives, (n, k), and couplings, (p, k), fix the motions of k joints, (k, n): those by each
// drive's; None where they do not, or not well.
inline nb::object determined_motions(nb::handle drives, nb::handle couplings) {
  const std::size_t n = count(drives), k = count(drives, 1), p = count(couplings);
  const double *const drive = reals(drives, {n, k}), *const tie = reals(couplings, {p, k});
  if (n + p != k) return nb::none();
  const auto length = [&](const double* row) {
    double squares = 0;
    for (std::size_t i = 0; i < k; ++i) squares += row[i] * row[i];
    return std::sqrt(squares);
  };
  Transmission found(static_cast<int>(k), static_cast<int>(n), static_cast<int>(p));
  if (!found.update(tie, static_cast<int>(p), drive) || found.free() > 0) return nb::none();
  const Made made({k, n});
  std::fill_n(made.reals(), k * n, 0);
  for (const Transmission::Entry& each : found.driven()) {
    // By a drive whose row is of unit length.
    if (std::abs(each.ratio) * length(drive + each.drive * k) > 1e3) return nb::none();
    made.reals()[each.dof * n + each.drive] = each.ratio;
  }
  return made.object;
}

// Of all accelerations q with J q = wanted, J (m, n), the one nearest in the metric to `wished`;
// rows may be missed: they count up to an effective mass of weight² / give.
inline nb::object nearest_motion(nb::handle metric, nb::handle J, nb::handle wanted,
                                 nb::handle weights, double give, nb::handle wished) {
  const std::size_t m = count(J), n = count(J, 1);
  const Made found({n});
  std::copy_n(reals(wished, {n}), n, found.reals());
  NearestMotion().find(matrix(metric, n, n), matrix(J, m, n), reals(wanted, {m}),
                       reals(weights, {m}), give, found.reals());
  return found.object;
}

}  // namespace graspforce
