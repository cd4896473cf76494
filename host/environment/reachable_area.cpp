#include "host/environment/reachable_area.h"

#include <array>
#include <cmath>

namespace ivfm::host {

namespace {

constexpr std::array<Cell, 4> kNeighbours = {{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};

}  // namespace

std::vector<std::uint8_t> reachable_centers(const RayCaster& rays, const GridFrame& frame,
                                            Cell start, std::int32_t radius_um) {
  std::vector<std::uint8_t> reached(frame.size(), 0);
  if (!frame.contains(start)) return reached;
  std::vector<Cell> open{start};
  reached[frame.index_of(start)] = 1;
  while (!open.empty()) {
    const Cell cell = open.back();
    open.pop_back();
    for (const Cell& step : kNeighbours) {
      const Cell next{cell.x + step.x, cell.y + step.y};
      if (!frame.contains(next) || reached[frame.index_of(next)] != 0) continue;
      const Point center = frame.center_of(next);
      if (rays.world().is_occupied(center) || !rays.disc_is_free(center, radius_um)) continue;
      reached[frame.index_of(next)] = 1;
      open.push_back(next);
    }
  }
  return reached;
}

std::vector<std::uint8_t> dilated(const std::vector<std::uint8_t>& cells, const GridFrame& frame,
                                  std::int32_t radius_um) {
  const std::int32_t reach = radius_um / frame.cell_um();
  std::vector<std::int32_t> half_widths;
  for (std::int32_t dy = -reach; dy <= reach; ++dy) {
    const std::int64_t height = std::int64_t{dy} * frame.cell_um();
    const auto half = static_cast<std::int32_t>(
        std::sqrt(static_cast<double>(std::int64_t{radius_um} * radius_um - height * height)));
    half_widths.push_back(half / frame.cell_um());
  }
  std::vector<std::uint8_t> out(cells.size(), 0);
  const CellRect& window = frame.window();
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (cells[i] == 0) continue;
    const Cell cell = frame.cell_of_index(i);
    for (std::int32_t dy = -reach; dy <= reach; ++dy) {
      const std::int32_t half = half_widths[static_cast<std::size_t>(dy + reach)];
      const CellRect row =
          CellRect{cell.x - half, cell.y + dy, 2 * half + 1, 1}.intersection(window);
      if (row.empty()) continue;
      std::uint8_t* first = &out[frame.index_of({row.x, row.y})];
      std::fill(first, first + row.width, std::uint8_t{1});
    }
  }
  return out;
}

CellRect extent_of(const World& world, std::int32_t cell_um) {
  const GridFrame grid(cell_um, {});
  const auto far_um = [&](std::int32_t origin_um, std::int32_t cells) {
    return static_cast<std::int32_t>(origin_um + std::int64_t{cells} * world.cell_um - 1);
  };
  const Cell low = grid.cell_at(world.origin);
  const Cell high = grid.cell_at(
      {far_um(world.origin.x_um, world.width), far_um(world.origin.y_um, world.height)});
  return {low.x, low.y, high.x - low.x + 1, high.y - low.y + 1};
}

}  // namespace ivfm::host
