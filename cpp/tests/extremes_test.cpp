// Numbers at the ends of the range of doubles, as fuzzing has found them: each case was once a
// verdict that did not stand before the judge.
#include <cmath>
#include <limits>

#include "expect.hpp"
#include "graspforce/engine.hpp"
#include "judge.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

static constexpr double kMost = std::numeric_limits<double>::max();

static Layout contacts(int count, Model model) {
  Layout layout;
  layout.models.assign(count, model);
  layout.ceilings = true;
  return layout;
}

// Solves, and has the verdict judged.
static Result judged(const RandomGrasp& grasp) {
  Engine engine(grasp.layout);
  const Result result = engine.solve(grasp.data.packed(), {1e-9, 200});
  const char* fault = Judge(grasp.layout, grasp.data.packed()).find_fault(engine, result);
  EXPECT(fault == nullptr);
  if (fault != nullptr) std::printf("  %s\n", fault);
  return result;
}

static void phase_one_that_overflows_reports_no_violation() {
  Random random(0);
  RandomGrasp grasp(random, contacts(4, Model::PCWF));
  grasp.data.c_max[0] = 1e-310;  // its inverse is infinite
  judged(grasp);
}

static void a_wrench_that_overflows_against_its_row_is_not_in_reach() {
  Random random(2);
  RandomGrasp grasp(random, contacts(1, Model::PCWF));
  grasp.data.f[4] = kMost;  // divided by the row's 4 cm: infinite
  EXPECT(judged(grasp).status != Status::Solved);
}

static void rows_that_were_left_out_hold_too() {
  Random random(3);
  RandomGrasp grasp(random, contacts(1, Model::SFC));
  grasp.data.W(5, 3) = 1e300;  // the row is a multiple of another for all that doubles tell
  judged(grasp);
}

static void a_wrench_without_a_size_is_not_made() {
  Random random(0);
  Layout layout = contacts(3, Model::PCWF);
  layout.inequalities = 1;
  RandomGrasp grasp(random, layout);
  grasp.data.f[2] = kMost, grasp.data.W(2, 5) = -1e300;  // what adds up to f is more than kMost
  EXPECT(judged(grasp).status != Status::Solved);
}

static void an_empty_grasp_answers_for_its_joints() {
  Random random(5);
  Layout layout = contacts(2, Model::PCWF);
  layout.joints = 6;
  RandomGrasp grasp(random, layout);
  for (double& share : grasp.data.engagement) share = 0;
  for (double& force : grasp.data.f) force = 0;
  EXPECT(judged(grasp).status == Status::Solved);
  grasp.data.tau_bias[2] = 2;  // a joint of a finger that has left
  EXPECT(judged(grasp).status == Status::Solved);
  grasp.lose_joints();  // a joint that feels nothing has to carry its bias all the same
  const Result result = judged(grasp);
  EXPECT(result.status == Status::Infeasible && std::abs(result.violation - 1.2 / 0.8) < 1e-12);
  grasp.data.tau_bias[2] = -2;  // the other side
  EXPECT(judged(grasp).status == Status::Infeasible);
}

static void rows_of_one_huge_entry_do_not_make_a_wrench_unreachable() {
  Random random(14);
  RandomGrasp grasp(random, contacts(6, Model::PCWF));
  grasp.data.W(2, 0) = -1e300, grasp.data.W(5, 0) = 1e172;
  EXPECT(judged(grasp).status != Status::WrenchUnreachable);
}

static void a_proof_has_no_unit() {
  Random random(7);
  Layout layout = contacts(1, Model::PCWF);
  layout.inequalities = 1;
  RandomGrasp grasp(random, layout);
  for (double& entry : grasp.data.W.entries()) entry = 0;
  for (double& entry : grasp.data.A.entries()) entry = 0;
  grasp.data.W(5, 1) = 1, grasp.data.b[0] = -1;
  const Problem problem(layout, grasp.data.packed());
  for (double unit : {1.0, 1e-200}) {
    const double right[6] = {}, wrong[6] = {0, 0, 0, 0, 0, unit}, z[2] = {0, unit};
    EXPECT(proves_infeasible(layout, problem, right, z));
    EXPECT(!proves_infeasible(layout, problem, wrong, z));
  }
}

int main() {
  a_proof_has_no_unit();
  phase_one_that_overflows_reports_no_violation();
  a_wrench_that_overflows_against_its_row_is_not_in_reach();
  rows_that_were_left_out_hold_too();
  a_wrench_without_a_size_is_not_made();
  an_empty_grasp_answers_for_its_joints();
  rows_of_one_huge_entry_do_not_make_a_wrench_unreachable();
  return verdict("extremes");
}
