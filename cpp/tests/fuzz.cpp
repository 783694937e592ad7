// Problems with extreme numbers: denormals, 1e±300, signed zeros, NaN in single places; streams of
// them, with budgets. Whatever comes, the verdict has to stand before the judge.
//
// Clang's libFuzzer drives it where FUZZER is defined. Otherwise it draws its own inputs:
//     fuzz COUNT [SEED]        runs COUNT inputs
//     fuzz FILE                runs the input in a file
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>

#include "graspforce/servo.hpp"
#include "judge.hpp"
#include "random_grasp.hpp"

using namespace graspforce;

// An input's bytes as choices; zeros once it is used up.
class Choices {
 public:
  Choices(const std::uint8_t* data, std::size_t size) : next_(data), end_(data + size) {}
  bool left() const { return next_ < end_; }
  int byte() { return next_ < end_ ? *next_++ : 0; }
  int below(int count) { return (byte() + 256 * (count > 256 ? byte() : 0)) % count; }
  double bits() {
    std::uint64_t word = 0;
    for (int i = 0; i < 8; ++i) word = word << 8 | byte();
    double number;
    std::memcpy(&number, &word, sizeof number);
    return number;
  }

 private:
  const std::uint8_t *next_, *end_;
};

static double extreme(Choices& choices, double now) {
  const double infinity = std::numeric_limits<double>::infinity();
  switch (choices.below(20)) {
    case 0:
      return -now;
    case 1:
      return 0.0;
    case 2:
      return -0.0;
    case 3:
      return std::numeric_limits<double>::denorm_min();
    case 4:
      return -1e-310;
    case 5:
      return 1e-300;
    case 6:
      return 1e300;
    case 7:
      return -1e300;
    case 8:
      return std::numeric_limits<double>::max();
    case 9:
      return 1e-154;
    case 10:
      return 1e154;
    case 11:
      return std::numeric_limits<double>::quiet_NaN();
    case 12:
      return choices.byte() % 2 ? infinity : -infinity;
    case 13:
      return choices.bits();
    case 14:
      return 1;
    case 15:
      return now * (1 + 1e-15 * choices.byte());
    default:
      return now * std::pow(10.0, choices.below(41) - 20);
  }
}

static Layout some_layout(Choices& choices) {
  const Model kinds[] = {Model::FPC, Model::PCWF, Model::SFC};
  Layout layout;
  const int flags = choices.byte();
  for (int i = 1 + choices.below(6); i > 0; --i)
    layout.models.push_back(flags & 1 ? kinds[choices.below(3)] : Model::PCWF);
  layout.joints = flags & 2 ? 3 * layout.contacts() : 0;
  layout.inequalities = flags & 4 ? 1 + choices.below(3) : 0;
  layout.ceilings = flags & 8;
  layout.floors = flags & 16;
  layout.rate_limits = flags & 64;
  layout.soft_wrench = flags & 128;
  const int more = choices.byte();
  layout.pulls = more & 1;
  layout.internals = flags & 2 && more & 6 ? 1 + choices.below(2) : 0;
  layout.cone_weights = more & 8;
  if (flags & 32) layout.wrench_rows = 1 + choices.below(9);  // more than six: passive joints, say
  return layout;
}

static void mutate(Choices& choices, ProblemData& data) {
  const int size = static_cast<int>(data.packed_size());
  if (choices.below(8) == 0) {  // one unit for a stretch of numbers
    const double unit = std::pow(10.0, choices.below(601) - 300);
    const int first = choices.below(size), count = 1 + choices.below(size - first);
    for (int i = first; i < first + count; ++i) data.packed()[i] *= unit;
    return;
  }
  double& number = data.packed()[choices.below(size)];
  number = extreme(choices, number);
}

static void complain(const char* fault, const Result& result, const ProblemData& data) {
  std::printf("%s; status %d after %d steps\n", fault, int(result.status), result.newton_steps);
  for (std::size_t i = 0; i < data.packed_size(); ++i) std::printf("%.17g ", data.packed()[i]);
  std::printf("\n");
  std::fflush(stdout);
  std::abort();
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t count) {
  Choices choices(bytes, count);
  const Layout layout = some_layout(choices);
  Random random(choices.byte());
  RandomGrasp grasp(random, layout);
  Servo servo(layout);
  servo = grasp.data;
  ProblemData before(layout);
  std::vector<double> forces(layout.components());
  for (int tick = 0; tick < 6 && (tick == 0 || choices.left()); ++tick) {
    for (int i = choices.below(4) + (tick == 0); i > 0; --i) mutate(choices, servo);
    servo.settings.max_steps = choices.below(4) == 0 ? 1 + choices.below(30) : 200;
    if (choices.below(8) == 0) servo.reset();
    std::copy(servo.c().begin(), servo.c().end(), forces.begin());
    const Status status = servo.tick();
    if (servo.refusal()) {
      if (status != Status::InvalidNumbers ||
          !std::equal(forces.begin(), forces.end(), servo.c().begin()))
        complain("a refusal that leaves a trace", servo.result(), servo);
      servo = before;  // as a caller would: back to numbers that were good
      continue;
    }
    before = servo;
    const char* fault =
        Judge(layout, servo.snapshot()->data()).find_fault(servo.engine(), servo.result());
    if (fault != nullptr) complain(fault, servo.result(), servo);
    if (servo.result().newton_steps > servo.settings.max_steps)
      complain("more steps than allowed", servo.result(), servo);
    servo.margins();
  }
  return 0;
}

#ifndef FUZZER
int main(int count, char** arguments) {
  const std::string first = count > 1 ? arguments[1] : "20000";
  if (first.find_first_not_of("0123456789") != std::string::npos) {
    std::ifstream file(first, std::ios::binary);
    const std::string input(std::istreambuf_iterator<char>(file), {});
    return LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(input.data()),
                                  input.size());
  }
  std::mt19937 random(count > 2 ? std::atoi(arguments[2]) : 1);
  std::vector<std::uint8_t> input;
  for (long i = std::atol(first.c_str()); i > 0; --i) {
    input.resize(16 + random() % 240);
    for (std::uint8_t& byte : input) byte = static_cast<std::uint8_t>(random());
    LLVMFuzzerTestOneInput(input.data(), input.size());
  }
  std::printf("no fault in %s inputs\n", first.c_str());
}
#endif
