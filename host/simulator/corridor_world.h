// Worlds built from real laser recordings that Debian's package mrpt-common ships.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/environment/world.h"

namespace ivfm::host {

// How a recording (an MRPT simple map: laser scans with their poses) becomes a world.
struct RecordedWorldRecipe {
  std::string name;
  std::filesystem::path simple_map;  // .simplemap or .simplemap.gz
  std::int32_t cell_um = 50'000;
  double max_range_m = 15;             // longer beams are ignored: they only fray the edges
  std::int32_t seal_radius_cells = 3;  // gaps narrower than twice this become wall
  std::int32_t speckle_cells = 4;      // loose obstacles up to this many cells are removed
};

// Inserts every scan into an MRPT occupancy grid at its recorded pose, and cleans the result into a
// closed world: what was never seen is an obstacle, loose speckle is removed, gaps a robot could
// not pass are sealed, and only the part that holds the recording robot's first pose stays. Cells
// are aligned with the map frame. Deterministic for one MRPT version.
// Throws std::runtime_error when the file is missing or holds no laser scans.
World build_recorded_world(const RecordedWorldRecipe& recipe);

// `corridor`: a hall of some 65 m with a laboratory (localization_demo.simplemap.gz).
World corridor_world();

// `malaga`: an open square around a building, about 45 x 55 m (malaga-cs-fac-building).
World malaga_world();

// The demo's start poses in the corridor for 1 to 8 robots: side by side in front of the
// laboratory's door, the middle of the corridor. Throws std::invalid_argument for another count.
std::vector<Pose> corridor_start_poses(int count);

}  // namespace ivfm::host
