// Random floor plans in endless variety: rooms and corridors, loops, halls, caves, furniture.
#pragma once

#include <cstdint>

#include "host/environment/scenario.h"

namespace ivfm::host {

enum class BuildingStyle : std::uint8_t {
  kRooms,      // rooms split again and again, doors between them, some doors more for loops
  kCorridors,  // rooms along long corridors that cross
  kHall,       // an open hall with pillars and partitions
  kCave,       // natural shapes
  kRing,       // a corridor around a core, rooms outside
  kMixed,      // any of the above, by chance
};

struct BuildingConfig {
  BuildingStyle style = BuildingStyle::kMixed;
  std::int32_t cell_um = 50'000;
  std::int32_t min_side_um = 8'000'000;
  std::int32_t max_side_um = 30'000'000;
  // Robots start with the room around them that planners keep (EnvironmentConfig::building).
  std::int32_t robot_radius_um = 225'000;
};

// A random building with `agents` robots that touch nothing and can all reach each other. The same
// seed and configuration give the same scenario everywhere. Centred on the map frame's origin.
// Throws std::invalid_argument when `agents` is not 1 .. 32 or a measure is out of its range
// (sides from 4 m to 200 m, cells from 1 cm to 20 cm).
Scenario random_building(const BuildingConfig& config, int agents, std::uint64_t seed);

}  // namespace ivfm::host
