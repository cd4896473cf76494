// What a finished run achieved: coverage, repetition, overlap and effort (method.md, "Metrics").
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "host/environment/world.h"
#include "host/log_analysis/map_picture.h"
#include "shared/geometry/grid_frame.h"
#include "shared/wire/map_dump.h"

namespace ivfm::host {

// One robot's own map, as `ivfm-agent --dump-map` wrote it; rows from the window's lowest.
struct RobotMap {
  MapDumpHeader header;
  std::vector<std::uint8_t> visits;
  std::vector<std::uint8_t> obstacles;
};

// Throws std::runtime_error that names the file when it is missing, damaged or too large.
RobotMap read_robot_map(const std::filesystem::path& path);

// The sum of robots' maps: visits added up (at most 255, as the server holds them), obstacles where
// any robot holds one. All must have one cell size; throws std::invalid_argument.
PictureLayers merge_robot_maps(std::span<const RobotMap> maps);

// Which share of the cells that robots could ever see from their starts has been visited.
class CoverageMeter {
 public:
  // `cell_um`: of the robots' maps. A map cell counts when its middle is free and connected to the
  // first start over free cells of the world.
  CoverageMeter(const World& world, Point start, std::int32_t cell_um);

  std::uint64_t explorable_cells() const { return explorable_cells_; }
  bool is_explorable(Cell cell) const;
  // 0 .. 1.
  double share_visited(const PictureLayers& layers) const;

 private:
  GridFrame frame_;
  std::vector<std::uint8_t> explorable_;
  std::uint64_t explorable_cells_ = 0;
};

struct RunScores {
  double coverage = 0;          // share of the explorable cells visited
  double explored_m2 = 0;       // visited cells
  double repeat_rate = 0;       // RER: mean over visited cells of visits - 1
  double overlap = 0;           // cells visited by two or more robots / visited cells
  double pixels_per_metre = 0;  // PE: visited area in pixels of 1/128 m per metre driven
};

RunScores score_run(const PictureLayers& merged, std::span<const RobotMap> maps,
                    const CoverageMeter& meter, double driven_m);

}  // namespace ivfm::host
