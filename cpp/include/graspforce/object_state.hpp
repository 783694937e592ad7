// Where a rigid object is, how it moves, and how it should; world axes.
#pragma once

#include "graspforce/contact.hpp"

namespace graspforce {

// `rotation` is row by row: its columns are the object's axes in the world.
struct ObjectPose {
  Vector3 position{};
  Matrix3 rotation{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

  Vector3 to_world(const Vector3& v) const {
    return {dot(rotation[0], v), dot(rotation[1], v), dot(rotation[2], v)};
  }
  Vector3 to_object(const Vector3& v) const {
    return plus(plus(times(v[0], rotation[0]), times(v[1], rotation[1])), times(v[2], rotation[2]));
  }
};

// The position and the velocity are those of its centre of mass.
struct ObjectState : ObjectPose {
  Vector3 velocity{}, angular_velocity{};
};

struct ObjectTarget : ObjectState {
  Vector3 acceleration{}, angular_acceleration{};
};

}  // namespace graspforce
