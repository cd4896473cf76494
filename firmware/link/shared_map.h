// What the link needs of the robot's map: reading its own layers, writing the others'.
#pragma once

#include <cstdint>
#include <span>

#include "shared/geometry/grid_frame.h"
#include "shared/status/status.h"
#include "shared/wire/layer.h"

namespace ivfm {

class SharedMap {
 public:
  // Copies this robot's own cells of `rect` into `out` (rect.area() bytes, row by row from the
  // lowest row). kOutOfRange: `rect` is not inside the map's window; kInvalidArgument: wrong size.
  virtual Status read_own(Layer layer, const CellRect& rect, std::span<std::uint8_t> out) const = 0;
  // Replaces what the other robots together saw in `rect`; cells outside the window are ignored.
  // kInvalidArgument: `cells` is not rect.area() bytes.
  virtual Status write_peers(Layer layer, const CellRect& rect,
                             std::span<const std::uint8_t> cells) = 0;
  // Takes back what this robot saw in `rect` before it was started again; called once for a cell.
  // Visits are added to those since the start; obstacles count where nothing was seen since. Cells
  // that then differ from what the server said have changed. Codes as write_peers.
  virtual Status restore_own(Layer layer, const CellRect& rect,
                             std::span<const std::uint8_t> cells) = 0;

 protected:
  ~SharedMap() = default;
};

}  // namespace ivfm
