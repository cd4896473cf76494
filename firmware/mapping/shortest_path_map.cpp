#include "firmware/mapping/shortest_path_map.h"

#include <algorithm>

namespace ivfm {

namespace {

// While the map is computed, cells that cannot be stood on carry this instead of kUnreachable.
constexpr std::uint16_t kWall = 0xfffe;

struct Step {
  std::int32_t dx, dy;
  std::uint16_t cost;
};

constexpr std::array<Step, 8> kSteps{{{1, 0, path::kStraight},
                                      {-1, 0, path::kStraight},
                                      {0, 1, path::kStraight},
                                      {0, -1, path::kStraight},
                                      {1, 1, path::kDiagonal},
                                      {-1, 1, path::kDiagonal},
                                      {1, -1, path::kDiagonal},
                                      {-1, -1, path::kDiagonal}}};

}  // namespace

bool ShortestPathMap::is_traversable(const ExplorationMap& map, Cell c) const {
  return !map.is_blocked(c) && (config_.unknown_is_traversable || map.is_known_free(c));
}

std::uint16_t ShortestPathMap::cost_at(const ExplorationMap& map, Cell c) const {
  if (!region_.contains(c)) return path::kUnreachable;
  return map.layers().path_cost[map.frame().index_of(c)];
}

void ShortestPathMap::compute(ExplorationMap& map, Cell robot, const CellRect& region,
                              Clearance clearance) {
  const GridFrame& frame = map.frame();
  const std::span<std::uint16_t> cost = map.layers().path_cost;
  region_ = region.intersection(frame.window().grown(-1));
  robot_ = robot;
  if (!region_.contains(robot)) {
    const CellRect inside = region.intersection(frame.window());
    for (std::int32_t y = inside.y; y < inside.top(); ++y) {
      std::fill_n(cost.begin() + static_cast<std::ptrdiff_t>(frame.index_of({inside.x, y})),
                  inside.width, path::kUnreachable);
    }
    region_ = {};
    return;
  }
  const bool tight = clearance != Clearance::kPreferred && config_.tight_radius_um > 0;
  const std::int32_t tight_radius_um =
      config_.tight_radius_um - (clearance == Clearance::kEscape ? frame.cell_um() / 2 : 0);
  // A ring of walls around the region spares the inner loop all bounds checks.
  const CellRect ring = region_.grown(1);
  const MapLayers& layers = map.layers();
  for (std::int32_t y = ring.y; y < ring.top(); ++y) {
    const std::size_t row = frame.index_of({ring.x, y});
    const bool edge_row = y == ring.y || y == ring.top() - 1;
    for (std::size_t i = row; i < row + static_cast<std::size_t>(ring.width); ++i) {
      bool free = layers.inflation[i] == 0 ||
                  (tight && !map.obstacle_within(frame.cell_of_index(i), tight_radius_um));
      if (!config_.unknown_is_traversable) {
        free = free && (layers.occupancy[i] < 0 || layers.own_visits[i] || layers.peer_visits[i]);
      }
      cost[i] = free && !edge_row ? path::kUnreachable : kWall;
    }
    cost[row] = kWall;
    cost[row + static_cast<std::size_t>(ring.width) - 1] = kWall;
  }
  // A robot that stands too close to an obstacle, or on unknown ground, may drive off.
  const std::int32_t escape =
      std::min<std::int32_t>(kMaxEscapeSide / 2, map.robot_radius_um() / frame.cell_um() + 1);
  const CellRect around = CellRect{robot.x, robot.y, 1, 1}.grown(escape).intersection(region_);
  for (std::int32_t y = around.y; y < around.top(); ++y) {
    for (std::int32_t x = around.x; x < around.right(); ++x) {
      const bool here = robot == Cell{x, y};
      if (here || !map.is_obstacle({x, y})) cost[frame.index_of({x, y})] = path::kUnreachable;
    }
  }
  leaves_outwards_only_ = !tight;
  left_blocked_ground_ = tight || layers.inflation[frame.index_of(robot)] == 0;
  if (!left_blocked_ground_) measure_escape(map, around);
  run(map);
  if (!left_blocked_ground_) {  // squeezed in between obstacles: any way out will do
    for (std::int32_t y = around.y; y < around.top(); ++y) {
      for (std::int32_t x = around.x; x < around.right(); ++x) {
        std::uint16_t& c = cost[frame.index_of({x, y})];
        if (c != kWall) c = path::kUnreachable;
      }
    }
    leaves_outwards_only_ = false;
    run(map);
  }
  for (std::int32_t y = ring.y; y < ring.top(); ++y) {
    const std::size_t row = frame.index_of({ring.x, y});
    for (std::size_t i = row; i < row + static_cast<std::size_t>(ring.width); ++i) {
      cost[i] = cost[i] == kWall ? path::kUnreachable : cost[i];
    }
  }
}

// Distances from the cells of `around` to their nearest known obstacle.
void ShortestPathMap::measure_escape(const ExplorationMap& map, const CellRect& around) {
  escape_rect_ = around;
  escape_clearance2_.fill(0xffff);
  const CellRect near = around.grown(around.width / 2).intersection(map.frame().window());
  for (std::int32_t oy = near.y; oy < near.top(); ++oy) {
    for (std::int32_t ox = near.x; ox < near.right(); ++ox) {
      if (!map.is_obstacle({ox, oy})) continue;
      std::size_t i = 0;
      for (std::int32_t y = around.y; y < around.top(); ++y) {
        for (std::int32_t x = around.x; x < around.right(); ++x, ++i) {
          const auto distance2 =
              static_cast<std::uint16_t>((x - ox) * (x - ox) + (y - oy) * (y - oy));
          escape_clearance2_[i] = std::min(escape_clearance2_[i], distance2);
        }
      }
    }
  }
}

std::uint16_t ShortestPathMap::escape_clearance(const ExplorationMap& map,
                                                std::uint32_t index) const {
  const Cell c = map.frame().cell_of_index(index);
  if (!escape_rect_.contains(c)) return 0;
  return escape_clearance2_[static_cast<std::size_t>((c.y - escape_rect_.y) * escape_rect_.width +
                                                     c.x - escape_rect_.x)];
}

void ShortestPathMap::run(ExplorationMap& map) {
  const auto start = static_cast<std::uint32_t>(map.frame().index_of(robot_));
  sizes_.fill(0);
  queued_ = 0;
  overflowed_ = false;
  map.layers().path_cost[start] = 0;
  push(start, 0);
  std::uint32_t current = 0;
  while (queued_ > 0 || overflowed_) {
    if (queued_ == 0) {  // some cells did not fit the queue: find what they left undone
      overflowed_ = false;
      relax_from_all(map);
      if (queued_ == 0 && !overflowed_) break;
      current = 0;
    }
    std::uint32_t& size = sizes_[current % kBuckets];
    while (size > 0) {
      const std::uint32_t index = entries_[(current % kBuckets) * capacity_ + --size];
      --queued_;
      settle(map, index, map.layers().path_cost[index]);
    }
    ++current;
  }
}

bool ShortestPathMap::push(std::uint32_t index, std::uint16_t cost) {
  std::uint32_t& size = sizes_[cost % kBuckets];
  if (size == capacity_) {
    overflowed_ = true;
    return false;
  }
  entries_[(cost % kBuckets) * capacity_ + size++] = index;
  ++queued_;
  return true;
}

void ShortestPathMap::settle(ExplorationMap& map, std::uint32_t index, std::uint16_t cost) {
  std::uint16_t* const costs = map.layers().path_cost.data();
  const std::uint8_t* const inflation = map.layers().inflation.data();
  const std::int32_t stride = map.frame().width();
  for (const Step& step : kSteps) {
    const auto next =
        static_cast<std::uint32_t>(static_cast<std::int32_t>(index) + step.dy * stride + step.dx);
    const auto through = static_cast<std::uint32_t>(cost) + step.cost;
    if (costs[next] == kWall || through >= costs[next] || through > path::kLongest) continue;
    if (inflation[next] == 0) {
      left_blocked_ground_ = true;
    } else if (leaves_outwards_only_ &&
               (inflation[index] == 0 ||
                escape_clearance(map, next) <= escape_clearance(map, index))) {
      continue;
    }
    costs[next] = static_cast<std::uint16_t>(through);
    push(next, static_cast<std::uint16_t>(through));
  }
}

void ShortestPathMap::relax_from_all(ExplorationMap& map) {
  const GridFrame& frame = map.frame();
  for (std::int32_t y = region_.y; y < region_.top(); ++y) {
    for (std::int32_t x = region_.x; x < region_.right(); ++x) {
      const std::size_t i = frame.index_of({x, y});
      const std::uint16_t cost = map.layers().path_cost[i];
      if (cost <= path::kLongest) settle(map, static_cast<std::uint32_t>(i), cost);
    }
  }
}

}  // namespace ivfm
