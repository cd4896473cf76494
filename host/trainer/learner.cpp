#include "host/trainer/learner.h"

#include <algorithm>

#include "host/trainer/symmetry.h"

namespace ivfm::host {
namespace {

constexpr float kOutOfReach = -1e9f;

// 0 where an action is allowed, kOutOfReach elsewhere: N x kActions.
torch::Tensor penalties_of(const std::vector<ActionMask>& masks) {
  torch::Tensor out = torch::empty({static_cast<std::int64_t>(masks.size()), kActions});
  float* value = out.data_ptr<float>();
  for (const ActionMask& mask : masks)
    for (int a = 0; a < kActions; ++a) *value++ = mask.test(a) ? 0.0f : kOutOfReach;
  return out;
}

torch::Tensor column(const std::vector<float>& values) {
  return torch::tensor(values, torch::kFloat);
}

}  // namespace

Learner::Learner(const FloatNetwork& network, const LearnerConfig& config)
    : config_(config),
      device_(torch::cuda::is_available() ? torch::kCUDA : torch::kCPU),
      online_(std::make_shared<TorchNetwork>(network)),
      target_(std::make_shared<TorchNetwork>(network)) {
  online_->to(device_);
  target_->to(device_);
  optimizer_ = std::make_unique<torch::optim::AdamW>(
      online_->parameters(),
      torch::optim::AdamWOptions(config.learning_rate).weight_decay(config.weight_decay));
}

torch::Tensor Learner::forward(TorchNetwork& network, const std::vector<State>& states) {
  std::vector<const State*> pointers;
  for (const State& state : states) pointers.push_back(&state);
  return network.forward(network.to_tensor(pointers).to(device_));
}

torch::Tensor Learner::next_values(const std::vector<State>& states,
                                   const std::vector<ActionMask>& masks) {
  const torch::NoGradGuard no_gradient;
  torch::Tensor penalties = config_.mask_target
                                ? penalties_of(masks).to(device_)
                                : torch::zeros({1, kActions}, torch::device(device_));
  const torch::Tensor target_q = forward(*target_, states);
  const torch::Tensor chooser = config_.double_q ? forward(*online_, states) : target_q;
  const torch::Tensor best = (chooser + penalties).argmax(1, true);
  return target_q.gather(1, best).squeeze(1);
}

// What one step learns from: states, and for each of them one or more tried actions.
struct Learner::Batch {
  std::vector<State> states, next_states;
  std::vector<ActionMask> next_masks;
  std::vector<std::int64_t> places;  // of the tried actions' values: state * kActions + action
  std::vector<float> rewards, discounts;
};

void Learner::add(const ReplayBuffer& replay, ResumableRandom& random, Batch& batch) const {
  const auto siblings = replay.sample_siblings(static_cast<std::size_t>(config_.siblings), random);
  const int s = config_.symmetries ? static_cast<int>(random.below(kSymmetries)) : 0;
  const auto row = static_cast<std::int64_t>(batch.states.size());
  batch.states.push_back(transformed(s, replay.observation(siblings.front().from).state));
  for (const Transition& t : siblings) {
    const bool last = t.to == kNoObservation;
    const Observation& next = replay.observation(last ? t.from : t.to);
    batch.places.push_back(row * kActions + transformed_action(s, t.action));
    batch.next_states.push_back(transformed(s, next.state));
    batch.next_masks.push_back(transformed(s, next.reachable));
    batch.rewards.push_back(t.reward);
    batch.discounts.push_back(last || !next.reachable.any() ? 0.0f : t.discount);
  }
}

double Learner::learn(const ReplayBuffer& replay, ResumableRandom& random) {
  Batch batch;
  for (int i = 0; i < config_.batch; ++i) add(replay, random, batch);
  const torch::Tensor bootstrap = next_values(batch.next_states, batch.next_masks);
  const torch::Tensor targets =
      column(batch.rewards).to(device_) + column(batch.discounts).to(device_) * bootstrap;
  const torch::Tensor places = torch::tensor(batch.places, torch::kLong).to(device_);
  const torch::Tensor q = forward(*online_, batch.states).flatten().index_select(0, places);
  const double loss = descend(torch::smooth_l1_loss(q, targets));
  target_->follow(*online_, config_.target_rate);
  return loss;
}

double Learner::imitate(std::span<const LabelledState> labelled, ResumableRandom& random) {
  const auto n = static_cast<std::size_t>(config_.batch);
  std::vector<State> states;
  std::vector<float> targets(n * kActions, 0.0f), weights(n * kActions, 0.0f);
  for (std::size_t i = 0; i < n; ++i) {
    const LabelledState& sample = labelled[random.below(labelled.size())];
    const int s = config_.symmetries ? static_cast<int>(random.below(kSymmetries)) : 0;
    states.push_back(transformed(s, sample.observation.state));
    for (std::size_t k = 0; k < sample.actions.size(); ++k) {
      const auto a = static_cast<std::size_t>(transformed_action(s, sample.actions[k]));
      targets[i * kActions + a] = sample.values[k];
      weights[i * kActions + a] = 1.0f / static_cast<float>(sample.actions.size());
    }
  }
  const torch::Tensor q = forward(*online_, states);
  const torch::Tensor weight = column(weights).view_as(q).to(device_);
  const torch::Tensor errors =
      torch::smooth_l1_loss(q, column(targets).view_as(q).to(device_), torch::Reduction::None);
  return descend((errors * weight).sum() / static_cast<double>(n));
}

double Learner::descend(const torch::Tensor& loss) {
  optimizer_->zero_grad();
  loss.backward();
  torch::nn::utils::clip_grad_norm_(online_->parameters(), config_.gradient_clip);
  optimizer_->step();
  return loss.item<double>();
}

std::vector<float> Learner::values_of(TorchNetwork& network,
                                      std::span<const Observation* const> observations) const {
  const torch::NoGradGuard no_gradient;
  std::vector<const State*> states;
  for (const Observation* observation : observations) states.push_back(&observation->state);
  const torch::Tensor q =
      network.forward(network.to_tensor(states).to(device_)).to(torch::kCPU).contiguous();
  return {q.data_ptr<float>(), q.data_ptr<float>() + q.numel()};
}

std::vector<float> Learner::q_values(std::span<const Observation* const> observations) {
  return values_of(*online_, observations);
}

std::vector<int> Learner::best_actions(std::span<const Observation* const> observations) {
  const std::vector<float> q = values_of(*target_, observations);
  std::vector<int> best(observations.size(), -1);
  for (std::size_t i = 0; i < observations.size(); ++i)
    for (int a = 0; a < kActions; ++a) {
      if (!observations[i]->reachable.test(a)) continue;
      const float* row = q.data() + i * kActions;
      if (best[i] < 0 || row[a] > row[best[i]]) best[i] = a;
    }
  return best;
}

void Learner::set_learning_rate(double rate) {
  for (auto& group : optimizer_->param_groups())
    static_cast<torch::optim::AdamWOptions&>(group.options()).lr(rate);
}

void Learner::load_weights(const FloatNetwork& network) {
  TorchNetwork source(network);
  source.to(device_);
  online_->follow(source, 1.0);
  target_->follow(source, 1.0);
}

void Learner::save(torch::serialize::OutputArchive& archive) const {
  torch::serialize::OutputArchive online, target, optimizer;
  online_->save(online);
  target_->save(target);
  optimizer_->save(optimizer);
  archive.write("online", online);
  archive.write("target", target);
  archive.write("optimizer", optimizer);
}

void Learner::load(torch::serialize::InputArchive& archive) {
  torch::serialize::InputArchive online, target, optimizer;
  archive.read("online", online);
  archive.read("target", target);
  archive.read("optimizer", optimizer);
  online_->load(online);
  target_->load(target);
  optimizer_->load(optimizer);
}

}  // namespace ivfm::host
