// What a control loop computes in every tick, of NumPy's arrays.
#pragma once

#include <initializer_list>

#include "graspforce/contact_book.hpp"
#include "graspforce/feed_forward.hpp"
#include "graspforce/linkages.hpp"
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
using Two = std::tuple<nb::object, nb::object>;
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

// What couplings leave no joint motion along, (p, n): each of a kind (0 a ratio, 1 a place, 2 a
// turn) and with its gradients, (r, n). `turns` are 1 for the joints that turn.
inline nb::object linkage_rows(const std::vector<bool>& turns, const std::vector<int>& kinds,
                               const std::vector<nb::object>& gradients) {
  const std::size_t n = turns.size();
  std::size_t rows = 0;
  for (const nb::object& each : gradients) rows += count(each);
  Linkages linkages({turns.begin(), turns.end()}, static_cast<int>(rows),
                    static_cast<int>(kinds.size()));
  linkages.clear();
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    const std::size_t r = count(gradients.at(i));
    const double* const given = reals(gradients[i], {r, n});
    double* const own = linkages.add(static_cast<Linkages::Kind>(kinds[i]), int(r), 0);
    std::copy_n(given, r * n, own);
  }
  linkages.find();
  const Made made({std::size_t(linkages.count()), n});
  std::copy_n(linkages.rows(), linkages.count() * n, made.reals());
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
