// Which frontier to look at next, for a robot that sees far: what the view from there would show,
// and what it would spare, for the way there. A "next best view" (Gonzalez-Banos and Latombe, 2002)
// in fixed memory.
#pragma once

#include <cstdint>
#include <optional>

#include "firmware/planning/frontier.h"

namespace ivfm {

// How many unseen cells a robot on `from` would see around it within `reach` cells, when what is
// unknown is free and hides nothing: by 128 rays that end at known obstacles.
std::int32_t unseen_in_view(const ExplorationMap& map, Cell from, std::int32_t reach);

// What looking from a place is worth for the way there. Compare with is_better_than().
struct ViewValue {
  std::int64_t cells = 0;  // to be seen there for the first time, and what closed frontiers count
  std::int64_t path_cost = 1;  // of the way there and a little more, see ShortestPathMap

  constexpr bool is_better_than(const ViewValue& o) const {
    return cells * o.path_cost > o.cells * path_cost;
  }
};

// The value of a view from `stand`. `halves_closed`: 2 for the frontier looked at, 1 for each
// other.
ViewValue value_of_view(const ExplorationMap& map, Cell stand, std::uint16_t path_cost,
                        std::int32_t reach, std::int32_t halves_closed);

// A frontier and what looking at it is worth.
struct FrontierView {
  FrontierGoal goal;
  ViewValue value;
};

// The frontier in `rect` whose view is worth most; no value when none is reachable. Frontier cells
// close to each other count as one frontier. A frontier left behind has to be come back for, so
// each counts as much as a sixth of a whole view when it is looked at, and half of that when it is
// in sight from there; what `teammates` are nearer to counts less. `reach`: of the view, in cells.
// `stand_off`, `min_size`: see nearest_frontier(). Of more than 32 frontiers the nearest are
// weighed. Ties: the lowest cell index.
std::optional<FrontierView> best_frontier_view(const ExplorationMap& map,
                                               const ShortestPathMap& paths,
                                               const Teammates& teammates, const CellRect& rect,
                                               std::int32_t reach, std::int32_t stand_off,
                                               int min_size);

}  // namespace ivfm
