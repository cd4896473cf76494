#include "firmware/planning/path_planner.h"

#include <cstdlib>

namespace ivfm {

namespace {

// Integer square root, rounded down.
constexpr std::int64_t square_root(std::int64_t value) {
  std::int64_t root = 0;
  for (std::int64_t bit = std::int64_t{1} << 31; bit != 0; bit >>= 1) {
    const std::int64_t candidate = root + bit;
    if (candidate * candidate <= value) root = candidate;
  }
  return root;
}

// The neighbour from which `c` is reached most cheaply; `c` itself when there is none.
Cell downhill(const ExplorationMap& map, const ShortestPathMap& paths, Cell c) {
  Cell best = c;
  std::uint16_t best_cost = paths.cost_at(map, c);
  for (std::int32_t dy = -1; dy <= 1; ++dy) {
    for (std::int32_t dx = -1; dx <= 1; ++dx) {
      const Cell n{c.x + dx, c.y + dy};
      const std::uint16_t cost = paths.cost_at(map, n);
      if (cost >= best_cost) continue;
      best = n;
      best_cost = cost;
    }
  }
  return best;
}

}  // namespace

void WaypointPath::push_front(Point p) {
  if (first_ == 0) {
    for (std::size_t i = kMaxWaypoints - 1; i > 0; --i) points_[i] = points_[i - 1];
    points_[0] = p;
    return;
  }
  points_[--first_] = p;
}

std::int64_t WaypointPath::length_um(Point start) const {
  std::int64_t length = 0;
  for (const Point& p : points()) {
    length += square_root(squared_distance_um2(start, p));
    start = p;
  }
  return length;
}

bool line_is_traversable(const ExplorationMap& map, const ShortestPathMap& paths, Cell a, Cell b) {
  const std::int32_t dx = std::abs(b.x - a.x), dy = std::abs(b.y - a.y);
  const std::int32_t sx = a.x < b.x ? 1 : -1, sy = a.y < b.y ? 1 : -1;
  std::int32_t error = dx - dy;
  // Diagonal steps may cut corners, as in the shortest path map: obstacles are inflated.
  while (!(a == b)) {
    if (paths.cost_at(map, a) == path::kUnreachable) return false;
    const std::int32_t twice = 2 * error;
    const bool step_x = twice > -dy, step_y = twice < dx;
    if (step_x) {
      error -= dy;
      a.x += sx;
    }
    if (step_y) {
      error += dx;
      a.y += sy;
    }
  }
  return paths.cost_at(map, b) != path::kUnreachable;
}

Status plan_path(const ExplorationMap& map, const ShortestPathMap& paths, Cell goal,
                 WaypointPath& out) {
  out.clear();
  if (paths.cost_at(map, goal) == path::kUnreachable) return Status::kUnavailable;
  Cell anchor = goal, previous = goal;
  out.push_front(map.frame().center_of(goal));
  for (Cell c = downhill(map, paths, goal); !(c == previous); c = downhill(map, paths, c)) {
    if (!line_is_traversable(map, paths, c, anchor)) {
      out.push_front(map.frame().center_of(previous));
      anchor = previous;
    }
    previous = c;
  }
  return Status::kOk;
}

}  // namespace ivfm
