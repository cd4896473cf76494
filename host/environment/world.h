// A simulated place: an occupancy bitmap in metres, the truth that robots do not know.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "shared/geometry/pose.h"

namespace ivfm::host {

// Cells row by row from the lowest row (y up). Everything outside the bitmap is occupied.
struct World {
  std::string name;
  std::int32_t cell_um = 0;  // side of a cell in micrometres
  std::int32_t width = 0;    // cells
  std::int32_t height = 0;
  Point origin;                        // lower left corner of cell (0, 0) in the map frame
  std::vector<std::uint8_t> occupied;  // 1 = obstacle, size width * height

  bool is_occupied(Point p) const {
    const std::int64_t dx = std::int64_t{p.x_um} - origin.x_um;
    const std::int64_t dy = std::int64_t{p.y_um} - origin.y_um;
    if (dx < 0 || dy < 0) return true;
    const auto side = static_cast<std::uint32_t>(cell_um);  // 32 bits divide faster than 64
    const std::int64_t cx = static_cast<std::uint32_t>(dx) / side;
    const std::int64_t cy = static_cast<std::uint32_t>(dy) / side;
    if (cx >= width || cy >= height) return true;
    return occupied[static_cast<std::size_t>(cy * width + cx)] != 0;
  }
};

}  // namespace ivfm::host
