// Double DQN on the dense action map: batches from the replay buffer, loss, optimizer, target copy.
#pragma once

#include <torch/torch.h>

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "host/trainer/learner_config.h"
#include "host/trainer/replay_buffer.h"
#include "host/trainer/torch_network.h"

namespace ivfm::host {

class Learner {
 public:
  // Starts from the weights of `network`.
  Learner(const FloatNetwork& network, const LearnerConfig& config);

  // One step of gradient descent on double DQN's loss (smooth L1); returns the loss.
  double learn(const ReplayBuffer& replay, ResumableRandom& random);
  // One step of regression on labels drawn from `states` (not empty); returns the loss.
  double imitate(std::span<const LabelledState> states, ResumableRandom& random);

  // Q values of the online network: kActions per observation.
  std::vector<float> q_values(std::span<const Observation* const> observations);
  // The best reachable action of each observation by the target network, whose weights are a moving
  // average and choose better than the latest ones; -1 where none is reachable.
  std::vector<int> best_actions(std::span<const Observation* const> observations);

  void set_learning_rate(double rate);
  void copy_to_target() { target_->follow(*online_, 1.0); }
  void load_weights(const FloatNetwork& network);
  // The target network.
  FloatNetwork to_float_network() const { return target_->to_float_network(); }
  torch::Device device() const { return device_; }

  // Weights of both networks and the optimizer's moments.
  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  struct Batch;

  void add(const ReplayBuffer& replay, ResumableRandom& random, Batch& batch) const;
  std::vector<float> values_of(TorchNetwork& network,
                               std::span<const Observation* const> observations) const;
  double descend(const torch::Tensor& loss);
  torch::Tensor forward(TorchNetwork& network, const std::vector<State>& states);
  torch::Tensor next_values(const std::vector<State>& states, const std::vector<ActionMask>& masks);

  LearnerConfig config_;
  torch::Device device_;
  std::shared_ptr<TorchNetwork> online_;
  std::shared_ptr<TorchNetwork> target_;
  std::unique_ptr<torch::optim::AdamW> optimizer_;
};

}  // namespace ivfm::host
