// Cells, rectangles of cells, and the one class that converts between metres and cells.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "shared/geometry/pose.h"

namespace ivfm {

// A cell of the world-wide grid: cell (0, 0) has its lower left corner on the map frame's origin.
// Robots that share a frame and a cell size share cell numbers.
struct Cell {
  std::int32_t x = 0;
  std::int32_t y = 0;
  constexpr bool operator==(const Cell&) const = default;
};

// Cells [x, x + width) by [y, y + height). Empty when a side is 0.
struct CellRect {
  std::int32_t x = 0;
  std::int32_t y = 0;
  std::int32_t width = 0;
  std::int32_t height = 0;

  constexpr bool operator==(const CellRect&) const = default;
  constexpr bool empty() const { return width <= 0 || height <= 0; }
  constexpr std::int64_t area() const { return empty() ? 0 : std::int64_t{width} * height; }
  constexpr std::int32_t right() const { return x + width; }  // first column outside
  constexpr std::int32_t top() const { return y + height; }   // first row outside
  constexpr bool contains(Cell c) const {
    return c.x >= x && c.x < right() && c.y >= y && c.y < top();
  }
  constexpr bool contains(const CellRect& r) const {
    return r.x >= x && r.right() <= right() && r.y >= y && r.top() <= top();
  }
  // The part both cover; empty (all zero) when there is none.
  constexpr CellRect intersection(const CellRect& o) const {
    const std::int32_t x0 = std::max(x, o.x), y0 = std::max(y, o.y);
    const std::int32_t x1 = std::min(right(), o.right()), y1 = std::min(top(), o.top());
    if (x0 >= x1 || y0 >= y1) return {};
    return {x0, y0, x1 - x0, y1 - y0};
  }
  // The minimum bounding rectangle (MBR) of both.
  constexpr CellRect united(const CellRect& o) const {
    if (empty()) return o;
    if (o.empty()) return *this;
    const std::int32_t x0 = std::min(x, o.x), y0 = std::min(y, o.y);
    return {x0, y0, std::max(right(), o.right()) - x0, std::max(top(), o.top()) - y0};
  }
  constexpr CellRect united(Cell c) const { return united(CellRect{c.x, c.y, 1, 1}); }
  constexpr CellRect grown(std::int32_t margin) const {
    return {x - margin, y - margin, width + 2 * margin, height + 2 * margin};
  }
};

// A window of the world grid, stored row by row from its lowest row: metres <-> cells <-> indices.
class GridFrame {
 public:
  constexpr GridFrame() = default;
  // `cell_um`: side of a cell in micrometres (> 0). `window`: the cells stored.
  constexpr GridFrame(std::int32_t cell_um, CellRect window) : cell_um_(cell_um), window_(window) {}

  constexpr std::int32_t cell_um() const { return cell_um_; }
  constexpr const CellRect& window() const { return window_; }
  constexpr std::int32_t width() const { return window_.width; }
  constexpr std::int32_t height() const { return window_.height; }
  constexpr std::size_t size() const { return static_cast<std::size_t>(window_.area()); }

  // The cell that holds `p`, whether or not it lies in the window.
  constexpr Cell cell_at(Point p) const { return {floor_div(p.x_um), floor_div(p.y_um)}; }
  constexpr Point center_of(Cell c) const {
    return {c.x * cell_um_ + cell_um_ / 2, c.y * cell_um_ + cell_um_ / 2};
  }
  constexpr bool contains(Cell c) const { return window_.contains(c); }
  // Index into the stored cells. Requires contains(c).
  constexpr std::size_t index_of(Cell c) const {
    return static_cast<std::size_t>(c.y - window_.y) * static_cast<std::size_t>(window_.width) +
           static_cast<std::size_t>(c.x - window_.x);
  }
  constexpr Cell cell_of_index(std::size_t index) const {
    const auto i = static_cast<std::int32_t>(index);
    return {window_.x + i % window_.width, window_.y + i / window_.width};
  }

 private:
  constexpr std::int32_t floor_div(std::int32_t v) const {
    const std::int32_t q = v / cell_um_;
    return q - (v % cell_um_ < 0 ? 1 : 0);
  }

  std::int32_t cell_um_ = 1;
  CellRect window_;
};

}  // namespace ivfm
