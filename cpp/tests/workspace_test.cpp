// A Workspace keeps the engines of the layouts used last, within its bounds, and no others.
#include "graspforce/workspace.hpp"

#include "allocations.hpp"
#include "expect.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

static Layout fingers(int contacts) {
  Layout layout;
  layout.models.assign(contacts, Model::PCWF);
  layout.joints = 3 * contacts;
  return layout;
}

static void the_engines_used_last_stay() {
  Workspace workspace;
  const int most = Workspace::kMostEngines;
  for (int n = 1; n <= most; ++n) workspace.engine(fingers(n));
  const Engine* first = &workspace.engine(fingers(1));  // the second is now the oldest
  EXPECT(workspace.engines() == std::size_t(most));
  workspace.engine(fingers(most + 1));
  EXPECT(workspace.engines() == std::size_t(most));
  const Layout one = fingers(1), two = fingers(2);
  const long before = allocations;
  EXPECT(&workspace.engine(one) == first && allocations == before);
  EXPECT(workspace.engine(two).layout() == two && allocations > before);
}

static void layouts_are_told_apart() {
  Workspace workspace;
  Layout layout = fingers(2);
  const Layout plain = layout;
  EXPECT(&workspace.engine(plain) == &workspace.engine(layout));
  for (bool Layout::* flag : {&Layout::ceilings, &Layout::floors, &Layout::rate_limits,
                              &Layout::soft_wrench, &Layout::pulls, &Layout::cone_weights}) {
    layout = plain;
    layout.*flag = true;
    EXPECT(&workspace.engine(layout) != &workspace.engine(plain));
  }
  for (int Layout::* size :
       {&Layout::wrench_rows, &Layout::joints, &Layout::inequalities, &Layout::internals}) {
    layout = plain;
    layout.*size += 1;
    EXPECT(workspace.engine(layout).layout() == layout && !(layout == plain));
  }
  layout = plain;
  layout.models[1] = Model::SFC;
  EXPECT(workspace.engine(layout).layout() == layout && !(layout == plain));
}

static void memory_is_bounded_and_known() {
  Random random(9);
  for (int trial = 0; trial < 200; ++trial) {
    const Layout layout = random_layout(random, trial % 10 == 0 ? 60 : 8);
    const long before = allocated_bytes;
    const Engine engine(layout);
    const double taken = double(allocated_bytes - before), told = double(engine_bytes(layout));
    EXPECT(taken < 1.3 * told && told < 3 * taken);
    if (!(taken < 1.3 * told && told < 3 * taken))
      std::printf("%g %g %d %d %d\n", taken, told, layout.contacts(), layout.joints,
                  layout.inequalities);
  }
  Workspace workspace;
  for (int n = 100; n < 130; ++n) {
    EXPECT(workspace.engine(fingers(n)).layout() == fingers(n));
    EXPECT(workspace.bytes() <= Workspace::kMostBytes);
  }
  EXPECT(workspace.engines() > 1 && workspace.engines() < Workspace::kMostEngines);
  workspace.engine(fingers(400));  // larger than the bound: alone, and there
  EXPECT(workspace.engines() == 1 && workspace.bytes() > Workspace::kMostBytes);
  workspace.engine(fingers(4));
  EXPECT(workspace.engines() == 1 && workspace.bytes() < Workspace::kMostBytes);
}

int main() {
  the_engines_used_last_stay();
  layouts_are_told_apart();
  memory_is_bounded_and_known();
  return verdict("workspace");
}
