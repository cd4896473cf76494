// Regression on labelled states with an averaged target network: loss, optimizer, state values.
#pragma once

#include <torch/torch.h>

#include <memory>
#include <span>
#include <vector>

#include "host/trainer/label_buffer.h"
#include "host/trainer/learner_config.h"
#include "host/trainer/resumable_random.h"
#include "host/trainer/torch_network.h"

namespace ivfm::host {

class Learner {
 public:
  // Starts from the weights of `network`.
  Learner(const FloatNetwork& network, const LearnerConfig& config);

  // One step of gradient descent on the labels (smooth L1) of states drawn from `labels` (not
  // empty); returns the loss. The target network follows.
  double learn(const LabelBuffer& labels, ResumableRandom& random);

  // Q values of the target network, a moving average that chooses better than the latest weights:
  // kActions per observation.
  std::vector<float> q_values(std::span<const Observation* const> observations);
  // What each observation is worth (double Q-learning, van Hasselt et al. 2016): the target
  // network's value of the goal in reach that the online network likes best; 0 without a goal.
  std::vector<float> state_values(std::span<const Observation* const> observations);
  // The best reachable action of each observation by the target network; -1 where none is.
  std::vector<int> best_actions(std::span<const Observation* const> observations);

  // From now on the network learns, answers and is given away with its weights rounded to int8 as
  // on board (quantization-aware training, Jacob et al. 2018). Activations have 14 bits there,
  // which no training is needed for.
  void round_weights() { arithmetic_ = Arithmetic::kQuantized; }

  void set_learning_rate(double rate);
  void copy_to_target() { target_->follow(*online_, 1.0); }
  void load_weights(const FloatNetwork& network);
  // The target network.
  FloatNetwork to_float_network() const;
  torch::Device device() const { return device_; }

  // Weights of both networks and the optimizer's moments.
  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  torch::Tensor inputs_of(std::span<const State* const> states) const;
  torch::Tensor inputs_of(std::span<const Observation* const> observations) const;
  torch::Tensor forward(TorchNetwork& network, const torch::Tensor& inputs) const;
  std::size_t chunk() const;
  double descend(const torch::Tensor& loss);

  LearnerConfig config_;
  torch::Device device_;
  Arithmetic arithmetic_;
  std::shared_ptr<TorchNetwork> online_;
  std::shared_ptr<TorchNetwork> target_;
  std::unique_ptr<torch::optim::AdamW> optimizer_;
};

}  // namespace ivfm::host
