#include "host/environment/reachable_area.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace ivfm::host {

namespace {

enum : std::uint8_t { kShut, kOpen, kReached };

// The frame's cells and a ring of shut ones around them: kOpen where a disc's centre may be.
std::vector<std::uint8_t> open_cells(const RayCaster& rays, const GridFrame& padded,
                                     std::int32_t radius_um) {
  std::vector<std::uint8_t> cells(padded.size(), kShut);
  const CellRect inside = padded.window().grown(-1);
  for (std::int32_t y = inside.y; y < inside.top(); ++y) {
    std::uint8_t* cell = &cells[padded.index_of({inside.x, y})];
    for (std::int32_t x = inside.x; x < inside.right(); ++x, ++cell) {
      const Point center = padded.center_of({x, y});
      const bool is_open =
          radius_um > 0 ? rays.disc_is_free(center, radius_um) : !rays.world().is_occupied(center);
      *cell = is_open ? kOpen : kShut;
    }
  }
  return cells;
}

}  // namespace

std::vector<std::uint8_t> reachable_centers(const RayCaster& rays, const GridFrame& frame,
                                            Cell start, std::int32_t radius_um) {
  std::vector<std::uint8_t> reached(frame.size(), 0);
  if (!frame.contains(start)) return reached;
  const GridFrame padded(frame.cell_um(), frame.window().grown(1));
  std::vector<std::uint8_t> cells = open_cells(rays, padded, radius_um);
  const auto stride = static_cast<std::ptrdiff_t>(padded.width());
  std::vector<std::uint8_t*> to_leave{&cells[padded.index_of(start)]};
  *to_leave.back() = kReached;
  while (!to_leave.empty()) {
    std::uint8_t* const cell = to_leave.back();
    to_leave.pop_back();
    for (std::uint8_t* const next : {cell + 1, cell - 1, cell + stride, cell - stride}) {
      if (*next != kOpen) continue;
      *next = kReached;
      to_leave.push_back(next);
    }
  }
  std::uint8_t* out = reached.data();
  for (std::int32_t y = frame.window().y; y < frame.window().top(); ++y) {
    const std::uint8_t* const row = &cells[padded.index_of({frame.window().x, y})];
    out = std::transform(row, row + frame.width(), out,
                         [](std::uint8_t cell) -> std::uint8_t { return cell == kReached; });
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
