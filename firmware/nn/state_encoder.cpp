#include "firmware/nn/state_encoder.h"

#include <algorithm>

namespace ivfm {
namespace {

constexpr int kMaxRowCells = kPolicyCells * kMaxPool;

// The i-VFM of a cell by own + peers' visits (0 .. 510), or by an entry with bit 9 set: an
// obstacle.
constexpr unsigned kObstacleEntry = 512;
consteval auto make_cell_values() {
  std::array<std::uint16_t, 2 * kObstacleEntry> values{};
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = i >= kObstacleEntry ? kIvfmBlocked : kIvfmOfVisits[std::min<std::size_t>(i, 255)];
  return values;
}
constexpr auto kCellValues = make_cell_values();

bool valid_pool(int pool) { return pool >= 1 && pool <= kMaxPool; }

// The part of one grid row that lies in the map's window: columns [first, last) of the grid, and
// where the first of them is stored.
struct RowPart {
  int first = 0;
  int last = 0;
  std::size_t index = 0;
};

RowPart row_part(const GridFrame& frame, const CellRect& grid_window, std::int32_t y) {
  const CellRect row{grid_window.x, y, grid_window.width, 1};
  const CellRect stored = row.intersection(frame.window());
  if (stored.empty()) return {};
  return {stored.x - row.x, stored.right() - row.x, frame.index_of({stored.x, y})};
}

// Sets the cells of one row whose centres lie within the robot's disc.
void draw_robot(const GridFrame& frame, const CellRect& row, Point robot, std::int32_t radius_um,
                std::span<std::uint16_t> values) {
  const std::int64_t radius2 = std::int64_t{radius_um} * radius_um;
  const auto inside = [&](std::int32_t x) {
    return squared_distance_um2(frame.center_of({x, row.y}), robot) <= radius2;
  };
  const Cell nearest = frame.cell_at(robot);
  for (std::int32_t x = nearest.x; inside(x); ++x)
    if (x >= row.x && x < row.right()) values[static_cast<std::size_t>(x - row.x)] = kIvfmBlocked;
  for (std::int32_t x = nearest.x - 1; inside(x); --x)
    if (x >= row.x && x < row.right()) values[static_cast<std::size_t>(x - row.x)] = kIvfmBlocked;
}

void read_row(const VisitView& view, const CellRect& grid_window, std::int32_t y,
              std::span<std::uint16_t> values) {
  std::fill(values.begin(), values.end(), kIvfmOfVisits[0]);
  const RowPart part = row_part(view.frame, grid_window, y);
  const std::uint8_t* own = view.own_visits.data() + part.index;
  const std::uint8_t* peers = view.peer_visits.data() + part.index;
  const std::uint8_t* flags = view.flags.data() + part.index;
  std::uint16_t* out = values.data() + part.first;
  for (int i = 0; i < part.last - part.first; ++i) {
    // Without a branch: where obstacles lie is hard to predict.
    const unsigned obstacle = (flags[i] & view.obstacle_mask) != 0 ? kObstacleEntry : 0;
    out[i] = kCellValues[(unsigned{own[i]} + peers[i]) | obstacle];
  }
}

void add_blocks(std::span<const std::uint16_t> row, int pool,
                std::array<std::uint32_t, kPolicyCells>& sums) {
  const std::uint16_t* cell = row.data();
  for (auto& sum : sums)
    for (int i = 0; i < pool; ++i) sum += *cell++;
}

}  // namespace

Status encode_ivfm(const VisitView& view, const PolicyGrid& grid, Point robot,
                   std::int32_t robot_radius_um, std::span<std::uint16_t> out) {
  const std::size_t cells = view.frame.size();
  if (!valid_pool(grid.pool) || robot_radius_um < 0 || out.size() != kPolicyGridSize ||
      view.own_visits.size() != cells || view.peer_visits.size() != cells ||
      view.flags.size() != cells)
    return Status::kInvalidArgument;
  const CellRect window = grid.window();
  const auto area = static_cast<std::uint32_t>(grid.pool * grid.pool);
  std::array<std::uint16_t, kMaxRowCells> buffer;
  const std::span<std::uint16_t> row(buffer.data(), static_cast<std::size_t>(window.width));
  for (int block_y = 0; block_y < kPolicyCells; ++block_y) {
    std::array<std::uint32_t, kPolicyCells> sums{};
    for (int i = 0; i < grid.pool; ++i) {
      const std::int32_t y = window.y + block_y * grid.pool + i;
      read_row(view, window, y, row);
      draw_robot(view.frame, {window.x, y, window.width, 1}, robot, robot_radius_um, row);
      add_blocks(row, grid.pool, sums);
    }
    std::uint16_t* out_row = out.data() + block_y * kPolicyCells;
    for (std::size_t x = 0; x < sums.size(); ++x)
      out_row[x] = static_cast<std::uint16_t>((sums[x] + area / 2) / area);
  }
  return Status::kOk;
}

Status encode_path(const PathView& view, const PolicyGrid& grid, std::span<std::uint16_t> out) {
  if (!valid_pool(grid.pool) || out.size() != kPolicyGridSize ||
      view.cost.size() != view.frame.size() || view.units_per_cell < 1 ||
      view.units_per_cell > 4096)
    return Status::kInvalidArgument;
  const CellRect window = grid.window();
  const std::uint32_t units_per_block = std::uint32_t{view.units_per_cell} * grid.pool;
  std::array<std::uint16_t, kMaxRowCells> row_minimum;
  for (int block_y = 0; block_y < kPolicyCells; ++block_y) {
    std::fill(row_minimum.begin(), row_minimum.end(), view.unreachable);
    for (int i = 0; i < grid.pool; ++i) {
      const RowPart part = row_part(view.frame, window, window.y + block_y * grid.pool + i);
      const std::uint16_t* cost = view.cost.data() + part.index;
      std::uint16_t* minimum = row_minimum.data() + part.first;
      for (int x = 0; x < part.last - part.first; ++x) minimum[x] = std::min(minimum[x], cost[x]);
    }
    for (int block_x = 0; block_x < kPolicyCells; ++block_x) {
      const std::uint16_t* first = row_minimum.data() + block_x * grid.pool;
      const std::uint32_t cost = *std::min_element(first, first + grid.pool);
      const std::uint32_t scaled = (cost * 256 + units_per_block / 2) / units_per_block;
      out[static_cast<std::size_t>(block_y * kPolicyCells + block_x)] =
          cost >= view.unreachable
              ? kPathUnreachable
              : static_cast<std::uint16_t>(std::min<std::uint32_t>(scaled, kPathSaturation));
    }
  }
  return Status::kOk;
}

}  // namespace ivfm
