// What decides where a simulated robot goes next; every policy acts on the same environment.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "host/environment/exploration_environment.h"

namespace ivfm::host {

class ExplorationPolicy {
 public:
  virtual ~ExplorationPolicy() = default;
  // Called before each episode; `seed` is for the policy's own chance.
  virtual void start_episode(std::uint64_t seed) { (void)seed; }
  // Chooses one action of `agent` and does it.
  virtual StepResult act(ExplorationEnvironment& env, int agent) = 0;
};

// The names that make_policy() knows, in the order of the documentation.
const std::vector<std::string>& policy_names();
// Those of them that are opponents: not learned, and without knowledge of the world.
std::vector<std::string> baseline_names();

// Throws std::invalid_argument for an unknown name (the message lists the known ones), and
// std::runtime_error when `model` is needed and cannot be used. `model`: an .ivfm file for `qnet`,
// an .fnet file for `qnet-float`; otherwise ignored.
std::unique_ptr<ExplorationPolicy> make_policy(const std::string& name,
                                               const EnvironmentConfig& config,
                                               const std::filesystem::path& model);

}  // namespace ivfm::host
