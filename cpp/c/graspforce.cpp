// The C interface: graspforce::Servo behind functions that let no exception out.
#include "graspforce.h"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <new>
#include <string>
#include <string_view>

#include "graspforce/contact.hpp"
#include "graspforce/servo.hpp"

using namespace graspforce;

struct graspforce_servo : Servo {
  using Servo::Servo;
};

namespace {

// Of this thread; a fixed array, so that telling of missing memory takes none.
thread_local char error[200] = "";

template <class... Numbers>
void describe_error(const char* words, Numbers... numbers) {
  std::snprintf(error, sizeof error, words, numbers...);
}

// Sets what the names of optional fields, apart by spaces, say of a layout; false where one is
// unknown.
bool take_optional(std::string_view names, Layout& layout) {
  const struct {
    std::string_view name;
    bool& given;
  } known[] = {{"c_max", layout.ceilings},
               {"c_min", layout.floors},
               {"pull", layout.pulls},
               {"f_soft", layout.soft_wrench},
               {"cone_weight", layout.cone_weights},
               {"c_last", layout.rate_limits},
               {"dc_max", layout.rate_limits}};
  while (!names.empty()) {
    const std::string_view name = names.substr(0, names.find(' '));
    names.remove_prefix(std::min(name.size() + 1, names.size()));
    bool found = name.empty();
    for (const auto& field : known)
      if (field.name == name) found = field.given = true;
    if (found) continue;
    describe_error("optional: got %.*s, expected c_max, c_min, pull, f_soft, cone_weight, dc_max",
                   int(std::min<std::size_t>(name.size(), 60)), name.data());
    return false;
  }
  return true;
}

bool make_layout(int wrench_rows, int contacts, const int* models, int joints, int inequalities,
                 const char* optional, Layout& layout) {
  if (wrench_rows < 1 || contacts < 1 || joints < 0 || inequalities < 0) {
    describe_error(
        "got %d wrench rows, %d contacts, %d joints, %d inequalities; expected at least "
        "1, 1, 0, 0",
        wrench_rows, contacts, joints, inequalities);
    return false;
  }
  if (models == nullptr) {
    describe_error("models: got null, expected one a contact");
    return false;
  }
  layout.wrench_rows = wrench_rows;
  layout.joints = joints;
  layout.inequalities = inequalities;
  for (int i = 0; i < contacts; ++i) {
    if (models[i] != GRASPFORCE_FPC && models[i] != GRASPFORCE_PCWF &&
        models[i] != GRASPFORCE_SFC) {
      describe_error("models[%d]: got %d, expected 1 (FPC), 3 (PCWF) or 4 (SFC)", i, models[i]);
      return false;
    }
    layout.models.push_back(static_cast<Model>(models[i]));
  }
  return optional == nullptr || take_optional(optional, layout);
}

Vector3 vector(const double* from) { return {from[0], from[1], from[2]}; }

}  // namespace

extern "C" {

graspforce_servo* graspforce_create(int wrench_rows, int contacts, const int* models, int joints,
                                    int inequalities, const char* optional) {
  error[0] = '\0';
  try {
    Layout layout;
    if (!make_layout(wrench_rows, contacts, models, joints, inequalities, optional, layout))
      return nullptr;
    return new graspforce_servo(layout);
  } catch (const std::exception& reason) {  // memory that there is not
    describe_error("%s", reason.what());
    return nullptr;
  }
}

void graspforce_destroy(graspforce_servo* servo) { delete servo; }

const char* graspforce_error(void) { return error; }

double* graspforce_field(graspforce_servo* servo, const char* name, int* rows, int* columns) {
  double* found = nullptr;
  int shape[] = {0, 0};
  if (name != nullptr)
    each_field(servo->layout(), [&](const Field& field) {
      if (field.size() == 0 || std::string_view(name) != field.name) return;
      found = servo->packed() + field.offset;
      shape[0] = field.rows;
      shape[1] = field.columns;
    });
  if (rows != nullptr) *rows = shape[0];
  if (columns != nullptr) *columns = shape[1];
  return found;
}

int graspforce_write_contact(graspforce_servo* servo, int contact, const double point[3],
                             const double normal[3], const double tangent[3]) {
  const Layout& layout = servo->layout();
  if (contact < 0 || contact >= layout.contacts() || layout.wrench_rows != 6) return -1;
  const double size = length(vector(normal));
  if (!(size > 0 && size < kInfinity)) return -1;
  write_contact(servo->W, layout.first(contact), layout.models[contact], vector(point),
                vector(normal), vector(tangent));
  return 0;
}

int graspforce_set_limits(graspforce_servo* servo, double tol, int max_steps, double budget_us) {
  if (!(tol > 0 && tol < 1 && max_steps >= 1 && budget_us > 0)) return -1;
  servo->settings = {tol, max_steps, budget_us};
  return 0;
}

graspforce_status graspforce_tick(graspforce_servo* servo) {
  return static_cast<graspforce_status>(servo->tick());
}

void graspforce_reset(graspforce_servo* servo) { servo->reset(); }

const double* graspforce_forces(const graspforce_servo* servo) { return servo->c().data(); }

const double* graspforce_multipliers(const graspforce_servo* servo) { return servo->nu().data(); }

void graspforce_torques(const graspforce_servo* servo, double* tau) {
  for (int j = 0; j < servo->layout().joints; ++j) tau[j] = servo->torque(j);
}

int graspforce_newton_steps(const graspforce_servo* servo) { return servo->result().newton_steps; }

double graspforce_decrement(const graspforce_servo* servo) { return servo->result().decrement; }

double graspforce_violation(const graspforce_servo* servo) { return servo->result().violation; }
int graspforce_nearest(const graspforce_servo* servo) { return servo->result().nearest; }

double graspforce_elapsed_us(const graspforce_servo* servo) { return servo->result().elapsed_us; }

graspforce_margins graspforce_find_margins(const graspforce_servo* servo) {
  const Margins found = servo->margins();
  return {found.friction, found.torque, found.limit, found.wrench_error};
}

int graspforce_refusal(const graspforce_servo* servo, char* words, int size) {
  const Flaw& flaw = servo->refusal();
  if (!flaw) {
    if (size > 0) words[0] = '\0';
    return 0;
  }
  char entry[40] = "";
  if (flaw.axes == 1) std::snprintf(entry, sizeof entry, "[%d]", flaw.row);
  if (flaw.axes == 2) std::snprintf(entry, sizeof entry, "[%d, %d]", flaw.row, flaw.column);
  return std::snprintf(words, std::size_t(std::max(size, 0)), "%s%s: got %g, expected %s",
                       flaw.field, entry, flaw.got, flaw.expected);
}

const char* graspforce_status_name(graspforce_status status) {
  return to_string(static_cast<Status>(status));
}

const char* graspforce_version(void) { return GRASPFORCE_VERSION; }

int graspforce_abi(void) { return GRASPFORCE_ABI; }

}  // extern "C"
