#include "host/quantizer/float_network.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <utility>

#include "firmware/nn/state_encoder.h"

namespace ivfm::host {
namespace {

using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

bool is_convolution(LayerKind kind) {
  return kind == LayerKind::kConv3x3 || kind == LayerKind::kConv1x1;
}

int kernel_side(LayerKind kind) { return kind == LayerKind::kConv3x3 ? 3 : 1; }

// The usual inputs: i-VFM from "never seen" (0) to "blocked" (1), closeness from "unreachable or
// more than 64 policy cells" (0) to "here" (1). Zero padding then reads as unseen and out of reach.
std::vector<InputChannel> default_inputs(StateKind kind) {
  const InputChannel ivfm{20480.0f, 1.0f / 28672.0f};
  const InputChannel path{16640.0f, -1.0f / 16640.0f};
  const InputChannel fraction{0.0f, 1.0f / 49152.0f};
  switch (kind) {
    case StateKind::kIvfm: return {ivfm, path};
    case StateKind::kVfm: return {fraction, fraction, fraction, path};
    case StateKind::kFoldedIvfm: return {ivfm};
  }
  return {};
}

[[noreturn]] void fail(std::size_t layer, const std::string& what) {
  throw std::invalid_argument("layer " + std::to_string(layer) + ": " + what);
}

Shape operand(const std::vector<Shape>& shapes, std::size_t layer, int tensor) {
  if (tensor < 0 || static_cast<std::size_t>(tensor) >= shapes.size())
    fail(layer, "its operand, tensor " + std::to_string(tensor) + ", is not made before it");
  return shapes[static_cast<std::size_t>(tensor)];
}

Shape convolution_shape(const FloatLayer& layer, std::size_t index, const Shape& in) {
  const int side = kernel_side(layer.kind);
  if (layer.outputs < 1 || layer.outputs > kMaxChannels) fail(index, "bad number of outputs");
  if (layer.stride != 1 && !(layer.stride == 2 && side == 3)) fail(index, "bad stride");
  const auto expected = static_cast<std::size_t>(layer.outputs * in.channels * side * side);
  if (layer.weights.size() != expected)
    fail(index, std::to_string(layer.weights.size()) + " weights where " +
                    std::to_string(expected) + " belong");
  if (layer.bias.size() != static_cast<std::size_t>(layer.outputs)) fail(index, "bad bias size");
  return {(in.height + layer.stride - 1) / layer.stride,
          (in.width + layer.stride - 1) / layer.stride, layer.outputs};
}

Shape output_shape(const FloatLayer& layer, std::size_t index, const std::vector<Shape>& shapes) {
  const Shape a = operand(shapes, index, layer.input_a);
  if (is_convolution(layer.kind)) return convolution_shape(layer, index, a);
  if (layer.kind == LayerKind::kUpsample2x) {
    if (a.height > kPolicyCells / 2) fail(index, "the result is larger than the policy grid");
    return {a.height * 2, a.width * 2, a.channels};
  }
  if (!(operand(shapes, index, layer.input_b) == a)) fail(index, "operands of different shapes");
  return a;
}

}  // namespace

std::vector<Shape> FloatNetwork::shapes() const {
  const int channels = channels_of(state_kind);
  if (inputs.size() != static_cast<std::size_t>(channels))
    throw std::invalid_argument("the network has " + std::to_string(inputs.size()) +
                                " input channels where its state has " + std::to_string(channels));
  std::vector<Shape> shapes = {{kPolicyCells, kPolicyCells, channels}};
  for (std::size_t i = 0; i < layers.size(); ++i)
    shapes.push_back(output_shape(layers[i], i, shapes));
  const bool has_head = !layers.empty() && layers.back().kind == LayerKind::kConv1x1 &&
                        !layers.back().relu &&
                        shapes.back() == Shape{kPolicyCells, kPolicyCells, 1};
  if (!has_head)
    throw std::invalid_argument("the last layer is not a head (1x1, 32 x 32 x 1, no ReLU)");
  return shapes;
}

std::int64_t multiply_adds(const FloatNetwork& network) {
  const std::vector<Shape> shapes = network.shapes();
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < network.layers.size(); ++i)
    sum += static_cast<std::int64_t>(network.layers[i].weights.size()) * shapes[i + 1].height *
           shapes[i + 1].width;
  return sum;
}

