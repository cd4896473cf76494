// The opponents that predict: information gain per metre, and greedy one-move lookahead.
#pragma once

#include <vector>

#include "host/environment/greedy_planner.h"
#include "host/evaluation/policies/exploration_policy.h"

namespace ivfm::host {

// Directions in which a robot did not get anywhere: pressed against what it cannot see, it would
// choose the same way for ever.
class VainMoves {
 public:
  void forget() { bearings_.clear(); }
  // What became of the move to `goal` that began at `from`.
  void note(Point from, Point goal, const StepResult& result);
  bool bars(Point from, Point goal) const;
  bool empty() const { return bearings_.empty(); }

 private:
  std::vector<BinaryAngle> bearings_;
};

// Drives to the reachable place with the most newly seen area per metre, predicted by ray casting
// in the known map. With a camera, all moves in the local map and what they sweep on the way; with
// a lidar, viewpoints all over the map.
class InformationGainPolicy final : public ExplorationPolicy {
 public:
  explicit InformationGainPolicy(const EnvironmentConfig& config);
  void start_episode(std::uint64_t seed) override;
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  int best_move(const ExplorationEnvironment& env, int agent, const VainMoves& vain) const;
  StepResult act_with_camera(ExplorationEnvironment& env, int agent);
  StepResult act_with_lidar(ExplorationEnvironment& env, int agent);

  EnvironmentConfig config_;
  MovePredictor predictor_;
  std::vector<PredictedMove> moves_;
  std::vector<VainMoves> vain_;  // by agent
};

// The quick study's planner: most newly seen minus 0.2 times re-seen cells.
class GreedyLookaheadPolicy final : public ExplorationPolicy {
 public:
  explicit GreedyLookaheadPolicy(const EnvironmentConfig& config) : planner_(config) {}
  void start_episode(std::uint64_t seed) override;
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  GreedyPlanner planner_;
  std::vector<VainMoves> vain_;  // by agent
};

}  // namespace ivfm::host
