#include "host/trainer/torch_network.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "host/environment/parallel.h"

namespace ivfm::host {
namespace {

bool is_convolution(const FloatLayer& layer) {
  return layer.kind == LayerKind::kConv3x3 || layer.kind == LayerKind::kConv1x1;
}

void copy_weights(const std::vector<float>& from, torch::Tensor to) {
  const torch::NoGradGuard no_gradient;
  to.copy_(torch::from_blob(const_cast<float*>(from.data()), to.sizes(), torch::kFloat));
}

std::vector<float> values_of(const torch::Tensor& tensor) {
  const torch::Tensor flat = tensor.detach().to(torch::kCPU, torch::kFloat).contiguous();
  return {flat.data_ptr<float>(), flat.data_ptr<float>() + flat.numel()};
}

}  // namespace

TorchNetwork::TorchNetwork(const FloatNetwork& network)
    : network_(network), convolution_of_layer_(network.layers.size()) {
  const std::vector<Shape> shapes = network.shapes();
  for (std::size_t i = 0; i < network.layers.size(); ++i) {
    const FloatLayer& layer = network.layers[i];
    if (!is_convolution(layer)) continue;
    const int side = layer.kind == LayerKind::kConv3x3 ? 3 : 1;
    const int inputs = shapes[static_cast<std::size_t>(layer.input_a)].channels;
    auto options = torch::nn::Conv2dOptions(inputs, layer.outputs, side);
    torch::nn::Conv2d convolution(options.stride(layer.stride).padding(side / 2));
    copy_weights(layer.weights, convolution->weight);
    copy_weights(layer.bias, convolution->bias);
    convolution_of_layer_[i] = convolutions_.size();
    convolutions_.push_back(register_module("layer" + std::to_string(i), convolution));
  }
}

torch::Tensor TorchNetwork::forward(const torch::Tensor& states, Arithmetic arithmetic) {
  const auto upsampling =
      torch::nn::functional::InterpolateFuncOptions().scale_factor(std::vector<double>{2.0, 2.0});
  std::vector<torch::Tensor> tensors = {states};
  for (std::size_t i = 0; i < network_.layers.size(); ++i) {
    const FloatLayer& layer = network_.layers[i];
    const bool is_head = i + 1 == network_.layers.size();
    const torch::Tensor& a = tensors[static_cast<std::size_t>(layer.input_a)];
    torch::Tensor out;
    if (is_convolution(layer)) {
      const bool in_float = is_head && arithmetic == Arithmetic::kBfloat16;
      out = convolve(i, a, in_float ? Arithmetic::kFloat : arithmetic);
    } else if (layer.kind == LayerKind::kUpsample2x) {
      out = torch::nn::functional::interpolate(a, upsampling);
    } else {
      out = a + tensors[static_cast<std::size_t>(layer.input_b)];
    }
    if (layer.relu) out = torch::relu(out);
    tensors.push_back(out);
  }
  return tensors.back().flatten(1);
}

torch::Tensor TorchNetwork::convolve(std::size_t layer, const torch::Tensor& input,
                                     Arithmetic arithmetic) {
  const FloatLayer& l = network_.layers[layer];
  const torch::nn::Conv2d& convolution = convolutions_[convolution_of_layer_[layer]];
  const std::int64_t side = l.kind == LayerKind::kConv3x3 ? 3 : 1;
  const auto run = [&](const torch::Tensor& x, const torch::Tensor& w, const torch::Tensor& b) {
    return torch::conv2d(x, w, b, l.stride, side / 2);
  };
  if (arithmetic == Arithmetic::kBfloat16) {
    return run(input.to(torch::kBFloat16), convolution->weight.to(torch::kBFloat16),
               convolution->bias.to(torch::kBFloat16));
  }
  if (arithmetic == Arithmetic::kFloat) {
    return run(input.to(torch::kFloat), convolution->weight, convolution->bias);
  }
  const torch::Tensor& weight = convolution->weight;
  const torch::Tensor scale = weight.detach().abs().amax({1, 2, 3}, true).clamp_min(1e-12) / 127;
  const torch::Tensor steps = torch::round(weight.detach() / scale) * scale;
  return run(input, weight + (steps - weight.detach()), convolution->bias);
}

torch::Tensor TorchNetwork::to_tensor(std::span<const State* const> states) const {
  const std::size_t channels = network_.inputs.size();
  if (channels * kActions > std::tuple_size_v<State>)
    throw std::invalid_argument("the trainer's states have fewer channels than the network");
  torch::Tensor out = torch::empty({static_cast<std::int64_t>(states.size()),
                                    static_cast<std::int64_t>(channels), kGridSide, kGridSide});
  float* const values = out.data_ptr<float>();
  const int threads = states.size() < 256 ? 1 : torch::get_num_threads();
  for_each_index(states.size(), threads, [&](std::size_t n) {
    float* value = values + n * channels * kActions;
    for (std::size_t c = 0; c < channels; ++c) {
      const InputChannel scaling = network_.inputs[c];
      for (std::size_t i = 0; i < kActions; ++i) {
        const float v = static_cast<float>((*states[n])[c * kActions + i]);
        *value++ = std::clamp((v - scaling.offset) * scaling.scale, 0.0f, 1.0f);
      }
    }
  });
  return out;
}

FloatNetwork TorchNetwork::to_float_network() const {
  FloatNetwork out = network_;
  for (std::size_t i = 0; i < out.layers.size(); ++i) {
    if (!is_convolution(out.layers[i])) continue;
    const torch::nn::Conv2d& convolution = convolutions_[convolution_of_layer_[i]];
    out.layers[i].weights = values_of(convolution->weight);
    out.layers[i].bias = values_of(convolution->bias);
  }
  return out;
}

void TorchNetwork::follow(TorchNetwork& other, double share) {
  const torch::NoGradGuard no_gradient;
  const auto mine = parameters(), theirs = other.parameters();
  for (std::size_t i = 0; i < mine.size(); ++i) mine[i].lerp_(theirs[i], share);
}

}  // namespace ivfm::host
