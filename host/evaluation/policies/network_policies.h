// The learned policy, as the robot runs it (int8) and with its float weights.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "firmware/nn/q_network.h"
#include "host/evaluation/policies/exploration_policy.h"
#include "host/quantizer/float_q_function.h"

namespace ivfm::host {

// The firmware's own network: what is judged is what ships.
class QNetworkPolicy final : public ExplorationPolicy {
 public:
  // Throws std::runtime_error when the file cannot be read, is not a model, or is one for another
  // state than the robot has.
  explicit QNetworkPolicy(const std::filesystem::path& model);
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  std::vector<std::uint8_t> file_;
  std::unique_ptr<QNetwork> network_;
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
