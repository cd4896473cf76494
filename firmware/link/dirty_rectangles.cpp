#include "firmware/link/dirty_rectangles.h"

#include <algorithm>
#include <limits>

namespace ivfm {
namespace {

// Cells that a union covers beyond its two parts; negative when they overlap much.
std::int64_t added_area(const CellRect& a, const CellRect& b) {
  return a.united(b).area() - a.area() - b.area();
}

}  // namespace

void DirtyRectangles::add(const CellRect& rect) {
  if (rect.empty() || current_.contains(rect)) return;
  CellRect grown = rect;
  while (absorb(grown)) {
  }
  if (size_ == kCapacity) make_room(grown);
  table_[size_++] = grown;
}

// Unites `rect` with one rectangle of the table that costs no additional area, and takes that out.
bool DirtyRectangles::absorb(CellRect& rect) {
  for (std::size_t i = 0; i < size_; ++i) {
    if (added_area(table_[i], rect) > 0) continue;
    rect = rect.united(table_[i]);
    remove(i);
    return true;
  }
  return false;
}

// Frees a place in a full table by uniting the pair (`rect` included) that adds the least area.
void DirtyRectangles::make_room(CellRect& rect) {
  std::int64_t least = std::numeric_limits<std::int64_t>::max();
  std::size_t best_i = 0, best_j = kCapacity;  // kCapacity stands for `rect`
  for (std::size_t i = 0; i < kCapacity; ++i) {
    for (std::size_t j = i + 1; j <= kCapacity; ++j) {
      const std::int64_t cost = added_area(table_[i], j == kCapacity ? rect : table_[j]);
      if (cost >= least) continue;
      least = cost;
      best_i = i;
      best_j = j;
    }
  }
  if (best_j == kCapacity) {
    rect = rect.united(table_[best_i]);
    remove(best_i);
  } else {
    table_[best_i] = table_[best_i].united(table_[best_j]);
    remove(best_j);
  }
}

void DirtyRectangles::remove(std::size_t index) {
  for (std::size_t i = index + 1; i < size_; ++i) table_[i - 1] = table_[i];
  --size_;
}

bool DirtyRectangles::intersects(const CellRect& rect) const {
  if (!current_.intersection(rect).empty()) return true;
  for (std::size_t i = 0; i < size_; ++i) {
    if (!table_[i].intersection(rect).empty()) return true;
  }
  return false;
}

// Makes the oldest rectangle the current one; of one that is long in both directions only the
// lowest rows, so that every cut leaves a single rectangle.
void DirtyRectangles::start_next(std::int32_t max_side) {
  if (size_ == 0) return;
  current_ = table_[0];
  if (current_.width <= max_side || current_.height <= max_side) {
    remove(0);
    return;
  }
  current_.height = max_side;
  table_[0].y += max_side;
  table_[0].height -= max_side;
}

CellRect DirtyRectangles::next_piece(std::int32_t max_area, std::int32_t max_side) {
  if (current_.empty()) start_next(max_side);
  if (current_.empty()) return {};
  CellRect piece = current_;
  if (piece.width <= max_side) {
    piece.height = std::min({piece.height, max_side, max_area / piece.width});
  } else {
    piece.width = std::min(max_side, max_area / piece.height);
  }
  return piece;
}

void DirtyRectangles::take(const CellRect& piece) {
  if (piece.width == current_.width) {
    current_.y += piece.height;
    current_.height -= piece.height;
  } else {
    current_.x += piece.width;
    current_.width -= piece.width;
  }
  if (current_.empty()) current_ = {};
}

std::int64_t DirtyRectangles::clip(const CellRect& window) {
  const CellRect kept = current_.intersection(window);
  std::int64_t lost = current_.area() - kept.area();
  current_ = kept;
  for (std::size_t i = size_; i-- > 0;) {
    const CellRect part = table_[i].intersection(window);
    lost += table_[i].area() - part.area();
    table_[i] = part;
    if (part.empty()) remove(i);
  }
  return lost;
}

}  // namespace ivfm
