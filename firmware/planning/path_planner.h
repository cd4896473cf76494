// Turns the shortest path map into a few waypoints: descent from the goal, then string pulling.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "firmware/mapping/exploration_map.h"
#include "firmware/mapping/shortest_path_map.h"
#include "shared/geometry/pose.h"

namespace ivfm {

// Waypoints in driving order, without the robot's own position. Fixed memory.
class WaypointPath {
 public:
  static constexpr std::size_t kMaxWaypoints = 64;

  std::span<const Point> points() const {
    return {points_.data() + first_, kMaxWaypoints - first_};
  }
  bool empty() const { return first_ == kMaxWaypoints; }
  void clear() { first_ = kMaxWaypoints; }
  // Adds a waypoint in front of the others. When the path is full the last waypoint is dropped:
  // what is far away will be planned again on the way.
  void push_front(Point p);
  // Length from `start` through all waypoints in micrometres.
  std::int64_t length_um(Point start) const;

 private:
  std::array<Point, kMaxWaypoints> points_{};
  std::size_t first_ = kMaxWaypoints;
};

// Whether the straight line of cells from `a` to `b` is traversable.
bool line_is_traversable(const ExplorationMap& map, const ShortestPathMap& paths, Cell a, Cell b);

// Whether a known obstacle has come into the way of a robot driving the straight line of cells from
// `a` to `b`; the first `leave` cells do not count.
bool line_is_blocked(const ExplorationMap& map, Cell a, Cell b, std::int32_t leave);

// Whether nothing known to be an obstacle stands between `a` and `b`.
bool line_is_clear(const ExplorationMap& map, Cell a, Cell b);

// Fills `out` with the waypoints from the robot (where the shortest path map was computed) to
// `goal`. kUnavailable: the goal is out of reach.
Status plan_path(const ExplorationMap& map, const ShortestPathMap& paths, Cell goal,
                 WaypointPath& out);

}  // namespace ivfm
