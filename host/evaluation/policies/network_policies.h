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
  // Throws std::runtime_error when the file cannot be read or is not a model.
  explicit QNetworkPolicy(const std::filesystem::path& model);
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  std::vector<std::uint8_t> file_;
  std::unique_ptr<QNetwork> network_;
};

class FloatNetworkPolicy final : public ExplorationPolicy {
 public:
  // Throws std::runtime_error when the file cannot be read or is not a network.
  explicit FloatNetworkPolicy(const std::filesystem::path& network);
  StepResult act(ExplorationEnvironment& env, int agent) override;

 private:
  FloatQFunction function_;
};

}  // namespace ivfm::host