std::size_t weight_count(const FloatNetwork& network) {
  std::size_t sum = 0;
  for (const FloatLayer& layer : network.layers) sum += layer.weights.size();
  return sum;
}

NetworkBuilder::NetworkBuilder(StateKind state_kind, std::string name) {
  network_.name = std::move(name);
  network_.state_kind = state_kind;
  network_.inputs = default_inputs(state_kind);
  channels_ = {channels_of(state_kind)};
}

int NetworkBuilder::append(FloatLayer layer) {
  const int in = channels_.at(static_cast<std::size_t>(layer.input_a));
  const int side = kernel_side(layer.kind);
  layer.weights.assign(static_cast<std::size_t>(layer.outputs * in * side * side), 0.0f);
  layer.bias.assign(static_cast<std::size_t>(layer.outputs), 0.0f);
  channels_.push_back(is_convolution(layer.kind) ? layer.outputs : in);
  network_.layers.push_back(std::move(layer));
  return static_cast<int>(channels_.size()) - 1;
}

int NetworkBuilder::conv3x3(int input, int outputs, int stride, bool relu) {
  return append({LayerKind::kConv3x3, stride, relu, input, -1, outputs, {}, {}});
}

int NetworkBuilder::conv1x1(int input, int outputs, bool relu) {
  return append({LayerKind::kConv1x1, 1, relu, input, -1, outputs, {}, {}});
}

int NetworkBuilder::upsample2x(int input) {
  return append({LayerKind::kUpsample2x, 1, false, input, -1, 0, {}, {}});
}

int NetworkBuilder::add(int a, int b, bool relu) {
  return append({LayerKind::kAdd, 1, relu, a, b, 0, {}, {}});
}

FloatNetwork NetworkBuilder::finish(int input) {
  conv1x1(input, 1, false);
  network_.shapes();
  return network_;
}

FloatNetwork make_unet18(StateKind state_kind) {
  NetworkBuilder b(state_kind, "unet18");
  // Encoder: 32 x 32, 16 x 16, 8 x 8, 4 x 4.
  const int skip_32 = b.conv3x3(b.conv3x3(NetworkBuilder::kInput, 16), 16);
  const int skip_16 = b.conv3x3(b.conv3x3(skip_32, 32, 2), 32);
  const int at_8 = b.conv3x3(skip_16, 64, 2);
  const int skip_8 = b.add(at_8, b.conv3x3(b.conv3x3(at_8, 64), 64, 1, false));
  const int at_4 = b.conv3x3(b.conv3x3(skip_8, 64, 2), 64);
  // Decoder: each step doubles the grid and adds the encoder's features of that size.
  const auto merge = [&b](int low, int outputs, int skip) {
    const int sum = b.add(skip, b.upsample2x(b.conv1x1(low, outputs, false)));
    return b.conv3x3(sum, outputs);
  };
  return b.finish(merge(merge(merge(at_4, 64, skip_8), 32, skip_16), 16, skip_32));
}

void randomize(FloatNetwork& network, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  // The sum of 12 uniform numbers: the same on every standard library, unlike its distributions.
  const auto gauss = [&random] {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += static_cast<double>(random() >> 11) * 0x1p-53;
    return static_cast<float>(sum);
  };
  for (FloatLayer& layer : network.layers) {
    if (!is_convolution(layer.kind)) continue;
    const auto fan_in =
        static_cast<float>(layer.weights.size()) / static_cast<float>(layer.outputs);
    const float deviation = std::sqrt((layer.relu ? 2.0f : 1.0f) / fan_in);
    for (float& w : layer.weights) w = deviation * gauss();
    for (float& b : layer.bias) b = 0.05f * gauss();
  }
}

FloatNetwork make_random_network(std::uint64_t seed, StateKind state_kind) {
  FloatNetwork network = make_unet18(state_kind);
  randomize(network, seed);
  return network;
}

