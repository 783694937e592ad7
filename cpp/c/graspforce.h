// Contact forces of a grasp, tick after tick: the C interface of graspforce, for C and for whatever
// can call C. It is graspforce::Servo (servo.hpp) behind functions; docs/c.md tells the rest.
//
// Units are N, N·m, m. Matrices are row-major. No function throws, prints or ends the program.
// After graspforce_create nothing allocates. A servo may be used by one thread at a time; servos
// share nothing. Passing a null servo, or one that was destroyed, is undefined.
#ifndef GRASPFORCE_H
#define GRASPFORCE_H

#ifdef __cplusplus
extern "C" {
#endif

#if defined(_WIN32)
#ifdef GRASPFORCE_BUILDING
#define GRASPFORCE_API __declspec(dllexport)
#else
#define GRASPFORCE_API __declspec(dllimport)
#endif
#else
#define GRASPFORCE_API __attribute__((visibility("default")))
#endif

// Changes when a program that was compiled for it would not work with the library any more;
// graspforce_abi() is the library's.
#define GRASPFORCE_ABI 1

// A contact model's value is its number of force components.
enum {
  GRASPFORCE_FPC = 1,   // frictionless point: normal force
  GRASPFORCE_PCWF = 3,  // point with friction: normal force, two tangential forces
  GRASPFORCE_SFC = 4    // soft finger: those and the torsion about the normal
};

typedef enum graspforce_status {
  GRASPFORCE_SOLVED = 0,
  GRASPFORCE_INFEASIBLE = 1,
  GRASPFORCE_WRENCH_UNREACHABLE = 2,
  GRASPFORCE_UNBOUNDED = 3,
  GRASPFORCE_MAX_STEPS = 4,
  GRASPFORCE_STALLED = 5,
  GRASPFORCE_INVALID_NUMBERS = 6,  // of a tick that was refused, too: graspforce_refusal
  GRASPFORCE_ON_EDGE = 7
} graspforce_status;

typedef struct graspforce_servo graspforce_servo;

// Makes a servo for the largest grasp that there will be; contacts leave it by an engagement of 0.
// `models` are the contacts' models. `optional` names, apart by spaces, the optional fields that
// the problem has: c_max, c_min, pull, f_soft, cone_weight, dc_max (with c_last). Null: why stands
// in graspforce_error(). (Internal forces of redundant motors are for C++ and Python alone.)
GRASPFORCE_API graspforce_servo* graspforce_create(int wrench_rows, int contacts, const int* models,
                                                   int joints, int inequalities,
                                                   const char* optional);
GRASPFORCE_API void graspforce_destroy(graspforce_servo* servo);  // null is left alone

// Why the last graspforce_create of this thread returned null; "" when it did not.
GRASPFORCE_API const char* graspforce_error(void);

// The numbers of a field (W, f, J, tau_lo, tau_hi, tau_bias, c_max, c_min, engagement, pull,
// f_soft, c_last, dc_max, A, b, mu, gamma, cone_weight, alpha), to be written in place; they stay
// where they are for the life of the servo. Null: no such field, or it has no entries here. `rows`
// and `columns` may be null. Engagement, mu and gamma begin at 1, alpha at 5, all else at 0.
GRASPFORCE_API double* graspforce_field(graspforce_servo* servo, const char* name, int* rows,
                                        int* columns);

// Fills the columns of W that belong to a contact, where W has six rows: forces along the normal,
// which points into the object, along what of `tangent` is at right angles to it, and along their
// cross product; torques about the origin of `point`. Returns 0, or −1 where there is no such
// contact, W has not six rows, or the normal has no direction.
GRASPFORCE_API int graspforce_write_contact(graspforce_servo* servo, int contact,
                                            const double point[3], const double normal[3],
                                            const double tangent[3]);

// Of the ticks to come: the certified bound on decrement²/2 at return (1e-9 at first, between 0 and
// 1), the most Newton steps (200, at least 1), the most time [µs] (infinite, more than 0). Returns
// 0, or −1 where one is out of range, and then changes none.
GRASPFORCE_API int graspforce_set_limits(graspforce_servo* servo, double tol, int max_steps,
                                         double budget_us);

// Solves from the fields as they stand.
GRASPFORCE_API graspforce_status graspforce_tick(graspforce_servo* servo);
// Discards the past optima: the next tick starts cold.
GRASPFORCE_API void graspforce_reset(graspforce_servo* servo);

// ---- what the last tick found; a tick that was refused changes none of it ----------------------

GRASPFORCE_API const double* graspforce_forces(const graspforce_servo* servo);  // c, all contacts'
GRASPFORCE_API const double* graspforce_multipliers(const graspforce_servo* servo);  // of W c = f
// J' c + tau_bias [N·m], one a joint.
GRASPFORCE_API void graspforce_torques(const graspforce_servo* servo, double* tau);
GRASPFORCE_API int graspforce_newton_steps(const graspforce_servo* servo);
// The certified bound on the decrement of Phi / min(1, alpha).
GRASPFORCE_API double graspforce_decrement(const graspforce_servo* servo);
// The least relative violation of an infeasible tick.
GRASPFORCE_API double graspforce_violation(const graspforce_servo* servo);
// 1 where the tick is INFEASIBLE, WRENCH_UNREACHABLE or ON_EDGE and the forces, strictly inside
// every cone and limit, make the wrench nearest to f: to hold them is better than to let go. Else
// 0.
GRASPFORCE_API int graspforce_nearest(const graspforce_servo* servo);
GRASPFORCE_API double graspforce_elapsed_us(const graspforce_servo* servo);  // with a budget_us

// Recomputed from the fields and the forces alone.
typedef struct graspforce_margins {
  double friction;      // least mu n − ‖w t‖ of a contact in the grasp [N]
  double torque;        // least distance of a joint torque to a limit [N·m]
  double limit;         // least slack of ceilings, floors, rates and A c ≤ b, in their units
  double wrench_error;  // largest |W c − f| [N, N·m]
} graspforce_margins;
GRASPFORCE_API graspforce_margins graspforce_find_margins(const graspforce_servo* servo);

// Writes why the last tick was refused ("tau_lo[3]: got 2, expected less than tau_hi"), cut to
// `size` bytes with the final zero, and returns the length of the whole; 0 when it was not refused.
GRASPFORCE_API int graspforce_refusal(const graspforce_servo* servo, char* words, int size);

GRASPFORCE_API const char* graspforce_status_name(graspforce_status status);  // "SOLVED", …
GRASPFORCE_API const char* graspforce_version(void);                          // "0.1.0"
GRASPFORCE_API int graspforce_abi(void);

#ifdef __cplusplus
}
#endif

#endif
