#include "host/evaluation/policies/exploration_policy.h"

#include <stdexcept>

#include "host/evaluation/policies/network_policies.h"
#include "host/evaluation/policies/planning_policies.h"
#include "host/evaluation/policies/simple_policies.h"

namespace ivfm::host {

const std::vector<std::string>& policy_names() {
  static const std::vector<std::string> names = {"qnet",
                                                 "qnet-float",
                                                 "random",
                                                 "random-released",
                                                 "frontier-nearest",
                                                 "frontier-median",
                                                 "information-gain",
                                                 "greedy-lookahead"};
  return names;
}

std::vector<std::string> baseline_names() {
  std::vector<std::string> names;
  for (const std::string& name : policy_names()) {
    if (!name.starts_with("qnet") && name != "random-released") names.push_back(name);
  }
  return names;
}

std::unique_ptr<ExplorationPolicy> make_policy(const std::string& name,
                                               const EnvironmentConfig& config,
                                               const std::filesystem::path& model) {
  if (name == "random") return std::make_unique<RandomPolicy>();
  if (name == "random-released") return std::make_unique<ReleasedRandomPolicy>();
  if (name == "frontier-nearest") return std::make_unique<NearestFrontierPolicy>();
  if (name == "frontier-median") return std::make_unique<MedianFrontierPolicy>();
  if (name == "information-gain") return std::make_unique<InformationGainPolicy>(config);
  if (name == "greedy-lookahead") return std::make_unique<GreedyLookaheadPolicy>(config);
  if (name == "qnet" || name == "qnet-float") {
    if (model.empty()) throw std::runtime_error("policy " + name + " needs --model FILE");
    if (name == "qnet") return std::make_unique<QNetworkPolicy>(model);
    return std::make_unique<FloatNetworkPolicy>(model);
  }
  std::string message = "unknown policy '" + name + "': use one of";
  for (const std::string& known : policy_names()) message += " " + known;
  throw std::invalid_argument(message);
}

}  // namespace ivfm::host
