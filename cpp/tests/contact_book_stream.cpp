// The ContactBook on a stream of readings, which tests/test_cpp_mujoco.py compares with Python's.
//
// Reads `links`, each link's slots and the spare ones, then for every update a dt, the object's
// place and its rotation row by row, how many contacts there are, and each one's link, point and
// normal. Prints every update's slots: link, engagement, presence, point and axes; then the slot of
// each contact, and how many have none.
#include <iostream>

#include "graspforce/contact_book.hpp"

using namespace graspforce;

static bool read(Vector3& v) { return bool(std::cin >> v[0] >> v[1] >> v[2]); }

int main() {
  std::cout.precision(17);
  int links = 0;
  std::cin >> links;
  std::vector<ContactBook::Slots> slots;
  for (int link = 0, count = 0; link < links && std::cin >> count; ++link)
    slots.push_back({link, count});
  ContactBook::Options options;
  std::cin >> options.spare;
  ContactBook book(slots, options);
  ObjectPose pose;
  double dt = 0;
  while (std::cin >> dt && read(pose.position) && read(pose.rotation[0]) &&
         read(pose.rotation[1]) && read(pose.rotation[2])) {
    int count = 0;
    std::cin >> count;
    std::vector<Touch> touches(count);
    for (Touch& each : touches) {
      std::cin >> each.link;
      read(each.point);
      read(each.normal);
    }
    if (!book.update({touches.data(), count}, dt, pose)) std::cout << "refused ";
    for (int slot = 0; slot < book.size(); ++slot) {
      std::cout << book.link(slot) << ' ' << book.engagement(slot) << ' ' << book.present(slot)
                << ' ';
      for (double x : book.point(slot)) std::cout << x << ' ';
      for (const Vector3& axis : book.axes(slot))
        for (double x : axis) std::cout << x << ' ';
    }
    for (int i = 0; i < count; ++i) std::cout << book.slot_of(i) << ' ';
    std::cout << book.without_slot() << '\n';
  }
}
