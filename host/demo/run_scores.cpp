#include "host/demo/run_scores.h"

#include <algorithm>
#include <fstream>
#include <stdexcept>

#include "host/simulator/world_region.h"

namespace ivfm::host {
namespace {

constexpr std::uintmax_t kMaxDumpBytes = 128 * 1024 * 1024;
constexpr double kPixelsPerSquareMetre = 128.0 * 128.0;

// Collects the rows of a dump in order; they come layer by layer from the lowest.
class RowCollector final : public MapRowSink {
 public:
  void take_row(Layer layer, std::int32_t, std::span<const std::uint8_t> cells) override {
    auto& rows = layer == Layer::kVisits ? visits : obstacles;
    rows.insert(rows.end(), cells.begin(), cells.end());
  }
  std::vector<std::uint8_t> visits, obstacles;
};

CellRect world_cells(const World& world, std::int32_t cell_um) {
  const GridFrame grid(cell_um, {});
  const Cell low = grid.cell_at(world.origin);
  const Cell high = grid.cell_at(cell_center(world, world.width - 1, world.height - 1));
  return {low.x, low.y, high.x - low.x + 1, high.y - low.y + 1};
}

}  // namespace

RobotMap read_robot_map(const std::filesystem::path& path) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (error) throw std::runtime_error("map dump " + path.string() + " is missing");
  if (size > kMaxDumpBytes) throw std::runtime_error("map dump " + path.string() + " is too large");
  std::vector<std::uint8_t> bytes(size);
  std::ifstream in(path, std::ios::binary);
  in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  RowCollector rows;
  const Result<MapDumpHeader> header = read_map_dump(bytes, rows);
  if (!in || !header.ok()) {
    throw std::runtime_error("map dump " + path.string() + " is damaged or cut off");
  }
  return {*header, std::move(rows.visits), std::move(rows.obstacles)};
}

PictureLayers merge_robot_maps(std::span<const RobotMap> maps) {
  CellRect all;
  for (const RobotMap& map : maps) {
    if (map.header.cell_um != maps.front().header.cell_um) {
      throw std::invalid_argument("merge_robot_maps: the maps' cells differ in size");
    }
    all = all.united(map.header.window);
  }
  PictureLayers merged{GridFrame(maps.empty() ? 1 : maps.front().header.cell_um, all), {}, {}};
  merged.visits.assign(merged.frame.size(), 0);
  merged.obstacles.assign(merged.frame.size(), 0);
  for (const RobotMap& map : maps) {
    const GridFrame own(map.header.cell_um, map.header.window);
    for (std::size_t i = 0; i < own.size(); ++i) {
      if (!map.visits[i] && !map.obstacles[i]) continue;
      const std::size_t at = merged.frame.index_of(own.cell_of_index(i));
      merged.visits[at] =
          static_cast<std::uint16_t>(std::min(255, int{merged.visits[at]} + int{map.visits[i]}));
      if (map.obstacles[i]) merged.obstacles[at] = 1;
    }
  }
  return merged;
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

double CoverageMeter::share_visited(const PictureLayers& layers) const {
  std::uint64_t visited = 0;
  for (std::size_t i = 0; i < layers.visits.size(); ++i) {
    if (layers.visits[i] != 0 && is_explorable(layers.frame.cell_of_index(i))) ++visited;
  }
  return static_cast<double>(visited) / static_cast<double>(explorable_cells_);
}

RunScores score_run(const PictureLayers& merged, std::span<const RobotMap> maps,
                    const CoverageMeter& meter, double driven_m) {
  RunScores scores;
  scores.coverage = meter.share_visited(merged);
  std::uint64_t cells = 0, visits = 0, shared = 0;
  for (std::size_t i = 0; i < merged.visits.size(); ++i) {
    if (merged.visits[i] == 0) continue;
    ++cells;
    visits += merged.visits[i];
    const Cell cell = merged.frame.cell_of_index(i);
    const auto seers = std::count_if(maps.begin(), maps.end(), [&](const RobotMap& map) {
      const GridFrame own(map.header.cell_um, map.header.window);
      return own.contains(cell) && map.visits[own.index_of(cell)] != 0;
    });
    if (seers >= 2) ++shared;
  }
  if (cells == 0) return scores;
  const double cell_m = merged.frame.cell_um() / 1e6;
  scores.explored_m2 = static_cast<double>(cells) * cell_m * cell_m;
  scores.repeat_rate = static_cast<double>(visits - cells) / static_cast<double>(cells);
  scores.overlap = static_cast<double>(shared) / static_cast<double>(cells);
  if (driven_m > 0) scores.pixels_per_metre = scores.explored_m2 * kPixelsPerSquareMetre / driven_m;
  return scores;
}

}  // namespace ivfm::host
