#include "firmware/planning/teammates.h"

#include <algorithm>
#include <cstdlib>

namespace ivfm {

namespace {

// Of a path without obstacles.
std::int32_t open_path_cost(Cell from, Cell to) {
  const std::int32_t dx = std::abs(to.x - from.x), dy = std::abs(to.y - from.y);
  const std::int32_t diagonal = std::min(dx, dy);
  return diagonal * path::kDiagonal + (std::max(dx, dy) - diagonal) * path::kStraight;
}

}  // namespace

void Teammates::set(std::span<const Cell> places) {
  size_ = std::min(places.size(), kMost);
  std::copy_n(places.begin(), size_, places_.begin());
}

std::int32_t Teammates::share_left(Cell goal, std::int32_t path_cost, std::int32_t detour) const {
  std::int32_t nearest = path_cost;
  for (const Cell place : places()) {
    nearest = std::min(nearest, open_path_cost(place, goal));
  }
  return nearest == path_cost ? kWhole : kWhole * (nearest + detour) / (path_cost + detour);
}

}  // namespace ivfm
