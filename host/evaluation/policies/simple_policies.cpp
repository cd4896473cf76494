#include "host/evaluation/policies/simple_policies.h"

#include <algorithm>
#include <limits>
#include <optional>

#include "firmware/planning/frontier.h"

namespace ivfm::host {

namespace {

constexpr std::size_t kLeastFrontier = 3;  // cells; smaller ones are slivers

// The connected frontiers (eight neighbours) of what the robot knows.
std::vector<std::vector<Cell>> connected_frontiers(const ExplorationMap& map,
                                                   const CellRect& rect) {
  const GridFrame grid(1, rect);
  std::vector<std::uint8_t> is_open(grid.size(), 0);
  for (std::size_t i = 0; i < grid.size(); ++i)
    is_open[i] = is_frontier(map, grid.cell_of_index(i));
  std::vector<std::vector<Cell>> frontiers;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    if (is_open[i] == 0) continue;
    std::vector<Cell> members{grid.cell_of_index(i)};
    is_open[i] = 0;
    for (std::size_t next = 0; next < members.size(); ++next) {
      for (int k = 0; k < 9; ++k) {
        const Cell n{members[next].x + k % 3 - 1, members[next].y + k / 3 - 1};
        if (!grid.contains(n) || is_open[grid.index_of(n)] == 0) continue;
        is_open[grid.index_of(n)] = 0;
        members.push_back(n);
      }
    }
    if (members.size() >= kLeastFrontier) frontiers.push_back(std::move(members));
  }
  return frontiers;
}

// The cost of the shortest move worth making. With the arena's camera a move takes its first view
// after 60 mm and ends with the robot's front at the goal: shorter moves show nothing.
std::uint16_t least_move_cost(const EnvironmentConfig& config) {
  if (config.sensor == SensorModel::kLidar) return 0;
  const std::int32_t least_um = config.front_um + config.view_every_steps * 1'000 + config.cell_um;
  return static_cast<std::uint16_t>(least_um * path::kStraight / config.cell_um);
}

// The first action of a robot whose first view does not count: nothing is seen yet, so there is no
// frontier. Drives to the goal that lies furthest ahead.
StepResult step_ahead(ExplorationEnvironment& env, int agent) {
  env.observe(agent);
  const BinaryAngle heading = env.pose(agent).heading;
  const std::int64_t c = cos_q30(heading), s = sin_q30(heading);
  int best = 0;
  std::int64_t furthest = std::numeric_limits<std::int64_t>::min();
  for (int i = 0; i < kPolicyGridSize; ++i) {
    if (!env.goal_mask(agent)[static_cast<std::size_t>(i)]) continue;
    const std::int64_t ahead =
        (i % kPolicyCells - kPolicyCells / 2) * c + (i / kPolicyCells - kPolicyCells / 2) * s;
    if (ahead <= furthest) continue;
    furthest = ahead;
    best = i;
  }
  return env.step(agent, best);
}

// `to`, pulled back along the line from `from` until it lies inside the world.
Point pulled_inside(Point from, Point to, const World& world) {
  const std::int32_t x1 = world.origin.x_um + world.width * world.cell_um;
  const std::int32_t y1 = world.origin.y_um + world.height * world.cell_um;
  const auto share = [](std::int32_t a, std::int32_t b, std::int32_t low, std::int32_t high) {
    if (b >= low && b <= high) return 1.0;
    return (static_cast<double>(b < low ? low : high) - a) / (static_cast<double>(b) - a);
  };
  const double s = std::min(share(from.x_um, to.x_um, world.origin.x_um, x1),
                            share(from.y_um, to.y_um, world.origin.y_um, y1));
  const auto along = [s](std::int32_t a, std::int32_t b) {
    return static_cast<std::int32_t>(a + s * (static_cast<double>(b) - a));
  };
  return {along(from.x_um, to.x_um), along(from.y_um, to.y_um)};
}

}  // namespace

StepResult RandomPolicy::act(ExplorationEnvironment& env, int agent) {
  env.observe(agent);
  std::vector<int> goals;
  for (int i = 0; i < kPolicyGridSize; ++i) {
    if (env.goal_mask(agent)[static_cast<std::size_t>(i)]) goals.push_back(i);
  }
  if (goals.empty()) return env.step_global(agent);
  return env.step(agent, goals[random_.below(static_cast<std::uint32_t>(goals.size()))]);
}

