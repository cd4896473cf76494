#include "host/evaluation/policies/network_policies.h"

#include <fstream>
#include <iterator>
#include <stdexcept>

#include "host/environment/network_state.h"

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
  const ModelStatus status = network_->load_for_robot(file_);
  if (ok(status.status)) return;
  const bool may_be_float = status.status == Status::kUnsupported;
  throw std::runtime_error(
      "the model " + model.string() + " cannot be used: " + status.reason +
      (may_be_float ? "; a float network is judged with --policy qnet-float" : ""));
}

StepResult QNetworkPolicy::act(ExplorationEnvironment& env, int agent) {
  return env.step_decision(agent, env.explorer(agent).decide(env.pose(agent), *network_));
}

FloatNetworkPolicy::FloatNetworkPolicy(const std::filesystem::path& path)
    : FloatNetworkPolicy(load_network(path)) {}

FloatNetworkPolicy::FloatNetworkPolicy(const FloatNetwork& network)
    : function_(network,
                [this, kind = network.state_kind](const LocalState&, std::span<std::uint16_t> out) {
                  encode_network_state(kind, *explorer_, pose_, out);
                }) {}

StepResult FloatNetworkPolicy::act(ExplorationEnvironment& env, int agent) {
  explorer_ = &env.explorer(agent);
  pose_ = env.pose(agent);
  return env.step_decision(agent, env.explorer(agent).decide(pose_, function_));
}

}  // namespace ivfm::host
