// Predicts in a robot's known map what driving to a goal would show: for planners and experts.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "host/environment/exploration_environment.h"

namespace ivfm::host {

// What driving to a goal is expected to do, when what is unknown is free and hides nothing.
struct PredictedMove {
  bool is_reachable = false;
  double travel_m = 0;         // driven, the turning not counted
  double turn_rad = 0;         // turned on the spot, summed
  double unseen_m = 0;         // of the way, over cells that nobody has seen
  std::int32_t new_cells = 0;  // would be seen for the first time
  std::int32_t re_seen_cells = 0;
  double re_seen_penalty = 0;  // sum of 2 sigma(count) - 1 over the re-seen cells
};

// The cells that a view shows, as a tree: a cell is seen when its parent is seen and transparent.
// One tree for each of `headings` directions.
class ViewTemplate {
 public:
  struct Node {
    std::int16_t dx = 0, dy = 0;  // map cells from the robot's cell
    std::int32_t parent = 0;      // index of the cell before it towards the robot; 0 = the root
    bool in_footprint = false;    // counts as seen; else only on the way
  };

  // `footprint` and `cell_um` as in the robot's map.
  ViewTemplate(const VisitFootprint& footprint, std::int32_t cell_um);

  const std::vector<Node>& nodes(BinaryAngle heading) const;
  std::size_t headings() const { return trees_.size(); }

 private:
  std::vector<std::vector<Node>> trees_;
};

// Not thread safe: holds scratch memory. Use one a thread.
class MovePredictor {
 public:
  explicit MovePredictor(const EnvironmentConfig& config);

  // Predicts the move to every policy cell (kPolicyGridSize results, in the order of the policy
  // grid), or to every `stride`-th one in each direction. Call Explorer::observe() first: only
  // cells of its goal mask are predicted, the others stay unreachable.
  void predict(const Explorer& explorer, const Pose& pose, std::span<PredictedMove> out,
               int stride = 1);

  // Predicts driving along `waypoints`. `spacing_um`: between views; 0: the environment's own.
  PredictedMove predict_path(const Explorer& explorer, const Pose& pose,
                             std::span<const Point> waypoints, std::int32_t spacing_um = 0);

  // Cells that a view from `cell` would show for the first time.
  std::int32_t new_cells_from(const Explorer& explorer, Cell cell, BinaryAngle heading);
  // Whether the move can be made and does not lead further into the unseen than half the sensor's
  // reach: obstacles would come up too late.
  bool is_prudent(const PredictedMove& move) const {
    return move.is_reachable && move.unseen_m * 2e6 <= config_.explorer.fusion.footprint.far_um;
  }
  // The most cells that one view can show.
  std::int32_t most_cells() const { return most_cells_; }

 private:
  void begin(const Explorer& explorer);
  void view(const Explorer& explorer, Cell cell, BinaryAngle heading, PredictedMove& move);

  EnvironmentConfig config_;
  ViewTemplate template_;
  std::int32_t most_cells_ = 0;
  std::vector<std::uint8_t> visible_;  // by node of the tree at hand
  std::vector<std::uint32_t> marked_;  // over the map's window: the prediction that last saw it
  std::uint32_t prediction_ = 0;
};

}  // namespace ivfm::host
