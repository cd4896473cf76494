#include "firmware/planning/frontier.h"

#include <algorithm>
#include <array>
#include <limits>

namespace ivfm {

namespace {

// What a region holds of unseen cells in reach.
struct Region {
  CellRect rect;
  std::int64_t cells = 0, sum_x = 0, sum_y = 0;
  std::int32_t nearest_cost = path::kUnreachable;

  Cell middle() const {
    return {static_cast<std::int32_t>(sum_x / cells), static_cast<std::int32_t>(sum_y / cells)};
  }
  Region united(const Region& o) const {
    return {rect.united(o.rect), cells + o.cells, sum_x + o.sum_x, sum_y + o.sum_y,
            std::min(nearest_cost, o.nearest_cost)};
  }
};

// A row of cells that a shortest path map covers.
class UnseenRow {
 public:
  UnseenRow(const ExplorationMap& map, Cell first)
      : layers_(map.layers()), first_(map.frame().index_of(first)) {}

  // The cost of driving to the row's cell `x` if it is unseen and was not given up; kUnreachable
  // for all others.
  std::uint16_t cost(std::int32_t x) const {
    const std::size_t i = first_ + static_cast<std::size_t>(x);
    const std::uint16_t cost = layers_.path_cost[i];
    const bool ruled_out = (layers_.own_visits[i] | layers_.peer_visits[i] |
                            (layers_.flags[i] & cell_flag::kGivenUp)) != 0;
    return ruled_out ? path::kUnreachable : cost;
  }

 private:
  const MapLayers& layers_;
  std::size_t first_;
};

// Requires `rect` within paths.region(). First reads a part of a row, then counts: compilers make
// loops over many cells at once of both, but not of the two together.
Region survey(const ExplorationMap& map, const CellRect& rect) {
  constexpr std::int32_t kPart = 16;
  std::array<std::uint16_t, kPart> costs;
  Region region{rect};
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    const UnseenRow row(map, {rect.x, y});
    std::int32_t cells = 0, sum_x = 0;  // from the rectangle's edge
    for (std::int32_t first = 0; first < rect.width; first += kPart) {
      const std::int32_t size = std::min(kPart, rect.width - first);
      for (std::int32_t i = 0; i < size; ++i)
        costs[static_cast<std::size_t>(i)] = row.cost(first + i);
      for (std::int32_t i = 0; i < size; ++i) {
        const std::int32_t cost = costs[static_cast<std::size_t>(i)];
        cells += cost != path::kUnreachable ? 1 : 0;
        sum_x += cost != path::kUnreachable ? first + i : 0;
        region.nearest_cost = std::min(region.nearest_cost, cost);
      }
    }
    region.cells += cells;
    region.sum_x += std::int64_t{cells} * rect.x + sum_x;
    region.sum_y += std::int64_t{cells} * y;
  }
  return region;
}

// The unseen cell in reach that lies nearest to the middle of all of the region's.
FrontierGoal middle_of(const ExplorationMap& map, const Region& region) {
  FrontierGoal best{{}, {}, path::kUnreachable};
  std::int64_t best_distance = std::numeric_limits<std::int64_t>::max();
  const CellRect& rect = region.rect;
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    const UnseenRow row(map, {rect.x, y});
    const std::int64_t dy = y * region.cells - region.sum_y;
    for (std::int32_t x = rect.x; x < rect.right(); ++x) {
      const std::uint16_t cost = row.cost(x - rect.x);
      if (cost == path::kUnreachable) continue;
      const std::int64_t dx = x * region.cells - region.sum_x;
      if (dx * dx + dy * dy >= best_distance) continue;
      best_distance = dx * dx + dy * dy;
      best = {{x, y}, {x, y}, cost};
    }
  }
  return best;
}

}  // namespace

bool is_frontier(const ExplorationMap& map, Cell c) {
  const MapLayers& layers = map.layers();
  const GridFrame& frame = map.frame();
  if (!frame.contains(c)) return false;
  const std::size_t i = frame.index_of(c);
  constexpr std::uint8_t kRuledOut = cell_flag::kObstacle | cell_flag::kGivenUp;
  if (layers.own_visits[i] || layers.peer_visits[i] || (layers.flags[i] & kRuledOut)) return false;
  const auto is_seen_free = [&](std::size_t n) {
    return (layers.own_visits[n] | layers.peer_visits[n]) != 0 &&
           (layers.flags[n] & cell_flag::kObstacle) == 0;
  };
  const CellRect& window = frame.window();
  const auto stride = static_cast<std::size_t>(window.width);
  return (c.x + 1 < window.right() && is_seen_free(i + 1)) ||
         (c.x > window.x && is_seen_free(i - 1)) ||
         (c.y + 1 < window.top() && is_seen_free(i + stride)) ||
         (c.y > window.y && is_seen_free(i - stride));
}

