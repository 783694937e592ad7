// What the engine and Newton's loop ask of a barrier, whichever kernels it is made of: Barrier,
// OrthogonalBarrier, LaneBarrier. cpp/tests/kernels_test.cpp compares them.
#pragma once

#include <type_traits>
#include <utility>

namespace graspforce {

// A barrier holds a point c and a step d of one problem, and Phi / barrier_unit there.
//
//   point     set_forces(c), get_forces(c): forces in the problem's order; contacts out of the
//   grasp
//             are ignored and come back as zero. advance(t): c ← c + t d.
//   inside    strictly inside every cone and limit. balanced, wrench_error: how far W c = f holds.
//             runaway: the forces are out of all proportion to the limits.
//   evaluate  derivatives at c; false outside, and the derivatives are then undefined.
//   newton    from the last evaluate: the step d that also restores W c = f, and its multipliers;
//             returns the decrement λ of the whole step. newton_from_multipliers is the same step,
//             solved for the change of the last multipliers.
//   sound     false when the last step's system was nearly singular: look at the rank of W.
//   slope     ∇Phi·d with the last evaluated gradient.
//   step_limit  the largest t for which c + t d stays inside.
//   decrement_bound(λ)  after advance(1) along a step of decrement λ < 1: a bound on the decrement
//             at c, from its gradient and the step's own factors; it replaces the multipliers by
//             those that fit this gradient.
//   get_multipliers(nu)  of W c = f for Phi itself, in the problem's rows.
template <class B, class = void>
struct IsBarrier : std::false_type {};

template <class B>
struct IsBarrier<
    B, std::void_t<decltype(std::declval<B&>().set_forces(std::declval<const double*>())),
                   decltype(std::declval<const B&>().get_forces(std::declval<double*>())),
                   decltype(std::declval<const B&>().get_multipliers(std::declval<double*>())),
                   decltype(std::declval<B&>().advance(1.0))>>
    : std::bool_constant<
          std::is_same_v<decltype(std::declval<const B&>().inside()), bool> &&
          std::is_same_v<decltype(std::declval<const B&>().balanced()), bool> &&
          std::is_same_v<decltype(std::declval<const B&>().wrench_error()), double> &&
          std::is_same_v<decltype(std::declval<const B&>().runaway()), bool> &&
          std::is_same_v<decltype(std::declval<B&>().evaluate()), bool> &&
          std::is_same_v<decltype(std::declval<B&>().newton()), double> &&
          std::is_same_v<decltype(std::declval<B&>().newton_from_multipliers()), double> &&
          std::is_same_v<decltype(std::declval<const B&>().sound()), bool> &&
          std::is_same_v<decltype(std::declval<const B&>().slope()), double> &&
          std::is_same_v<decltype(std::declval<const B&>().step_limit()), double> &&
          std::is_same_v<decltype(std::declval<B&>().decrement_bound(0.1)), double>> {};

}  // namespace graspforce
