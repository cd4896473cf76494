// The regions of a layer that the server does not know yet: a table of rectangles of fixed size.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "shared/geometry/grid_frame.h"

namespace ivfm {

// Never loses a cell: when the table is full, the two rectangles whose union adds the least area
// become one. Oldest first out.
class DirtyRectangles {
 public:
  static constexpr std::size_t kCapacity = 48;

  // Adds the cells of `rect`; does nothing for an empty one.
  void add(const CellRect& rect);
  bool empty() const { return size_ == 0 && current_.empty(); }
  // True when a cell of `rect` is dirty, or may be (unions cover more than was added).
  bool intersects(const CellRect& rect) const;

  // A part of the oldest rectangle: at most `max_area` cells (>= max_side) and `max_side` to a
  // side; empty when nothing is dirty. The next call gives the same, until take() or add().
  CellRect next_piece(std::int32_t max_area, std::int32_t max_side);
  // Removes a piece that next_piece() has just given.
  void take(const CellRect& piece);

  // Forgets what lies outside `window`; returns how many cells that were.
  std::int64_t clip(const CellRect& window);

 private:
  void remove(std::size_t index);
  bool absorb(CellRect& rect);
  void make_room(CellRect& rect);
  void start_next(std::int32_t max_side);

  // The rectangle being cut into pieces, then the others, oldest first.
  CellRect current_;
  std::array<CellRect, kCapacity> table_{};
  std::size_t size_ = 0;
};

}  // namespace ivfm
