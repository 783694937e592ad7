// What a robot's numbers become in every tick: rows of its joints, maps of its contacts, motions.
#pragma once

#include <cmath>
#include <vector>

#include "arrays.hpp"
#include "graspforce/feed_forward.hpp"
#include "graspforce/linkages.hpp"
#include "graspforce/transmission.hpp"

namespace graspforce {

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
  const auto require = [](bool inside) {
    if (!inside) throw nb::index_error("no such output or degree of freedom");
  };
  for (std::size_t i = 0; i < k; ++i) {
    double* const row = made.reals() + i * dofs;
    require(output[i] >= 0 && std::size_t(output[i]) < rows + dofs);
    if (std::size_t(output[i]) >= rows) {
      row[output[i] - rows] = 1 / gear[i];
      continue;
    }
    const int first = start[output[i]], end = first + length[output[i]];
    require(first >= 0 && std::size_t(std::max(first, end)) <= size);
    for (int at = first; at < end; ++at) {
      require(column[at] >= 0 && std::size_t(column[at]) < dofs);
      row[column[at]] = moment[at] / gear[i];
    }
  }
  return made.object;
}

// Whether any of the values at `places` is as low as its `low` or as high as its `high`.
inline bool any_at_end(nb::handle values, nb::handle places, nb::handle low, nb::handle high) {
  const std::size_t k = count(places), size = count(values);
  const double *const value = reals(values, {size}), *const least = reals(low, {k});
  const double* const most = reals(high, {k});
  const npy_intp* const place = indices(places, k);
  for (std::size_t i = 0; i < k; ++i) {
    if (std::size_t(place[i]) >= size) throw nb::index_error("no such value");
    if (value[place[i]] <= least[i] || value[place[i]] >= most[i]) return true;
  }
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
// drive's; None where they do not.
inline nb::object determined_motions(nb::handle drives, nb::handle couplings) {
  const std::size_t n = count(drives), k = count(drives, 1), p = count(couplings);
  const double *const drive = reals(drives, {n, k}), *const tie = reals(couplings, {p, k});
  if (n + p != k) return nb::none();
  Transmission found(static_cast<int>(k), static_cast<int>(n), static_cast<int>(p));
  if (!found.update(tie, static_cast<int>(p), drive) || found.free() > 0) return nb::none();
  const Made made({k, n});
  std::fill_n(made.reals(), k * n, 0);
  for (const Transmission::Entry& each : found.driven())
    made.reals()[each.dof * n + each.drive] = each.ratio;
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
