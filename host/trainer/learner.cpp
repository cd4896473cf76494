#include "host/trainer/learner.h"

#include <algorithm>

#include "host/environment/parallel.h"
#include "host/quantizer/quantizer.h"
#include "host/trainer/symmetry.h"

namespace ivfm::host {
namespace {

// States of a pass without gradients: what a processor's cache holds, what keeps a GPU busy.
constexpr std::size_t kChunkOnCpu = 64, kChunkOnGpu = 1024;
// A GPU plans its convolutions anew for every new size of a batch: few sizes.
constexpr std::size_t kBatchSizesOnGpu = 128;

torch::Tensor column(const std::vector<float>& values) {
  return torch::tensor(values, torch::kFloat);
}

int best_reachable(const Observation& observation, const float* q) {
  int best = -1;
  for (int a = 0; a < kActions; ++a)
    if (observation.reachable.test(a) && (best < 0 || q[a] > q[best])) best = a;
  return best;
}

}  // namespace

Learner::Learner(const FloatNetwork& network, const LearnerConfig& config)
    : config_(config),
      device_(torch::cuda::is_available() ? torch::kCUDA : torch::kCPU),
      arithmetic_(config.bfloat16 ? Arithmetic::kBfloat16 : Arithmetic::kFloat),
      online_(std::make_shared<TorchNetwork>(network)),
      target_(std::make_shared<TorchNetwork>(network)) {
  online_->to(device_);
  target_->to(device_);
  optimizer_ = std::make_unique<torch::optim::AdamW>(
      online_->parameters(),
      torch::optim::AdamWOptions(config.learning_rate).weight_decay(config.weight_decay));
}

torch::Tensor Learner::inputs_of(std::span<const State* const> states) const {
  return online_->to_tensor(states).to(device_);
}

// The inputs of a chunk; on a GPU with the last state repeated.
torch::Tensor Learner::inputs_of(std::span<const Observation* const> observations) const {
  std::vector<const State*> states;
  for (const Observation* o : observations) states.push_back(&o->state);
  while (device_ != torch::kCPU && states.size() % kBatchSizesOnGpu != 0)
    states.push_back(states.back());
  return inputs_of(states);
}

torch::Tensor Learner::forward(TorchNetwork& network, const torch::Tensor& inputs) const {
  return network.forward(inputs, arithmetic_).to(torch::kFloat);
}

std::size_t Learner::chunk() const { return device_ == torch::kCPU ? kChunkOnCpu : kChunkOnGpu; }

double Learner::learn(const LabelBuffer& labels, ResumableRandom& random) {
  const auto n = static_cast<std::size_t>(config_.batch);
  std::vector<const State*> drawn;
  std::vector<int> symmetries;
  std::vector<std::int64_t> places, rows;  // of the labelled values: row * kActions + action
  std::vector<float> targets, weights;     // a label's share of its state
  for (std::size_t row = 0; row < n; ++row) {
    const LabelledState& sample = labels[random.below(labels.size())];
    const int s = config_.symmetries ? static_cast<int>(random.below(kSymmetries)) : 0;
    drawn.push_back(&sample.observation.state);
    symmetries.push_back(s);
    for (std::size_t k = 0; k < sample.actions.size(); ++k) {
      rows.push_back(static_cast<std::int64_t>(row));
      places.push_back(rows.back() * kActions + transformed_action(s, sample.actions[k]));
      targets.push_back(sample.values[k]);
      weights.push_back(1.0f / static_cast<float>(sample.actions.size()));
    }
  }
  std::vector<State> states(n);
  std::vector<const State*> shown;
  for (const State& state : states) shown.push_back(&state);
  for_each_index(n, torch::get_num_threads(),
                 [&](std::size_t i) { states[i] = transformed(symmetries[i], *drawn[i]); });
  const torch::Tensor index = torch::tensor(places, torch::kLong).to(device_);
  const torch::Tensor row = torch::tensor(rows, torch::kLong).to(device_);
  const torch::Tensor weight = column(weights).to(device_);
  const torch::Tensor q = forward(*online_, inputs_of(shown)).flatten().index_select(0, index);
  const torch::Tensor error = q - column(targets).to(device_);
  const torch::Tensor shared =
      torch::zeros({config_.batch}, torch::device(device_)).index_add(0, row, error * weight);
  const auto size_of = [](const torch::Tensor& e) {
    return torch::smooth_l1_loss(e, torch::zeros_like(e), torch::Reduction::None);
  };
  const torch::Tensor between_goals = size_of(error - shared.index_select(0, row)) * weight;
  const double loss =
      descend((between_goals.sum() + config_.shared_weight * size_of(shared).sum()) /
              static_cast<double>(n));
  target_->follow(*online_, config_.target_rate);
  return loss;
}

double Learner::descend(const torch::Tensor& loss) {
  optimizer_->zero_grad();
  loss.backward();
  torch::nn::utils::clip_grad_norm_(online_->parameters(), config_.gradient_clip);
  optimizer_->step();
  return loss.item<double>();
}

std::vector<float> Learner::q_values(std::span<const Observation* const> observations) {
  const torch::NoGradGuard no_gradient;
  std::vector<float> out;
  for (std::size_t at = 0; at < observations.size(); at += chunk()) {
    const auto some = observations.subspan(at, std::min(chunk(), observations.size() - at));
    const torch::Tensor q = forward(*target_, inputs_of(some)).to(torch::kCPU).contiguous();
    const auto values = static_cast<std::ptrdiff_t>(some.size() * kActions);
    out.insert(out.end(), q.data_ptr<float>(), q.data_ptr<float>() + values);
  }
  return out;
}

std::vector<float> Learner::state_values(std::span<const Observation* const> observations) {
  const torch::NoGradGuard no_gradient;
  std::vector<float> out;
  for (std::size_t at = 0; at < observations.size(); at += chunk()) {
    const auto some = observations.subspan(at, std::min(chunk(), observations.size() - at));
    const torch::Tensor inputs = inputs_of(some);
    const torch::Tensor value = forward(*target_, inputs).to(torch::kCPU).contiguous();
    const torch::Tensor chooser =
        config_.double_q ? forward(*online_, inputs).to(torch::kCPU).contiguous() : value;
    for (std::size_t i = 0; i < some.size(); ++i) {
      const float* row = chooser.data_ptr<float>() + i * kActions;
      const int best = config_.mask_target
                           ? best_reachable(*some[i], row)
                           : static_cast<int>(std::max_element(row, row + kActions) - row);
      out.push_back(best < 0 ? 0.0f : value.data_ptr<float>()[i * kActions + best]);
    }
  }
  return out;
}

std::vector<int> Learner::best_actions(std::span<const Observation* const> observations) {
  const std::vector<float> q = q_values(observations);
  std::vector<int> best;
  for (std::size_t i = 0; i < observations.size(); ++i)
    best.push_back(best_reachable(*observations[i], q.data() + i * kActions));
  return best;
}

FloatNetwork Learner::to_float_network() const {
  FloatNetwork network = target_->to_float_network();
  if (arithmetic_ == Arithmetic::kQuantized) host::round_weights(network);
  return network;
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
