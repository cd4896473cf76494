// Planners that look one move ahead in the known map: opponents, and an expert to imitate.
#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "host/environment/move_predictor.h"

namespace ivfm::host {

// Picks the move with the most newly seen minus `re_seen_weight` times re-seen cells.
class GreedyPlanner {
 public:
  explicit GreedyPlanner(const EnvironmentConfig& config, double re_seen_weight = 0.2);

  // The best policy cell, or -1 when no move shows at least `min_new_cells` new cells: then
  // ExplorationEnvironment::step_global() is the way. Call ExplorationEnvironment::observe() first.
  // `bars`: goals that are not to be chosen; null: none.
  int choose(const ExplorationEnvironment& env, int agent,
             const std::function<bool(int policy_cell)>& bars = nullptr);
  // The predictions behind the last choice, by policy cell.
  const std::array<PredictedMove, kPolicyGridSize>& moves() const { return moves_; }
  double score(const PredictedMove& move) const {
    return move.new_cells - re_seen_weight_ * move.re_seen_cells;
  }

 private:
  MovePredictor predictor_;
  double re_seen_weight_;
  int stride_;
  std::int32_t min_new_cells_;
  std::array<PredictedMove, kPolicyGridSize> moves_{};
};

}  // namespace ivfm::host