StepResult ReleasedRandomPolicy::act(ExplorationEnvironment& env, int agent) {
  constexpr std::int64_t kPixels = 128, kPixelUm = 1'000'000 / kPixels;
  const std::int64_t ahead = (kPixels / 2 - random_.below(kPixels)) * kPixelUm;
  const std::int64_t left = (kPixels / 2 - random_.below(kPixels)) * kPixelUm;
  const Pose& pose = env.pose(agent);
  const std::int64_t c = cos_q30(pose.heading), s = sin_q30(pose.heading);
  const Point target{pose.position.x_um + static_cast<std::int32_t>((ahead * c - left * s) >> 30),
                     pose.position.y_um + static_cast<std::int32_t>((ahead * s + left * c) >> 30)};
  return env.step_towards(agent, pulled_inside(pose.position, target, *env.scenario().world));
}

StepResult NearestFrontierPolicy::act(ExplorationEnvironment& env, int agent) {
  if (env.totals().explored_cells == 0) return step_ahead(env, agent);
  const std::uint16_t least = least_move_cost(env.config());
  if (least == 0) return env.step_global(agent);
  Explorer& explorer = env.explorer(agent);
  explorer.compute_paths(env.pose(agent));
  const ExplorationMap& map = explorer.map();
  std::optional<Cell> best;
  std::uint16_t best_cost = path::kUnreachable;
  const CellRect rect = map.known_rect().grown(1).intersection(explorer.paths().region());
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    for (std::int32_t x = rect.x; x < rect.right(); ++x) {
      const std::uint16_t cost = explorer.paths().cost_at(map, {x, y});
      if (cost < least || cost >= best_cost || !is_frontier(map, {x, y})) continue;
      best = Cell{x, y};
      best_cost = cost;
    }
  }
  return best ? env.step_to(agent, *best) : env.step_global(agent);
}

Cell median_cell(std::vector<Cell> cells) {
  const auto middle = cells.begin() + static_cast<std::ptrdiff_t>(cells.size() / 2);
  std::nth_element(cells.begin(), middle, cells.end(),
                   [](const Cell& a, const Cell& b) { return a.x < b.x; });
  const std::int32_t x = middle->x;
  std::nth_element(cells.begin(), middle, cells.end(),
                   [](const Cell& a, const Cell& b) { return a.y < b.y; });
  const std::int32_t y = middle->y;
  const auto rank = [&](const Cell& c) {
    const std::int64_t dx = c.x - x, dy = c.y - y;
    return std::array<std::int64_t, 3>{dx * dx + dy * dy, c.y, c.x};
  };
  return *std::min_element(cells.begin(), cells.end(),
                           [&](const Cell& a, const Cell& b) { return rank(a) < rank(b); });
}

void MedianFrontierPolicy::start_episode(std::uint64_t seed) {
  (void)seed;
  tried_.clear();
}

StepResult MedianFrontierPolicy::act(ExplorationEnvironment& env, int agent) {
  Explorer& explorer = env.explorer(agent);
  const ExplorationMap& map = explorer.map();
  tried_.resize(static_cast<std::size_t>(env.agents()));
  std::vector<Cell>& tried = tried_[static_cast<std::size_t>(agent)];
  const CellRect known = map.known_rect().grown(1).intersection(map.frame().window());
  explorer.compute_paths(env.pose(agent));
  std::optional<Cell> best;
  std::uint16_t best_cost = path::kUnreachable;
  for (const auto& frontier : connected_frontiers(map, known)) {
    const Cell median = median_cell(frontier);
    const auto goal = nearest_frontier(map, explorer.paths(), {median.x, median.y, 1, 1},
                                       explorer.stand_off_cells(), 1);
    if (!goal || goal->path_cost >= best_cost) continue;
    if (std::ranges::find(tried, goal->stand) != tried.end()) continue;
    if (goal->path_cost < least_move_cost(env.config())) continue;
    best = goal->stand;
    best_cost = goal->path_cost;
  }
  if (!best) return nearest_.act(env, agent);  // nothing is seen yet, or no median can be reached
  tried.push_back(*best);
  return env.step_to(agent, *best);
}

}  // namespace ivfm::host
