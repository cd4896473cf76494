// Where in a world a round robot can be: reachable cells, free cells, start poses.
#pragma once

#include <cstdint>
#include <vector>

#include "host/environment/world.h"

namespace ivfm::host {

// The radius of a TurtleBot3 Burger, the robot of the paper's corridor (ROBOTIS e-manual).
inline constexpr std::int32_t kRobotRadiusUm = 105'000;

// 1 for every cell (as World::occupied is ordered) in which the centre of a disc of `radius_um`
// fits without touching an obstacle, else 0.
std::vector<std::uint8_t> cells_with_clearance(const World& world, std::int32_t radius_um);

// 1 for every cell that a disc of `radius_um` can reach from `start` over the edges of cells it
// fits in; all 0 when it does not fit at `start`.
std::vector<std::uint8_t> reachable_cells(const World& world, Point start, std::int32_t radius_um);

// 1 for every free cell connected to `start` over edges: what a robot there could ever see.
std::vector<std::uint8_t> visible_region(const World& world, Point start);

// The centre of the world's cell (column, row) in the map frame.
Point cell_center(const World& world, std::int32_t column, std::int32_t row);

// `count` poses (at most 64) with room for a disc of `radius_um` and 0.1 m more, all in the world's
// largest reachable region and at least 0.5 m apart, with random headings; the same for the same
// seed. Throws std::runtime_error when they do not fit.
std::vector<Pose> random_start_poses(const World& world, int count, std::int32_t radius_um,
                                     std::uint64_t seed);

}  // namespace ivfm::host
