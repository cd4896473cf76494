#include "firmware/mapping/shortest_path_map.h"

#include <algorithm>
#include <utility>

namespace ivfm {

namespace {

// While the map is computed, cells that cannot be stood on carry this instead of kUnreachable.
constexpr std::uint16_t kWall = 0xfffe;

// Directions count counterclockwise from east: straight ones are even.
struct Step {
  std::int32_t dx, dy;
  std::uint16_t cost;
};

constexpr std::uint32_t kDirections = 8;
constexpr std::array<Step, kDirections> kSteps{{{1, 0, path::kStraight},
                                                {1, 1, path::kDiagonal},
                                                {0, 1, path::kStraight},
                                                {-1, 1, path::kDiagonal},
                                                {-1, 0, path::kStraight},
                                                {-1, -1, path::kDiagonal},
                                                {0, -1, path::kStraight},
                                                {1, -1, path::kDiagonal}}};

// A queued cell: its index, and above that the direction of the step that reached it.
constexpr int kDirectionShift = 28;
constexpr std::uint32_t kIndexMask = (1u << kDirectionShift) - 1;
constexpr std::uint32_t kNoDirection = kDirections;

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
  for (std::uint32_t i = 0; i < kDirections; ++i) {
    offsets_[i] = kSteps[i].dy * map.frame().width() + kSteps[i].dx;
  }
  sizes_.fill(0);
  queued_ = 0;
  overflowed_ = false;
  map.layers().path_cost[start] = 0;
  push(start, kNoDirection, 0);
  std::uint32_t current = 0;
  while (queued_ > 0 || overflowed_) {
    if (queued_ == 0) {  // some cells did not fit the queue: find what they left undone
      overflowed_ = false;
      relax_from_all(map);
      if (queued_ == 0 && !overflowed_) break;
      current = 0;
    }
    drain(map, current++ % kBuckets);
  }
}

// Settles the cells of a bucket. No step is as long as the ring, so none comes back into it.
void ShortestPathMap::drain(ExplorationMap& map, std::uint32_t bucket) {
  const std::uint16_t* const costs = map.layers().path_cost.data();
  const std::uint32_t* const entries = entries_.data() + bucket * capacity_;
  const std::uint32_t size = std::exchange(sizes_[bucket], 0);
  queued_ -= size;
  for (std::uint32_t i = size; i-- > 0;) {
    const std::uint32_t index = entries[i] & kIndexMask;
    if (costs[index] % kBuckets != bucket) continue;  // reached for less since
    settle(map, index, entries[i] >> kDirectionShift);
  }
}

inline void ShortestPathMap::push(std::uint32_t index, std::uint32_t direction,
                                  std::uint16_t cost) {
  std::uint32_t& size = sizes_[cost % kBuckets];
  if (size == capacity_) {
    overflowed_ = true;
    return;
  }
  entries_[(cost % kBuckets) * capacity_ + size++] = index | direction << kDirectionShift;
  ++queued_;
}

// Goes on from a cell that was reached by a step in `direction`. On open ground most of its
// neighbours are reached from the cell before it for no more, past this one: those are left out,
// as in jump point search (Harabor and Grastien 2011). A straight step goes on straight, a diagonal
// one also along its two parts; where the ground beside is not open, also around that corner.
void ShortestPathMap::settle(ExplorationMap& map, std::uint32_t index, std::uint32_t direction) {
  std::uint16_t* const costs = map.layers().path_cost.data();
  const std::uint8_t* const inflation = map.layers().inflation.data();
  const std::uint32_t here = costs[index];
  const auto neighbour = [&](std::uint32_t to) {
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(index) + offsets_[to]);
  };
  const auto is_open = [&](std::uint32_t to) {
    const std::uint32_t next = neighbour(to % kDirections);
    return costs[next] != kWall && inflation[next] == 0;
  };
  const auto go = [&](std::uint32_t to) {
    to %= kDirections;
    const std::uint32_t next = neighbour(to), cost = here + kSteps[to].cost;
    if (cost >= costs[next] || costs[next] == kWall || cost > path::kLongest) return;
    if (inflation[next] == 0) {
      left_blocked_ground_ = true;
    } else if (leaves_outwards_only_ && !leads_outwards(map, index, next)) {
      return;
    }
    costs[next] = static_cast<std::uint16_t>(cost);
    push(next, to, static_cast<std::uint16_t>(cost));
  };
  if (direction == kNoDirection || inflation[index] != 0) {
    for (std::uint32_t to = 0; to < kDirections; ++to) go(to);
    return;
  }
  go(direction);
  std::uint32_t side = 2;  // how far the ground beside the step's start lies to the left and right
  if (direction % 2 != 0) {
    go(direction + 1);
    go(direction - 1);
    side = 3;
  }
  if (!is_open(direction + side)) go(direction + side - 1);
  if (!is_open(direction - side)) go(direction - side + 1);
}

bool ShortestPathMap::leads_outwards(const ExplorationMap& map, std::uint32_t from,
                                     std::uint32_t to) const {
  return map.layers().inflation[from] != 0 &&
         escape_clearance(map, to) > escape_clearance(map, from);
}

void ShortestPathMap::relax_from_all(ExplorationMap& map) {
  const GridFrame& frame = map.frame();
  for (std::int32_t y = region_.y; y < region_.top(); ++y) {
    for (std::int32_t x = region_.x; x < region_.right(); ++x) {
      const std::size_t i = frame.index_of({x, y});
      const std::uint16_t cost = map.layers().path_cost[i];
      if (cost <= path::kLongest) settle(map, static_cast<std::uint32_t>(i), kNoDirection);
    }
  }
}

}  // namespace ivfm
