#include "host/evaluation/policies/planning_policies.h"

#include <algorithm>

namespace ivfm::host {

namespace {

// Added to every distance, so that tiny moves with tiny gains do not win: a policy cell or two.
double detour_m(const EnvironmentConfig& config) {
  return 2e-6 * config.cell_um * config.explorer.pool;
}

}  // namespace

InformationGainPolicy::InformationGainPolicy(const EnvironmentConfig& config)
    : config_(config), predictor_(config), moves_(kPolicyGridSize) {}

StepResult InformationGainPolicy::act(ExplorationEnvironment& env, int agent) {
  return config_.sensor == SensorModel::kPaperCamera ? act_with_camera(env, agent)
                                                     : act_with_lidar(env, agent);
}

StepResult InformationGainPolicy::act_with_camera(ExplorationEnvironment& env, int agent) {
  env.observe(agent);
  predictor_.predict(env.explorer(agent), env.pose(agent), moves_);
  const std::int32_t least = std::max(4, predictor_.most_cells() / 50);
  int best = -1;
  double best_rate = 0;
  for (int i = 0; i < kPolicyGridSize; ++i) {
    const PredictedMove& move = moves_[static_cast<std::size_t>(i)];
    if (!move.is_reachable || move.new_cells < least) continue;
    const double rate = move.new_cells / (move.travel_m + detour_m(config_));
    if (rate <= best_rate) continue;
    best = i;
    best_rate = rate;
  }
  return best < 0 ? env.step_global(agent) : env.step(agent, best);
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

StepResult GreedyLookaheadPolicy::act(ExplorationEnvironment& env, int agent) {
  env.observe(agent);
  const int best = planner_.choose(env, agent);
  return best < 0 ? env.step_global(agent) : env.step(agent, best);
}

}  // namespace ivfm::host
