// The Q network as a torch module, built from the same layer list as the int8 network on board.
#pragma once

#include <torch/torch.h>

#include <span>
#include <vector>

#include "host/quantizer/float_network.h"
#include "host/trainer/observation.h"

namespace ivfm::host {

// How a forward pass computes.
enum class Arithmetic : std::uint8_t {
  kFloat,      // 32 bits
  kBfloat16,   // 16 bits, but for the head
  kQuantized,  // weights rounded to int8 as on board, with straight-through gradients
};

class TorchNetwork : public torch::nn::Module {
 public:
  // Takes over topology, input scaling and weights. Throws as FloatNetwork::shapes().
  explicit TorchNetwork(const FloatNetwork& network);

  // `states`: N x channels x 32 x 32 in [0, 1], see to_tensor(). Answers N x 1024 values.
  torch::Tensor forward(const torch::Tensor& states, Arithmetic arithmetic = Arithmetic::kFloat);

  // The scaled inputs of `states`, on the CPU: N x channels x 32 x 32.
  torch::Tensor to_tensor(std::span<const State* const> states) const;

  // The network with its present weights as plain data, for the file and the quantizer.
  FloatNetwork to_float_network() const;

  // Copies `share` of the other's weights into these: 1 is a copy, less a moving average.
  void follow(TorchNetwork& other, double share);

 private:
  torch::Tensor convolve(std::size_t layer, const torch::Tensor& input, Arithmetic arithmetic);

  FloatNetwork network_;                           // topology; its weights are not current
  std::vector<torch::nn::Conv2d> convolutions_;    // one a convolution layer
  std::vector<std::size_t> convolution_of_layer_;  // index into convolutions_
};

}  // namespace ivfm::host
