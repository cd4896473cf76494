#include "host/demo/run_scores.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "firmware/planning/explorer.h"
#include "host/simulator/robot_body.h"
#include "host/simulator/world_region.h"

namespace ivfm::host {
namespace {

CellRect world_cells(const World& world, std::int32_t cell_um) {
  const GridFrame grid(cell_um, {});
  const Cell low = grid.cell_at(world.origin);
  const Cell high = grid.cell_at(cell_center(world, world.width - 1, world.height - 1));
  return {low.x, low.y, high.x - low.x + 1, high.y - low.y + 1};
}

}  // namespace

PictureLayers to_picture_layers(const LayerMap& map) {
  PictureLayers layers{GridFrame(std::max(1, map.cell_um), map.bounds), {}, map.obstacles};
  layers.visits.assign(map.visits.begin(), map.visits.end());
  return layers;
}

CoverageMeter::CoverageMeter(const World& world, Point start, std::int32_t cell_um)
    : frame_(cell_um, world_cells(world, cell_um)) {
  const std::vector<std::uint8_t> visible = visible_region(world, start);
  explorable_.assign(frame_.size(), 0);
  for (std::size_t i = 0; i < explorable_.size(); ++i) {
    const Point middle = frame_.center_of(frame_.cell_of_index(i));
    if (world.is_occupied(middle)) continue;
    const auto column = (std::int64_t{middle.x_um} - world.origin.x_um) / world.cell_um;
    const auto row = (std::int64_t{middle.y_um} - world.origin.y_um) / world.cell_um;
    explorable_[i] = visible[static_cast<std::size_t>(row * world.width + column)];
    explorable_cells_ += explorable_[i];
  }
  if (explorable_cells_ == 0) {
    throw std::invalid_argument("CoverageMeter: the start is not in free space");
  }
}

bool CoverageMeter::is_explorable(Cell cell) const {
  return frame_.contains(cell) && explorable_[frame_.index_of(cell)] != 0;
}

double CoverageMeter::share_visited(const LayerMap& map) const {
  const GridFrame frame(std::max(1, map.cell_um), map.bounds);
  std::uint64_t visited = 0;
  for (std::size_t i = 0; i < map.visits.size(); ++i) {
    if (map.visits[i] != 0 && is_explorable(frame.cell_of_index(i))) ++visited;
  }
  return static_cast<double>(visited) / static_cast<double>(explorable_cells_);
}

RunScores score_run(const LayerMap& merged, std::span<const LayerMap> robots,
                    const CoverageMeter& meter, double driven_m) {
  RunScores scores = score_maps(merged, robots, driven_m);
  scores.coverage = meter.share_visited(merged);
  return scores;
}

double local_map_width_m(double visit_range_m, std::int32_t cell_um) {
  const auto visit_range_um = static_cast<std::int32_t>(std::lround(visit_range_m * 1e6));
  return 1e-6 * ExplorerConfig::lidar(visit_range_um, cell_um).local_map_um(cell_um);
}

std::uint64_t count_ghosts(const LayerMap& merged, const World& world) {
  constexpr double kNearM = 0.25;
  const GridFrame frame(std::max(1, merged.cell_um), merged.bounds);
  std::uint64_t ghosts = 0;
  for (std::size_t i = 0; i < merged.obstacles.size(); ++i) {
    if (merged.obstacles[i] == 0) continue;
    const Point middle = frame.center_of(frame.cell_of_index(i));
    ghosts += disc_touches_obstacle(world, middle.x_um / 1e6, middle.y_um / 1e6, kNearM) ? 0 : 1;
  }
  return ghosts;
}

RunScores score_maps(const LayerMap& merged, std::span<const LayerMap> robots, double driven_m) {
  RunScores scores;
  const GridFrame frame(std::max(1, merged.cell_um), merged.bounds);
  std::uint64_t cells = 0, visits = 0, shared = 0;
  for (std::size_t i = 0; i < merged.visits.size(); ++i) {
    if (merged.visits[i] == 0) continue;
    ++cells;
    visits += merged.visits[i];
    const Cell cell = frame.cell_of_index(i);
    const auto seers = std::count_if(robots.begin(), robots.end(), [&](const LayerMap& robot) {
      return robot.value(Layer::kVisits, cell) != 0;
    });
    if (seers >= 2) ++shared;
  }
  if (cells == 0) return scores;
  const double cell_m = merged.cell_um / 1e6;
  scores.explored_m2 = static_cast<double>(cells) * cell_m * cell_m;
  scores.repeat_rate = static_cast<double>(visits - cells) / static_cast<double>(cells);
  scores.overlap = static_cast<double>(shared) / static_cast<double>(cells);
  if (driven_m > 0) scores.pixels_per_metre = scores.explored_m2 * kPixelsPerSquareMetre / driven_m;
  return scores;
}

}  // namespace ivfm::host
