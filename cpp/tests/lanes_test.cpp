// The operations on numbers side by side, lane by lane against plain ones: of vectors, and with
// GRASPFORCE_PLAIN_LANES of the structs in their place.
#include "graspforce/lanes.hpp"

#include <cmath>
#include <limits>

#include "expect.hpp"

using namespace graspforce;

template <class V>
static void lane_by_lane() {
  constexpr int n = kLanesOf<V>;
  V a = {}, b = {};
  for (int i = 0; i < n; ++i) {
    a[i] = i - 1.5;
    b[i] = i % 2 == 0 ? 2 - i : a[i];
  }
  b[0] = std::numeric_limits<double>::quiet_NaN();
  const V sum = a + 2 * b - 1, ratio = -a / b, chosen = select(a > b, a, b);
  V in_place = a;
  in_place *= 3;
  in_place -= b;
  unsigned less = 0, least = 0, same = 0, others = 0, more = 0, most = 0;
  for (int i = 1; i < n; ++i) {
    EXPECT(sum[i] == a[i] + 2 * b[i] - 1);
    EXPECT(ratio[i] == -a[i] / b[i] || (std::isnan(ratio[i]) && a[i] == 0));
    EXPECT(in_place[i] == 3 * a[i] - b[i]);
    EXPECT(chosen[i] == std::fmax(a[i], b[i]));
    EXPECT(max(a, b)[i] == std::fmax(a[i], b[i]) && min(a, b)[i] == std::fmin(a[i], b[i]));
    EXPECT(abs(a)[i] == std::abs(a[i]) && sqrt(abs(a))[i] == std::sqrt(std::abs(a[i])));
  }
  for (int i = 0; i < n; ++i) {
    less |= unsigned(a[i] < b[i]) << i, least |= unsigned(a[i] <= b[i]) << i;
    more |= unsigned(a[i] > b[i]) << i, most |= unsigned(a[i] >= b[i]) << i;
    same |= unsigned(a[i] == b[i]) << i, others |= unsigned(a[i] != b[i]) << i;
  }
  EXPECT(bits_of(a < b) == less && bits_of(a <= b) == least);
  EXPECT(bits_of(a > b) == more && bits_of(a >= b) == most);
  EXPECT(bits_of(a == b) == same && bits_of(a != b) == others);
  EXPECT(bits_of((a < b) | (a == b)) == least && bits_of((a <= b) & ~(a == b)) == less);
  for (unsigned bits = 1; bits < 1u << n; ++bits) {
    EXPECT(bits_of(mask_of<V>(bits)) == bits);
    EXPECT((bits >> lowest(bits) & 1u) == 1 && bits % (1u << lowest(bits)) == 0);
  }
}

static void across_lanes() {
  const Lanes a = {1, 2, 3, 4}, b = {5, 6, 7, 8};
  const Lanes mixed = shuffle<3, 4, 0, 7>(a, b), last = broadcast(a, 3), four = sums(a, b, a, b);
  EXPECT(mixed[0] == 4 && mixed[1] == 5 && mixed[2] == 1 && mixed[3] == 8);
  EXPECT(sum(last) == 16 && sum(a) == 10 && least(b) == 5 && greatest(b) == 8);
  EXPECT(four[0] == 10 && four[1] == 26 && four[2] == 10 && four[3] == 26);
  EXPECT(all_positive(a) && !all_positive(a - 1) && !all_positive(a / (a - a) - a / (a - a)));
  BitLanes bits = {1, 2, 4, 8};
  bits |= BitLanes{8, 0, 0, 1};
  EXPECT(bits[0] == 9 && bits[1] == 2 && bits[3] == 9);
}

int main() {
  lane_by_lane<Lanes>();
  lane_by_lane<WideLanes>();
  across_lanes();
  return verdict("lanes");
}
