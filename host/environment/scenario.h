// One episode's beginning: a world, where the robots start, and the target if there is one.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "host/environment/ray_caster.h"
#include "host/environment/world.h"
#include "shared/geometry/pose.h"

namespace ivfm::host {

// Shared between copies of an environment; never changes after it is built.
struct Scenario {
  std::shared_ptr<const World> world;
  std::shared_ptr<const RayCaster> rays;  // of `world`
  std::vector<Pose> starts;               // one a robot
  std::optional<Point> target;            // centre of the cube to find; none: explore the whole map
  // Instead of one target: all places where it could be. The episode ends when a view has contained
  // each of them.
  std::vector<Point> places;
};

}  // namespace ivfm::host