std::optional<FrontierGoal> best_stand(const ExplorationMap& map, const ShortestPathMap& paths,
                                       Cell frontier, std::int32_t stand_off) {
  FrontierGoal best{frontier, frontier, paths.cost_at(map, frontier)};
  if (best.path_cost != path::kUnreachable) return best;
  const CellRect near =
      CellRect{frontier.x, frontier.y, 1, 1}.grown(stand_off).intersection(paths.region());
  for (std::int32_t y = near.y; y < near.top(); ++y) {
    for (std::int32_t x = near.x; x < near.right(); ++x) {
      const std::uint16_t cost = paths.cost_at(map, {x, y});
      if (cost >= best.path_cost) continue;
      best.path_cost = cost;
      best.stand = {x, y};
    }
  }
  if (best.path_cost == path::kUnreachable) return std::nullopt;
  return best;
}

bool is_wide_frontier(const ExplorationMap& map, Cell c, int min_size) {
  int size = 0;
  for (std::int32_t y = c.y - 2; y <= c.y + 2; ++y) {
    for (std::int32_t x = c.x - 2; x <= c.x + 2; ++x) {
      size += is_frontier(map, {x, y}) ? 1 : 0;
      if (size >= min_size) return true;
    }
  }
  return false;
}

std::optional<FrontierGoal> nearest_frontier(const ExplorationMap& map,
                                             const ShortestPathMap& paths, const CellRect& rect,
                                             std::int32_t stand_off, int min_size) {
  std::optional<FrontierGoal> best;
  for_each_frontier(map, rect, [&](Cell c) {
    const auto candidate = best_stand(map, paths, c, stand_off);
    if (!candidate || (best && candidate->path_cost >= best->path_cost)) return true;
    if (is_wide_frontier(map, c, min_size)) best = candidate;
    return true;
  });
  return best;
}

bool has_reachable_frontier(const ExplorationMap& map, const ShortestPathMap& paths,
                            const CellRect& rect, std::int32_t stand_off, int count) {
  int found = 0;
  for_each_frontier(map, rect, [&](Cell c) {
    found += best_stand(map, paths, c, stand_off).has_value() ? 1 : 0;
    return found < count;
  });
  return found >= count;
}

std::optional<FrontierGoal> richest_region(const ExplorationMap& map, const ShortestPathMap& paths,
                                           const Teammates& teammates, const CellRect& rect,
                                           std::int32_t side, std::int32_t way,
                                           std::int32_t least) {
  const CellRect all = paths.region().intersection(rect);
  const std::int32_t half = side / 2, detour = way * path::kStraight;
  const auto half_at = [&](std::int32_t x, std::int32_t y) {
    return survey(map, CellRect{x, y, half, side}.intersection(all));
  };
  Region best;
  std::int64_t best_worth = 0, best_cost = 1;
  for (std::int32_t y = all.y; y < all.top(); y += half) {
    Region right = half_at(all.x, y);
    for (std::int32_t x = all.x; x < all.right(); x += half) {
      const Region left = right;
      right = half_at(x + half, y);
      const Region region = left.united(right);
      if (region.cells < std::max<std::int32_t>(least, 1)) continue;
      const std::int32_t way_inside = side / 4 * path::kStraight;  // to its middle
      const std::int64_t worth =
          region.cells *
          teammates.share_left(region.middle(), region.nearest_cost + way_inside, detour);
      const std::int64_t cost = region.nearest_cost + detour;
      if (worth * best_cost <= best_worth * cost) continue;
      best = region;
      best_worth = worth;
      best_cost = cost;
    }
  }
  if (best.cells == 0) return std::nullopt;
  return middle_of(map, best);
}

std::int32_t count_reachable_unseen(const ExplorationMap& map, const ShortestPathMap& paths,
                                    const CellRect& rect) {
  return static_cast<std::int32_t>(survey(map, rect.intersection(paths.region())).cells);
}

}  // namespace ivfm
