#include "firmware/planning/path_planner.h"

#include <cstdlib>

#include "shared/geometry/integer_sqrt.h"

namespace ivfm {

namespace {

// Whether `holds` is true of every cell on the straight line from `a` to `b` (Bresenham).
template <typename Predicate>
bool every_cell_on_line(Cell a, Cell b, Predicate holds) {
  const std::int32_t dx = std::abs(b.x - a.x), dy = std::abs(b.y - a.y);
  const std::int32_t sx = a.x < b.x ? 1 : -1, sy = a.y < b.y ? 1 : -1;
  std::int32_t error = dx - dy;
  while (holds(a)) {
    if (a == b) return true;
    const std::int32_t twice = 2 * error;
    if (twice > -dy) {
      error -= dy;
      a.x += sx;
    }
    if (twice < dx) {
      error += dx;
      a.y += sy;
    }
  }
  return false;
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
    length += integer_sqrt(static_cast<std::uint64_t>(squared_distance_um2(start, p)));
    start = p;
  }
  return length;
}

bool line_is_traversable(const ExplorationMap& map, const ShortestPathMap& paths, Cell a, Cell b) {
  // Diagonal steps may cut corners, as in the shortest path map: obstacles are inflated.
  return every_cell_on_line(a, b,
                            [&](Cell c) { return paths.cost_at(map, c) != path::kUnreachable; });
}

bool line_is_blocked(const ExplorationMap& map, Cell a, Cell b, std::int32_t leave) {
  return !every_cell_on_line(a, b, [&](Cell c) { return leave-- > 0 || !map.is_blocked(c); });
}

bool line_is_clear(const ExplorationMap& map, Cell a, Cell b) {
  return every_cell_on_line(a, b, [&](Cell c) { return !map.is_obstacle(c); });
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
