// Once an Engine has been made, neither its solves nor its ticks allocate, whatever happens.
#include "allocations.hpp"
#include "expect.hpp"
#include "graspforce/engine.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

static const Settings kSettings{1e-9, 200};

// Everything that may change in a stream, at random; the numbers of verdicts of each kind.
static void a_life(unsigned seed, long* verdicts) {
  Random random(seed);
  RandomGrasp grasp(random, random_layout(random));
  Engine engine(grasp.layout);
  for (int tick = 0; tick < 60; ++tick) {
    ProblemData& data = grasp.data;
    switch (random.below(12)) {
      case 0:
        grasp.couple(random);
        break;
      case 1:
        grasp.uncouple(random);
        break;
      case 2:
        grasp.lose_joint(random);
        break;
      case 3:  // all in one block
        for (double& entry : data.J.entries()) entry = 0.02 * random.normal();
        break;
      case 4:
      case 5:
        if (grasp.layout.ceilings)
          data.engagement[random.below(grasp.layout.contacts())] =
              random.chance(0.5) ? 0 : random.uniform(0, 1);
        break;
      case 6:
        for (double& share : data.engagement) share = grasp.layout.ceilings && tick % 2 ? 0 : 1;
        break;
      case 7:
        grasp.flatten();
        break;
      case 8:
        grasp.place(random, random.below(grasp.layout.contacts()));
        break;
      case 9:
        for (double& entry : data.A.entries()) entry = random.chance(0.5) ? 0 : random.normal();
        break;
      case 10:
        data.alpha = std::pow(10.0, random.uniform(-4, 6));
        break;
    }
    grasp.wish(random, random.chance(0.2) ? 100 : 0.2);
    if (random.chance(0.2)) data.f[5] += 0.01;  // out of reach where W has lost this row
    Settings settings = kSettings;
    if (random.chance(0.1)) settings.max_steps = 1 + random.below(10);
    if (random.chance(0.1)) settings.budget_us = random.uniform(0.1, 20);
    const long before = allocations;
    const Result& result = random.chance(0.8) ? engine.tick(data.packed(), settings)
                                              : engine.solve(data.packed(), settings);
    EXPECT(allocations == before);
    ++verdicts[static_cast<int>(result.status)];
  }
}

int main() {
  long verdicts[8] = {};
  for (unsigned seed = 0; seed < 400; ++seed) a_life(seed, verdicts);
  // Solved, infeasible, unreachable and cut short: all of it was there.
  for (Status status :
       {Status::Solved, Status::Infeasible, Status::WrenchUnreachable, Status::MaxSteps})
    EXPECT(verdicts[static_cast<int>(status)] > 100);
  return verdict("allocation");
}
