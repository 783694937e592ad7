// The compiled module graspforce._core: translation between Python and the core, nothing else.
// It is built once for each instruction set, under the name GRASPFORCE_MODULE.
#include "batch.hpp"
#include "control.hpp"
#include "instruction_sets.hpp"
#include "kkt.hpp"
#include "robot.hpp"
#include "servo.hpp"
#include "solve.hpp"
#include "timing.hpp"

using namespace nb::literals;

NB_MODULE(GRASPFORCE_MODULE, module) {
  if (PyArray_ImportNumPyAPI() < 0) nb::raise_python_error();
  using graspforce::field;
  using graspforce::NumpyVector;
  using graspforce::Outcome;
  using graspforce::proof;
  using Servo = graspforce::PythonServo;
  module.doc() = "The compiled core of graspforce; see graspforce._engine.";
  graspforce::offer_solution_base(module);

  module.def("instruction_sets", &graspforce::instruction_sets,
             "Which of the modules besides _core this processor runs, the best last.");

  module.def("solve", &graspforce::solve, "solution"_a, "problem"_a, "layout"_a, "packed"_a,
             "start"_a.none(), "tol"_a, "max_steps"_a, "budget_us"_a,
             "Solves a ForceProblem; what comes back is a `solution`.");

  module.def(
      "solve_batch", &graspforce::solve_batch_of, "layout"_a, "count"_a, "fields"_a,
      "start"_a.none(), "c"_a, "nu"_a, "status"_a, "newton_steps"_a, "starts"_a, "nearest"_a,
      "decrement"_a, "violation"_a, "tol"_a, "max_steps"_a, "budget_us"_a, "threads"_a,
      nb::sig("def solve_batch(layout: object, count: int, fields: Sequence[object], start: "
              "object | None, c: object, nu: object, status: object, newton_steps: "
              "object, starts: object, nearest: object, decrement: object, violation: object, tol: "
              "float, max_steps: int, budget_us: float, threads: int) -> tuple[object, "
              "object]"),
      "Solves `count` problems of a layout, whose fields are arrays of one row each or of one "
      "that all share, into the arrays given; the infeasible rows and their certificates.");

  module.def("kkt_solve_batch", &graspforce::kkt_solve_batch, "layout"_a, "count"_a, "fields"_a,
             "c"_a, "wanted"_a, "x"_a, "threads"_a,
             nb::sig("def kkt_solve_batch(layout: object, count: int, fields: Sequence[object], c: "
                     "object, wanted: object, x: object, threads: int) -> None"),
             "kkt_solve in place for a right-hand side x, (B, m + r + k), of the rows wanted; "
             "zeros for the others and for those with forces c that are not strictly inside.");

  module.def(
      "pull_back_batch", &graspforce::pull_back_batch_of, "layout"_a, "count"_a, "fields"_a, "c"_a,
      "nu"_a, "wanted"_a, "gradients"_a, "out"_a, "threads"_a,
      nb::sig("def pull_back_batch(layout: object, count: int, fields: Sequence[object], c: "
              "object, nu: object, wanted: object, gradients: Sequence[object], out: "
              "Sequence[object], threads: int) -> None"),
      "Pulls the gradients of a number by the answers' c, internal forces, tau, Phi, margins "
      "(None: it does not depend on them) back to the fields, into `out`, in the layout's order; "
      "zeros in rows that are not wanted.");

  module.def(
      "kkt_solve", &graspforce::kkt_solve, "layout"_a, "packed"_a, "c"_a, "rhs"_a,
      "Solves H d + W.T nu = g, W d = r for every column (g, r) of rhs, shape (m + r + k, n), "
      "with the Hessian H of Phi at forces c, shape (m,), and the internal ones behind them, "
      "strictly inside every limit. "
      "Contacts out of the grasp get d = 0; dependent rows of W need r in its range and get "
      "nu = 0.");

  module.def(
      "fields",
      [](nb::handle layout) {
        nb::list fields;
        graspforce::each_field(
            graspforce::make_layout(layout), [&](const graspforce::Field& field) {
              fields.append(nb::make_tuple(field.name, field.offset, field.rows, field.columns));
            });
        return fields;
      },
      "layout"_a, nb::sig("def fields(layout: object) -> list[tuple[str, int, int, int]]"),
      "Name, place in the buffer, rows and columns of every field of a layout.");

  module.def(
      "find_flaw",
      [](nb::handle layout, nb::handle packed) -> nb::object {
        const graspforce::Layout shape = graspforce::make_layout(layout);
        const graspforce::Flaw flaw = graspforce::find_flaw(
            shape, graspforce::doubles(packed, graspforce::packed_size(shape)));
        return flaw ? graspforce::describe(flaw) : nb::none();
      },
      "layout"_a, "packed"_a,
      "The first of a problem's numbers that is not finite or out of its range: the field, the "
      "indices of the entry, what came, what was expected; or None.");

  module.def("time_ticks", &graspforce::time_ticks, "layout"_a, "packed"_a, "rounds"_a, "tol"_a,
             "max_steps"_a, "cold"_a,
             "Times of warm ticks, or of cold solves, without Python in between [ns].");

  nb::class_<Outcome>(module, "Outcome", nb::pooled())
      .def_prop_ro("status", [](const Outcome& o) { return static_cast<int>(o.result.status); })
      .def_prop_ro("newton_steps", [](const Outcome& o) { return o.result.newton_steps; })
      .def_prop_ro("decrement", [](const Outcome& o) { return o.result.decrement; })
      .def_prop_ro("violation", [](const Outcome& o) { return o.result.violation; })
      .def_prop_ro("nearest", [](const Outcome& o) { return o.result.nearest; })
      .def_prop_ro("start", [](const Outcome& o) { return static_cast<int>(o.result.start); })
      .def_prop_ro("elapsed_us", [](const Outcome& o) { return o.result.elapsed_us; })
      .def_prop_ro("c", field(&Outcome::c, &Outcome::m))
      .def_prop_ro("internal_forces", field(&Outcome::internal_forces, &Outcome::internals))
      .def_prop_ro("nu", field(&Outcome::nu, &Outcome::k))
      .def_prop_ro("y", proof(&Outcome::y, &Outcome::k))
      .def_prop_ro("z", proof(&Outcome::z, &Outcome::limits))
      .def_prop_ro("packed", [](nb::handle_t<Outcome> self) -> std::optional<NumpyVector> {
        const graspforce::Snapshot& numbers = nb::cast<const Outcome&>(self).problem;
        if (numbers == nullptr) return std::nullopt;
        return graspforce::view(self, numbers->data(), numbers->size());
      });

  using Book = graspforce::PythonContactBook;
  nb::class_<Book>(module, "ContactBook")
      .def(nb::init<const std::vector<int>&, int, double, double, double>(), "counts"_a, "spare"_a,
           "ramp"_a, "patience"_a, "reach"_a)
      .def("update", &Book::update, "points"_a, "normals"_a, "links"_a, "dt"_a, "position"_a,
           "rotation"_a)
      .def_prop_ro("links", &Book::links)
      .def_prop_ro("points", &Book::points)
      .def_prop_ro("axes", &Book::axes)
      .def_prop_ro("engagement", &Book::engagement)
      .def_prop_ro("cone_weights", &Book::cone_weights)
      .def_prop_ro("present", &Book::present)
      .def_prop_ro("slots", &Book::slots)
      .def_prop_ro("without_slot", [](const Book& book) { return book.without_slot(); });

  using Core = graspforce::Actuators;
  using Motors = graspforce::PythonActuators;
  nb::class_<Motors>(module, "Actuators")
      .def(nb::init<nb::handle, const std::vector<int>&, nb::handle, nb::handle, nb::handle,
                    nb::handle, nb::handle, nb::handle, nb::handle, const std::vector<int>&,
                    nb::handle>(),
           "own"_a, "counts"_a, "places"_a, "gears"_a, "gains"_a, "biases"_a, "controls"_a,
           "forces"_a, "x"_a, "lags"_a, "times"_a)
      .def("set_curves", &Motors::set_curves, "i"_a, "gain"_a, "bias"_a)
      .def("limits", &Motors::limits, "lengths"_a, "rates"_a, "states"_a, "controls"_a)
      .def("lengths", &Motors::each<&Core::length>, "lengths"_a, "rates"_a, "states"_a,
           "controls"_a)
      .def("rates", &Motors::each<&Core::rate>, "lengths"_a, "rates"_a, "states"_a, "controls"_a)
      .def("damping", &Motors::each<&Core::damping>, "lengths"_a, "rates"_a, "states"_a,
           "controls"_a)
      .def("send", &Motors::send, "lengths"_a, "rates"_a, "states"_a, "controls"_a, "torques"_a,
           "dt"_a, "step"_a, "at_once"_a)
      .def("torques", &Motors::torques, "lengths"_a, "rates"_a, "states"_a, "controls"_a, "dt"_a,
           "step"_a);

  using Motion = graspforce::RobotMotion;
  nb::class_<Motion>(module, "RobotMotion")
      .def(nb::init<nb::object, nb::object, nb::object, nb::object, nb::object, nb::object,
                    nb::object, nb::object, nb::object, nb::object, nb::object, nb::object>(),
           "mass_matrix"_a, "places"_a, "ends"_a, "near"_a, "above"_a, "roots"_a, "damping"_a,
           "qpos"_a, "qvel"_a, "subtree_com"_a, "cvel"_a, "cdof_dot"_a)
      .def("follow", &Motion::follow, "points"_a, "axes"_a, "dims"_a, "links"_a, "position"_a,
           "spin"_a, "acceleration"_a)
      .def("inertia", &Motion::inertia, "dofs"_a, "driven"_a, "time"_a, "motor_damping"_a);

  module.def("rotation_vector", &graspforce::rotation_vector_of, "R"_a,
             "Axis times angle of a rotation matrix.");
  module.def("object_acceleration", &graspforce::object_acceleration, "stiffness"_a, "damping"_a,
             "turned"_a, "position"_a, "rotation"_a, "velocity"_a, "spin"_a, "linear"_a,
             "angular"_a, "position_now"_a, "rotation_now"_a, "velocity_now"_a, "spin_now"_a,
             "The acceleration that brings an object to its target; None of arrays to convert.");
  module.def("object_wrench", &graspforce::object_wrench, "mass"_a, "inertia"_a, "acceleration"_a,
             "rotation"_a, "spin"_a, "gravity"_a,
             "The wrench that makes an acceleration; None of arrays to convert.");
  module.def("drive_rows", &graspforce::drive_rows, "moments"_a, "counts"_a, "starts"_a,
             "columns"_a, "outputs"_a, "gears"_a, "dofs"_a,
             "How joints move drives, (k, dofs), of MuJoCo's sparse moments.");
  module.def("any_at_end", &graspforce::any_at_end, "values"_a, "places"_a, "low"_a, "high"_a,
             "Whether any value at these places is at or beyond an end of its range.");
  module.def("contact_axes", &graspforce::contact_axes, "points"_a, "frames"_a, "places"_a,
             "side"_a, "Points and axes of MuJoCo's contacts at these places.");
  module.def("joint_screws", &graspforce::joint_screws, "cdof"_a, "dofs"_a, "centres"_a, "roots"_a,
             "origin"_a, "The joints' screws about a point, (k, 6), of MuJoCo's cdof.");
  module.def("contact_maps", &graspforce::contact_maps, "points"_a, "axes"_a, "dims"_a, "origin"_a,
             "screws"_a, "moved"_a, "dofs"_a,
             "W of contacts, (6, m), and their work along screws as far as these move them, "
             "(m, k).");
  module.def("linkage_rows", &graspforce::linkage_rows, "turns"_a, "kinds"_a, "counts"_a,
             "gradients"_a, "gaps"_a,
             "What couplings leave no joint motion along, without what is play, and by which share "
             "of its size the most open loop is open.");
  module.def("span", &graspforce::span, "rows"_a, "least"_a,
             "An orthonormal basis of what rows span, as rows.");
  module.def("determined_motions", &graspforce::determined_motions, "drives"_a, "couplings"_a,
             "The joints' motions by each drive's, where drives and couplings fix them all.");
  module.def("nearest_motion", &graspforce::nearest_motion, "metric"_a, "J"_a, "wanted"_a,
             "weights"_a, "give"_a, "wished"_a,
             "Of all accelerations q with J q = wanted, the one nearest in the metric to the one "
             "wished.");

  using Writable = nb::ndarray<nb::numpy, double, nb::ndim<1>>;
  nb::class_<Servo>(module, "Servo", nb::type_slots(graspforce::servo_slots))
      .def(nb::init<nb::object, nb::handle, double, int, double, std::vector<nb::object>,
                    nb::object, nb::object>(),
           "layout"_a, "packed"_a, "tol"_a, "max_steps"_a, "budget_us"_a, "statuses"_a, "refuse"_a,
           "solution"_a)
      .def("tick", &Servo::tick)
      .def("step_problem", &Servo::step_problem, "packed"_a, "problem"_a)
      .def("last", &Servo::last)
      .def("reset", &Servo::reset)
      .def_prop_ro("packed", &Servo::numbers_of_last_tick)
      .def_prop_ro("numbers",
                   [](nb::handle_t<Servo> self) {
                     Servo& servo = nb::cast<Servo&>(self);
                     return Writable(servo.packed(), {servo.packed_size()}, self);
                   })
      .def_prop_ro("c",
                   [](nb::handle_t<Servo> self) {
                     const graspforce::Engine& engine = nb::cast<Servo&>(self).engine();
                     return graspforce::view(self, engine.forces(), engine.layout().components());
                   })
      .def_prop_ro("internal_forces",
                   [](nb::handle_t<Servo> self) {
                     const auto forces = nb::cast<Servo&>(self).internal_forces();
                     return graspforce::view(self, forces.data(), forces.size());
                   })
      .def_prop_ro("nu", [](nb::handle_t<Servo> self) {
        const graspforce::Engine& engine = nb::cast<Servo&>(self).engine();
        return graspforce::view(self, engine.multipliers(), engine.layout().wrench_rows);
      });
}
