// What a finished run achieved: coverage, repetition, overlap and effort (method.md, "Metrics").
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "host/environment/world.h"
#include "host/log_analysis/map_picture.h"
#include "host/map_server/map_reader.h"
#include "shared/geometry/grid_frame.h"

namespace ivfm::host {

// The map as the picture wants it.
PictureLayers to_picture_layers(const LayerMap& map);

// Which share of the cells that robots could ever see from their starts has been visited.
class CoverageMeter {
 public:
  // `cell_um`: of the robots' maps. A map cell counts when its middle is free and connected to the
  // first start over free cells of the world.
  CoverageMeter(const World& world, Point start, std::int32_t cell_um);

  std::uint64_t explorable_cells() const { return explorable_cells_; }
  bool is_explorable(Cell cell) const;
  // 0 .. 1.
  double share_visited(const LayerMap& map) const;

 private:
  GridFrame frame_;
  std::vector<std::uint8_t> explorable_;
  std::uint64_t explorable_cells_ = 0;
};

// The paper's pixels are 1/128 m wide.
inline constexpr double kPixelsPerSquareMetre = 128.0 * 128.0;

struct RunScores {
  double coverage = 0;          // share of the explorable cells visited
  double explored_m2 = 0;       // visited cells
  double repeat_rate = 0;       // RER: mean over visited cells of visits - 1
  double overlap = 0;           // cells visited by two or more robots / visited cells
  double pixels_per_metre = 0;  // PE: visited area in pixels of 1/128 m per metre driven
};

// Of a robot with a lidar; the paper's metre in PE (method.md, "How good").
double local_map_width_m(double visit_range_m, std::int32_t cell_um);

// Obstacle cells more than 0.25 m from everything that stands in the world: what moved, or a robot
// that was not where it believed to be.
std::uint64_t count_ghosts(const LayerMap& merged, const World& world);

// All but the coverage, for which one must know the world.
RunScores score_maps(const LayerMap& merged, std::span<const LayerMap> robots, double driven_m);
// `robots`: the map of each; `driven_m`: the distance all of them drove.
RunScores score_run(const LayerMap& merged, std::span<const LayerMap> robots,
                    const CoverageMeter& meter, double driven_m);

}  // namespace ivfm::host
