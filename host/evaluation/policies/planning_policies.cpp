#include "host/evaluation/policies/planning_policies.h"

#include <algorithm>
#include <cstdlib>

namespace ivfm::host {

namespace {

// Added to every distance, so that tiny moves with tiny gains do not win: a policy cell or two.
double detour_m(const EnvironmentConfig& config) {
  return 2e-6 * config.cell_um * config.explorer.pool;
}

BinaryAngle bearing(Point from, Point to) {
  return atan2_binary(std::int64_t{to.y_um} - from.y_um, std::int64_t{to.x_um} - from.x_um);
}

Point place_of(const ExplorationEnvironment& env, int agent, int policy_cell) {
  const Explorer& explorer = env.explorer(agent);
  return explorer.map().frame().center_of(explorer.goal_in_block(policy_cell));
}

VainMoves& vain_of(std::vector<VainMoves>& all, const ExplorationEnvironment& env, int agent) {
  all.resize(static_cast<std::size_t>(env.agents()));
  return all[static_cast<std::size_t>(agent)];
}

// Drives to policy cell `best`; without one to the nearest frontier of the whole map, or, when that
// is no way out either, to the furthest place that is not barred.
StepResult move_or_leave(ExplorationEnvironment& env, int agent, int best, VainMoves& vain) {
  const Point here = env.pose(agent).position;
  if (best < 0 && !vain.empty()) {
    std::int64_t furthest = -1;
    for (int i = 0; i < kPolicyGridSize; ++i) {
      if (!env.goal_mask(agent)[static_cast<std::size_t>(i)]) continue;
      const Point place = place_of(env, agent, i);
      const std::int64_t distance = squared_distance_um2(here, place);
      if (distance <= furthest || vain.bars(here, place)) continue;
      furthest = distance;
      best = i;
    }
  }
  if (best < 0) {
    const StepResult result = env.step_global(agent);
    const WaypointPath& path = env.explorer(agent).path();
    if (!path.points().empty()) vain.note(here, path.points().back(), result);
    return result;
  }
  const Point goal = place_of(env, agent, best);
  const StepResult result = env.step(agent, best);
  vain.note(here, goal, result);
  return result;
}

}  // namespace

void VainMoves::note(Point from, Point goal, const StepResult& result) {
  if (!result.idle && result.distance_m > 0.005) return forget();
  if (bearings_.size() > 16) forget();
  bearings_.push_back(bearing(from, goal));
}

bool VainMoves::bars(Point from, Point goal) const {
  constexpr int kEighth = 65536 / 16;  // half of an eighth turn to either side
  const BinaryAngle wanted = bearing(from, goal);
  return std::ranges::any_of(bearings_, [&](BinaryAngle barred) {
    return std::abs(int{(wanted - barred).signed_raw()}) < kEighth;
  });
}

InformationGainPolicy::InformationGainPolicy(const EnvironmentConfig& config)
    : config_(config), predictor_(config), moves_(kPolicyGridSize) {}

void InformationGainPolicy::start_episode(std::uint64_t seed) {
  (void)seed;
  vain_.clear();
}

StepResult InformationGainPolicy::act(ExplorationEnvironment& env, int agent) {
  return config_.sensor == SensorModel::kPaperCamera ? act_with_camera(env, agent)
                                                     : act_with_lidar(env, agent);
}

int InformationGainPolicy::best_move(const ExplorationEnvironment& env, int agent,
                                     const VainMoves& vain) const {
  // A robot that is stuck takes what shows it anything.
  const std::int32_t least = vain.empty() ? std::max(4, predictor_.most_cells() / 50) : 1;
  const Point here = env.pose(agent).position;
  int best = -1;
  double best_rate = 0;
  for (int i = 0; i < kPolicyGridSize; ++i) {
    const PredictedMove& move = moves_[static_cast<std::size_t>(i)];
    if (!predictor_.is_prudent(move) || move.new_cells < least) continue;
    const double rate = move.new_cells / (move.travel_m + detour_m(config_));
    if (rate <= best_rate || vain.bars(here, place_of(env, agent, i))) continue;
    best = i;
    best_rate = rate;
  }
  return best;
}

StepResult InformationGainPolicy::act_with_camera(ExplorationEnvironment& env, int agent) {
  env.observe(agent);
  predictor_.predict(env.explorer(agent), env.pose(agent), moves_);
  VainMoves& vain = vain_of(vain_, env, agent);
  return move_or_leave(env, agent, best_move(env, agent, vain), vain);
}

StepResult InformationGainPolicy::act_with_lidar(ExplorationEnvironment& env, int agent) {
  Explorer& explorer = env.explorer(agent);
  explorer.compute_paths(env.pose(agent));
  const ExplorationMap& map = explorer.map();
  struct Viewpoint {
    std::uint16_t cost;
    Cell cell;
  };
  std::vector<Viewpoint> viewpoints;
  const CellRect region = explorer.paths().region();
  constexpr std::int32_t kSpacing = 8;  // cells, on a lattice that does not move with the robot
  for (std::int32_t y = region.y; y < region.top(); ++y) {
    for (std::int32_t x = region.x; x < region.right(); ++x) {
      if (x % kSpacing != 0 || y % kSpacing != 0) continue;
      const std::uint16_t cost = explorer.paths().cost_at(map, {x, y});
      if (cost != path::kUnreachable && cost > 2 * path::kStraight)
        viewpoints.push_back({cost, {x, y}});
    }
  }
  std::stable_sort(viewpoints.begin(), viewpoints.end(),
                   [](const Viewpoint& a, const Viewpoint& b) { return a.cost < b.cost; });
  const double cell_m = config_.cell_um * 1e-6;
  double best_rate = 0;
  Cell best;
  for (const Viewpoint& v : viewpoints) {
    const double metres = v.cost * cell_m / path::kStraight + detour_m(config_);
    if (predictor_.most_cells() / metres <= best_rate) break;  // nothing further away can win
    const std::int32_t gain = predictor_.new_cells_from(explorer, v.cell, BinaryAngle());
    if (gain < std::max(4, predictor_.most_cells() / 500) || gain / metres <= best_rate) continue;
    best_rate = gain / metres;
    best = v.cell;
  }
  return best_rate > 0 ? env.step_to(agent, best) : env.step_global(agent);
}

void GreedyLookaheadPolicy::start_episode(std::uint64_t seed) {
  (void)seed;
  vain_.clear();
}

StepResult GreedyLookaheadPolicy::act(ExplorationEnvironment& env, int agent) {
  env.observe(agent);
  VainMoves& vain = vain_of(vain_, env, agent);
  const Point here = env.pose(agent).position;
  const int best =
      planner_.choose(env, agent, [&](int i) { return vain.bars(here, place_of(env, agent, i)); });
  return move_or_leave(env, agent, best, vain);
}

}  // namespace ivfm::host
