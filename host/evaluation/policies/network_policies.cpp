#include "host/evaluation/policies/network_policies.h"

#include "host/environment/network_state.h"

namespace ivfm::host {

StepResult QNetworkPolicy::act(ExplorationEnvironment& env, int agent) {
  return env.step_decision(agent, env.decide(agent, model_.network()));
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
  return env.step_decision(agent, env.decide(agent, function_));
}

}  // namespace ivfm::host
