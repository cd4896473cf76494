// The opponents that predict: information gain per metre, and greedy one-move lookahead.
#pragma once

#include <vector>

#include "host/environment/greedy_planner.h"
#include "host/evaluation/policies/exploration_policy.h"

namespace ivfm::host {

// Drives to the reachable place with the most newly seen area per metre, predicted by ray casting
// in the known map. With a camera, all moves in the local map and what they sweep on the way; with
// a lidar, viewpoints all over the map.
class InformationGainPolicy final : public ExplorationPolicy {
 public:
  explicit InformationGainPolicy(const EnvironmentConfig& config);
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  StepResult act_with_camera(ExplorationEnvironment& env, int agent);
  StepResult act_with_lidar(ExplorationEnvironment& env, int agent);

  EnvironmentConfig config_;
  MovePredictor predictor_;
  std::vector<PredictedMove> moves_;
};

// The quick study's planner: most newly seen minus 0.2 times re-seen cells.
class GreedyLookaheadPolicy final : public ExplorationPolicy {
 public:
  explicit GreedyLookaheadPolicy(const EnvironmentConfig& config) : planner_(config) {}
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  GreedyPlanner planner_;
};

}  // namespace ivfm::host
