#include "host/environment/greedy_planner.h"

#include <algorithm>

namespace ivfm::host {

GreedyPlanner::GreedyPlanner(const EnvironmentConfig& config, double re_seen_weight)
    : predictor_(config),
      re_seen_weight_(re_seen_weight),
      stride_(config.sensor == SensorModel::kLidar ? 2 : 1),
      min_new_cells_(std::max(4, predictor_.most_cells() / 50)) {}

int GreedyPlanner::choose(const ExplorationEnvironment& env, int agent,
                          const std::function<bool(int)>& bars) {
  predictor_.predict(env.explorer(agent), env.pose(agent), moves_, stride_);
  int best = -1;
  for (int i = 0; i < kPolicyGridSize; ++i) {
    const PredictedMove& move = moves_[static_cast<std::size_t>(i)];
    if (!predictor_.is_prudent(move) || move.new_cells < min_new_cells_) continue;
    if (bars && bars(i)) continue;
    if (best < 0 || score(move) > score(moves_[static_cast<std::size_t>(best)])) best = i;
  }
  return best;
}

}  // namespace ivfm::host
