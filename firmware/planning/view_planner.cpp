#include "firmware/planning/view_planner.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <span>

#include "firmware/planning/path_planner.h"
#include "shared/geometry/binary_angle.h"

namespace ivfm {

namespace {

constexpr int kRays = 128;

// Frontiers, each with its cheapest standing place. Fixed memory.
class FrontierTable {
 public:
  explicit FrontierTable(std::int32_t side) : side_(side) {}

  // Adds a frontier cell: to the frontier that it is close to, else as a new one. A full table
  // drops the most costly.
  void add(const FrontierGoal& goal) {
    for (Entry& entry : entries()) {
      if (std::abs(entry.first.x - goal.frontier.x) > side_) continue;
      if (std::abs(entry.first.y - goal.frontier.y) > side_) continue;
      if (goal.path_cost < entry.goal.path_cost) entry.goal = goal;
      return;
    }
    if (size_ < entries_.size()) {
      entries_[size_++] = {goal.frontier, goal};
      return;
    }
    Entry& worst = *std::max_element(
        entries_.begin(), entries_.end(),
        [](const Entry& a, const Entry& b) { return a.goal.path_cost < b.goal.path_cost; });
    if (goal.path_cost < worst.goal.path_cost) worst = {goal.frontier, goal};
  }

  struct Entry {
    Cell first;  // the frontier cell that was found first
    FrontierGoal goal;
  };
  std::span<Entry> entries() { return {entries_.data(), size_}; }

 private:
  std::int32_t side_;
  std::array<Entry, 32> entries_;
  std::size_t size_ = 0;
};

// How many other frontiers a robot at `entry` would see within `reach`.
std::int32_t others_in_sight(const ExplorationMap& map, std::span<FrontierTable::Entry> all,
                             const FrontierTable::Entry& entry, std::int32_t reach) {
  std::int32_t count = 0;
  for (const FrontierTable::Entry& other : all) {
    const Cell from = entry.goal.stand, to = other.goal.frontier;
    const std::int32_t dx = to.x - from.x, dy = to.y - from.y;
    if (&other == &entry || dx * dx + dy * dy > reach * reach) continue;
    count += line_is_clear(map, from, to) ? 1 : 0;
  }
  return count;
}

// Added to each way: tiny ways to tiny gains lose.
std::int32_t detour_of(std::int32_t reach) { return reach * 4 / 15 * path::kStraight; }

ViewValue value_of(std::int64_t unseen, std::uint16_t path_cost, std::int32_t reach,
                   std::int64_t halves_closed) {
  const std::int64_t half = reach * reach / 4;  // a twelfth of the view's circle
  return {unseen + half * halves_closed, std::int64_t{path_cost} + detour_of(reach)};
}

}  // namespace

std::int32_t unseen_in_view(const ExplorationMap& map, Cell from, std::int32_t reach) {
  const MapLayers& layers = map.layers();
  const GridFrame& frame = map.frame();
  std::int64_t sum = 0;  // a cell r cells away stands for r / kRays of the circle through it
  for (int ray = 0; ray < kRays; ++ray) {
    const BinaryAngle direction(static_cast<std::uint16_t>(ray * (65536 / kRays)));
    const std::int32_t dx = cos_q30(direction) >> 14, dy = sin_q30(direction) >> 14;  // Q16
    std::int32_t x = 0x8000, y = 0x8000;  // from the robot's cell, Q16, rounding
    for (std::int32_t r = 1; r <= reach; ++r) {
      x += dx;
      y += dy;
      const Cell c{from.x + (x >> 16), from.y + (y >> 16)};
      const bool inside = frame.contains(c);  // what lies outside is unknown
      const std::size_t i = inside ? frame.index_of(c) : 0;
      if (inside && (layers.flags[i] & cell_flag::kObstacle)) break;
      if (!inside || (layers.own_visits[i] | layers.peer_visits[i]) == 0) sum += r;
    }
  }
  return static_cast<std::int32_t>((sum * 411'775) >> 23);  // 2 pi / kRays
}

ViewValue value_of_view(const ExplorationMap& map, Cell stand, std::uint16_t path_cost,
                        std::int32_t reach, std::int32_t halves_closed) {
  return value_of(unseen_in_view(map, stand, reach), path_cost, reach, halves_closed);
}

std::optional<FrontierView> best_frontier_view(const ExplorationMap& map,
                                               const ShortestPathMap& paths,
                                               const Teammates& teammates, const CellRect& rect,
                                               std::int32_t reach, std::int32_t stand_off,
                                               int min_size) {
  FrontierTable table(reach / 3);
  for_each_frontier(map, rect, [&](Cell c) {
    if (!is_wide_frontier(map, c, min_size)) return true;
    if (const auto goal = best_stand(map, paths, c, stand_off)) table.add(*goal);
    return true;
  });
  std::optional<FrontierView> best;
  for (const FrontierTable::Entry& entry : table.entries()) {
    // No view shows more than its whole circle, nor closes more than all frontiers.
    const ViewValue most = value_of(std::int64_t{4} * reach * reach, entry.goal.path_cost, reach,
                                    1 + static_cast<std::int64_t>(table.entries().size()));
    if (best && !most.is_better_than(best->value)) continue;
    const std::int32_t others = others_in_sight(map, table.entries(), entry, reach * 2 / 3);
    ViewValue value = value_of_view(map, entry.goal.stand, entry.goal.path_cost, reach, 2 + others);
    value.cells *= teammates.share_left(entry.goal.stand, entry.goal.path_cost, detour_of(reach));
    value.cells /= Teammates::kWhole;
    if (!best || value.is_better_than(best->value)) best = FrontierView{entry.goal, value};
  }
  return best;
}

}  // namespace ivfm
