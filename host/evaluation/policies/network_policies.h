// The learned policy, as the robot runs it (int8) and with its float weights.
#pragma once

#include <filesystem>

#include "host/evaluation/policies/exploration_policy.h"
#include "host/quantizer/float_q_function.h"
#include "host/quantizer/robot_model.h"

namespace ivfm::host {

// The firmware's own network: what is judged is what ships.
class QNetworkPolicy final : public ExplorationPolicy {
 public:
  // Throws as RobotModel.
  explicit QNetworkPolicy(const std::filesystem::path& model) : model_(model) {}
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  RobotModel model_;
};

// With its float weights, and for any kind of state (network_state.h).
class FloatNetworkPolicy final : public ExplorationPolicy {
 public:
  // Throws std::runtime_error when the file cannot be read or is not a network.
  explicit FloatNetworkPolicy(const std::filesystem::path& path);
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  explicit FloatNetworkPolicy(const FloatNetwork& network);

  const Explorer* explorer_ = nullptr;  // of the robot that decides
  Pose pose_;
  FloatQFunction function_;
};

}  // namespace ivfm::host
