// Frontiers: the border between what has been seen and what has not (Yamauchi, 1997).
#pragma once

#include <cstdint>
#include <optional>

#include "firmware/mapping/exploration_map.h"
#include "firmware/mapping/shortest_path_map.h"
#include "firmware/planning/teammates.h"

namespace ivfm {

// Whether `c` is unseen, not an obstacle, not given up, and next to a cell that was seen free.
bool is_frontier(const ExplorationMap& map, Cell c);

// Whether at least `min_size` cells of the 5 x 5 around frontier cell `c` are frontier cells:
// single ones are the lidar's noise along walls.
bool is_wide_frontier(const ExplorationMap& map, Cell c, int min_size);

// A frontier and the cell from which to look at it.
struct FrontierGoal {
  Cell frontier;
  Cell stand;               // reachable, within `stand_off` cells of the frontier
  std::uint16_t path_cost;  // from the robot to `stand`, see ShortestPathMap
  bool operator==(const FrontierGoal&) const = default;
};

// The frontier itself where it can be reached, else the cheapest cell within `stand_off` of it; no
// value when there is none.
std::optional<FrontierGoal> best_stand(const ExplorationMap& map, const ShortestPathMap& paths,
                                       Cell frontier, std::int32_t stand_off);

// Calls visit(cell) for every frontier cell of `rect` until it returns false.
template <typename Visit>
void for_each_frontier(const ExplorationMap& map, const CellRect& rect, Visit visit) {
  const CellRect inside = rect.intersection(map.frame().window().grown(-1));
  for (std::int32_t y = inside.y; y < inside.top(); ++y) {
    for (std::int32_t x = inside.x; x < inside.right(); ++x) {
      if (is_frontier(map, {x, y}) && !visit(Cell{x, y})) return;
    }
  }
}

// The frontier in `rect` whose standing place costs least to reach by the last computed shortest
// path map; no value when none is reachable. A frontier that cannot be stood
// on, such as one along a wall, is looked at from up to `stand_off` cells away. `min_size`: see
// is_wide_frontier(). Ties: lowest cell index.
std::optional<FrontierGoal> nearest_frontier(const ExplorationMap& map,
                                             const ShortestPathMap& paths, const CellRect& rect,
                                             std::int32_t stand_off, int min_size);

// Where most is left to see for the way there, for robots that may drive into the unknown: the
// region of `side` x `side` cells (an even number) of `rect` with the most unseen cells in reach,
// divided by the path to the nearest of them and `way` cells more, less what `teammates` are nearer
// to. Regions overlap by half.
// `frontier` and `stand` are the unseen cell nearest to the middle of the region's unseen cells. No
// value when every region holds fewer than `least` such cells. Ties: lowest row, then column.
std::optional<FrontierGoal> richest_region(const ExplorationMap& map, const ShortestPathMap& paths,
                                           const Teammates& teammates, const CellRect& rect,
                                           std::int32_t side, std::int32_t way, std::int32_t least);

// How many unseen cells of `rect` can be driven to.
std::int32_t count_reachable_unseen(const ExplorationMap& map, const ShortestPathMap& paths,
                                    const CellRect& rect);

// Whether `rect` holds at least `count` frontier cells that nearest_frontier could choose.
bool has_reachable_frontier(const ExplorationMap& map, const ShortestPathMap& paths,
                            const CellRect& rect, std::int32_t stand_off, int count);

}  // namespace ivfm
