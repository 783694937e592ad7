/* Four fingertips hold a cube of 250 g; one lets go and comes back. Prints every contact force, all
   digits of them. examples/cpp/hold_cube.cpp in C. */
#include <graspforce.h>
#include <stdio.h>

int main(void) {
  const int models[] = {GRASPFORCE_PCWF, GRASPFORCE_PCWF, GRASPFORCE_PCWF, GRASPFORCE_PCWF};
  graspforce_servo* servo = graspforce_create(6, 4, models, 0, 0, "c_max");
  if (servo == NULL) {
    fprintf(stderr, "%s\n", graspforce_error());
    return 1;
  }

  const double half = 0.0375; /* of the cube's side [m] */
  const double sides[4][3] = {{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  const double up[3] = {0, 0, 1};
  double* mu = graspforce_field(servo, "mu", NULL, NULL);
  double* c_max = graspforce_field(servo, "c_max", NULL, NULL);
  for (int i = 0; i < 4; ++i) {
    const double point[3] = {half * sides[i][0], half * sides[i][1], half * sides[i][2]};
    const double normal[3] = {-sides[i][0], -sides[i][1], -sides[i][2]};
    graspforce_write_contact(servo, i, point, normal, up);
    mu[i] = 0.5;
    c_max[i] = 20; /* [N] */
  }
  graspforce_field(servo, "f", NULL, NULL)[2] = 0.25 * 9.81; /* against gravity [N] */

  double* engagement = graspforce_field(servo, "engagement", NULL, NULL);
  const double* c = graspforce_forces(servo);
  const double ramp[] = {1, 0.5, 0.1, 0, 0.1, 1}; /* of the last finger */
  for (int tick = 0; tick < 6; ++tick) {
    engagement[3] = ramp[tick];
    const graspforce_status status = graspforce_tick(servo);
    if (status != GRASPFORCE_SOLVED) {
      char why[200];
      graspforce_refusal(servo, why, sizeof why);
      fprintf(stderr, "%s %s\n", graspforce_status_name(status), why);
      graspforce_destroy(servo);
      return 1;
    }
    for (int i = 0; i < 12; ++i) printf("%.17g ", c[i]);
    printf("\n");
  }
  graspforce_destroy(servo);
  return 0;
}