FloatRunner::FloatRunner(const FloatNetwork& network)
    : network_(network), shapes_(network.shapes()), packed_(network.layers.size()) {
  for (const Shape& shape : shapes_) tensors_.emplace_back(shape.size());
  for (std::size_t i = 0; i < network_.layers.size(); ++i) {
    const FloatLayer& layer = network_.layers[i];
    if (!is_convolution(layer.kind)) continue;
    const auto taps = static_cast<std::size_t>(kernel_side(layer.kind) * kernel_side(layer.kind));
    const auto outputs = static_cast<std::size_t>(layer.outputs);
    const std::size_t in = layer.weights.size() / outputs / taps;
    packed_[i].resize(layer.weights.size());
    for (std::size_t o = 0; o < outputs; ++o)
      for (std::size_t c = 0; c < in; ++c)
        for (std::size_t t = 0; t < taps; ++t)
          packed_[i][(t * in + c) * outputs + o] = layer.weights[(o * in + c) * taps + t];
  }
}

std::span<const float> FloatRunner::run(std::span<const std::uint16_t> state) {
  const std::size_t channels = network_.inputs.size();
  if (state.size() != channels * kPolicyGridSize)
    throw std::invalid_argument("a state of " + std::to_string(state.size()) + " values where " +
                                std::to_string(channels * kPolicyGridSize) + " belong");
  for (std::size_t c = 0; c < channels; ++c)
    for (std::size_t i = 0; i < kPolicyGridSize; ++i) {
      const float v = static_cast<float>(state[c * kPolicyGridSize + i]);
      tensors_[0][i * channels + c] =
          std::clamp((v - network_.inputs[c].offset) * network_.inputs[c].scale, 0.0f, 1.0f);
    }
  for (std::size_t i = 0; i < network_.layers.size(); ++i) {
    const FloatLayer& layer = network_.layers[i];
    if (is_convolution(layer.kind))
      convolve(layer, i);
    else if (layer.kind == LayerKind::kUpsample2x)
      upsample(layer, i);
    else
      add(layer, i);
  }
  return tensors_.back();
}

void FloatRunner::convolve(const FloatLayer& layer, std::size_t index) {
  const auto input = static_cast<std::size_t>(layer.input_a);
  const Shape in = shapes_[input], out = shapes_[index + 1];
  const int side = kernel_side(layer.kind), depth = side * side * in.channels;
  const int pixels = out.height * out.width, pad = side / 2;
  columns_.assign(static_cast<std::size_t>(pixels * depth), 0.0f);
  float* column = columns_.data();
  for (int p = 0; p < pixels; ++p)
    for (int t = 0; t < side * side; ++t, column += in.channels) {
      const int y = p / out.width * layer.stride + t / side - pad;
      const int x = p % out.width * layer.stride + t % side - pad;
      if (y < 0 || y >= in.height || x < 0 || x >= in.width) continue;
      std::copy_n(tensors_[input].data() + (y * in.width + x) * in.channels, in.channels, column);
    }
  const Eigen::Map<const RowMajor> patches(columns_.data(), pixels, depth);
  const Eigen::Map<const RowMajor> weights(packed_[index].data(), depth, out.channels);
  const Eigen::Map<const Eigen::RowVectorXf> bias(layer.bias.data(), out.channels);
  Eigen::Map<RowMajor> result(tensors_[index + 1].data(), pixels, out.channels);
  result.noalias() = patches * weights;
  result.rowwise() += bias;
  if (layer.relu) result = result.cwiseMax(0.0f);
}

void FloatRunner::upsample(const FloatLayer& layer, std::size_t index) {
  const auto input = static_cast<std::size_t>(layer.input_a);
  const Shape out = shapes_[index + 1];
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x)
      std::copy_n(tensors_[input].data() + (y / 2 * (out.width / 2) + x / 2) * out.channels,
                  out.channels, tensors_[index + 1].data() + (y * out.width + x) * out.channels);
}

void FloatRunner::add(const FloatLayer& layer, std::size_t index) {
  const std::vector<float>& a = tensors_[static_cast<std::size_t>(layer.input_a)];
  const std::vector<float>& b = tensors_[static_cast<std::size_t>(layer.input_b)];
  std::vector<float>& out = tensors_[index + 1];
  for (std::size_t i = 0; i < out.size(); ++i) {
    const float sum = a[i] + b[i];
    out[i] = layer.relu ? std::max(sum, 0.0f) : sum;
  }
}

}  // namespace ivfm::host
