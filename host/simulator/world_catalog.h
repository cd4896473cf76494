// Worlds by the name a user gives: arenas, buildings, recorded places and map files.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "host/environment/world.h"
#include "host/simulator/robot_body.h"

namespace ivfm::host {

struct WorldRequest {
  // 1x, 2x, divider, divider-released, building, corridor, malaga, or the path of a map file.
  std::string name = "corridor";
  int robots = 2;                      // 1 .. 8
  std::uint64_t seed = 1;              // draws arenas, buildings and start poses
  bool random_starts = false;          // corridor only: not the stated start poses
  std::optional<double> resolution_m;  // of a bare image
  std::vector<Pose> starts;            // when not empty: these, one a robot
};

struct PreparedWorld {
  World world;
  std::vector<Pose> starts;  // one a robot, with room for it
  BodyShape body;            // the robot that fits this world
};

// Loads or builds the world. Throws std::invalid_argument for a name, number or start pose that
// cannot be used, std::runtime_error for a file that cannot be.
PreparedWorld prepare_world(const WorldRequest& request);

// Parses `x,y,heading` in metres and degrees. Throws std::invalid_argument.
Pose parse_pose(const std::string& text);
// The inverse, with micrometre and centidegree resolution.
std::string format_pose(const Pose& pose);

}  // namespace ivfm::host
