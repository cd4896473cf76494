#include "host/evaluation/policies/network_policies.h"

#include <fstream>
#include <iterator>
#include <stdexcept>

namespace ivfm::host {

namespace {

std::vector<std::uint8_t> read_file(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error("cannot read the model " + path.string());
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

QNetworkPolicy::QNetworkPolicy(const std::filesystem::path& model)
    : file_(read_file(model)), network_(std::make_unique<QNetwork>()) {
  const ModelStatus status = network_->load(file_);
  if (!ok(status.status)) {
    throw std::runtime_error("the model " + model.string() + " cannot be used: " + status.reason);
  }
}

StepResult QNetworkPolicy::act(ExplorationEnvironment& env, int agent) {
  return env.step_decision(agent, env.explorer(agent).decide(env.pose(agent), *network_));
}

FloatNetworkPolicy::FloatNetworkPolicy(const std::filesystem::path& network)
    : function_(load_network(network)) {}

StepResult FloatNetworkPolicy::act(ExplorationEnvironment& env, int agent) {
  return env.step_decision(agent, env.explorer(agent).decide(env.pose(agent), function_));
}

}  // namespace ivfm::host
