// The baselines that need little: random goals, nearest frontier, median frontier.
#pragma once

#include <vector>

#include "host/environment/random.h"
#include "host/evaluation/policies/exploration_policy.h"

namespace ivfm::host {

// A goal drawn uniformly from the reachable policy cells: the learned policy's action space.
class RandomPolicy final : public ExplorationPolicy {
 public:
  void start_episode(std::uint64_t seed) override { random_ = Random(seed); }
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  Random random_{0};
};

// The random policy of the paper's released code, for calibration: any pixel of its heading-up
// 1 m map, reachable or not, pulled back to the arena's border.
class ReleasedRandomPolicy final : public ExplorationPolicy {
 public:
  void start_episode(std::uint64_t seed) override { random_ = Random(seed); }
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  Random random_{0};
};

// The nearest reachable frontier of the whole map (Yamauchi 1997) that is far enough for a view.
class NearestFrontierPolicy final : public ExplorationPolicy {
 public:
  StepResult act(ExplorationEnvironment& env, int agent) override;
};

// As the paper describes its baseline: frontiers are connected, each one's goal is its median
// instead of its centroid, and the nearest of these goals is taken.
class MedianFrontierPolicy final : public ExplorationPolicy {
 public:
  void start_episode(std::uint64_t seed) override;
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  NearestFrontierPolicy nearest_;
  std::vector<std::vector<Cell>> tried_;  // by agent; no goal is tried twice in an episode
};

// The median of a set of cells, as one of them: the cell nearest to (median x, median y).
Cell median_cell(std::vector<Cell> cells);

}  // namespace ivfm::host
