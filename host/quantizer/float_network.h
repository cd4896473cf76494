// The Q-network with float weights, as plain data: what the trainer fills and the quantizer reads.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "firmware/nn/model_format.h"

namespace ivfm::host {

// How a uint16 state channel becomes a network input: x = clamp((v - offset) * scale, 0, 1).
// A negative scale turns a distance into a closeness.
struct InputChannel {
  float offset = 0;
  float scale = 1;
};

// One layer. Tensor 0 is the network's input, tensor i + 1 the output of layer i.
struct FloatLayer {
  LayerKind kind = LayerKind::kConv3x3;
  int stride = 1;              // convolutions: 1, or 2 (3x3 only)
  bool relu = true;            // applied to the layer's output; convolutions and additions only
  int input_a = 0;             // tensor number
  int input_b = -1;            // second operand of an addition, else -1
  int outputs = 0;             // output channels of a convolution, else 0
  std::vector<float> weights;  // [output][input][ky][kx], the order of torch.nn.Conv2d
  std::vector<float> bias;     // [output]
};

struct Shape {
  int height = 0;
  int width = 0;
  int channels = 0;
  bool operator==(const Shape&) const = default;
  std::size_t size() const {
    return static_cast<std::size_t>(height) * static_cast<std::size_t>(width) *
           static_cast<std::size_t>(channels);
  }
};

// A graph of layers over a 32 x 32 grid; the last layer is the head: 1x1, one output, no ReLU.
struct FloatNetwork {
  std::string name;  // at most 23 printable ASCII characters
  StateKind state_kind = StateKind::kIvfm;
  ValueKind value_kind = ValueKind::kDiscountedReturn;
  std::uint32_t policy_cell_um = 0;  // side of a policy cell in training, 0 when not fixed
  std::vector<InputChannel> inputs;  // one a channel of the state
  std::vector<FloatLayer> layers;

  // The shape of every tensor. Throws std::invalid_argument with the layer and what is wrong with
  // it when the graph or the sizes of weights do not fit together.
  std::vector<Shape> shapes() const;
};

std::int64_t multiply_adds(const FloatNetwork& network);
std::size_t weight_count(const FloatNetwork& network);

// Builds a graph layer by layer; each call answers the number of the tensor it makes. Weights and
// biases are zero.
class NetworkBuilder {
 public:
  explicit NetworkBuilder(StateKind state_kind, std::string name);
  static constexpr int kInput = 0;
  int conv3x3(int input, int outputs, int stride = 1, bool relu = true);
  int conv1x1(int input, int outputs, bool relu = true);
  int upsample2x(int input);
  int add(int a, int b, bool relu = true);
  // Ends the graph with the head over `input`. Throws as FloatNetwork::shapes().
  FloatNetwork finish(int input);

 private:
  int append(FloatLayer layer);

  FloatNetwork network_;
  std::vector<int> channels_;
};

// The shipped topology: an encoder and decoder with skips, 18 convolutions, 20.6 M multiply-adds.
FloatNetwork make_unet18(StateKind state_kind = StateKind::kIvfm);

// unet18 with random weights that keep the activations' size (He), reproducible from `seed`.
FloatNetwork make_random_network(std::uint64_t seed, StateKind state_kind = StateKind::kIvfm);
// Fills the weights of any graph likewise.
void randomize(FloatNetwork& network, std::uint64_t seed);

// The `.fnet` file: little endian, described in float_network_file.cpp. Throws std::runtime_error
// with the path and the reason.
void save_network(const FloatNetwork& network, const std::filesystem::path& path);
FloatNetwork load_network(const std::filesystem::path& path);
std::vector<std::uint8_t> encode_network(const FloatNetwork& network);
// Throws std::invalid_argument.
FloatNetwork decode_network(std::span<const std::uint8_t> bytes);

// Runs a network; keeps its own copy of the weights and all tensors. Not for two threads at once.
class FloatRunner {
 public:
  explicit FloatRunner(const FloatNetwork& network);
  // `state`: the channels one after the other, 1024 values each, as the state encoder writes them.
  // Answers 1024 values, valid until the next call. Throws std::invalid_argument on a wrong size.
  std::span<const float> run(std::span<const std::uint16_t> state);
  // A tensor of the last run, [y][x][channel].
  std::span<const float> tensor(int index) const {
    return tensors_[static_cast<std::size_t>(index)];
  }

 private:
  void convolve(const FloatLayer& layer, std::size_t index);
  void upsample(const FloatLayer& layer, std::size_t index);
  void add(const FloatLayer& layer, std::size_t index);

  FloatNetwork network_;
  std::vector<Shape> shapes_;
  std::vector<std::vector<float>> packed_;   // per layer: [ky][kx][input][output]
  std::vector<std::vector<float>> tensors_;  // per tensor
  std::vector<float> columns_;               // the patches of one convolution
};

}  // namespace ivfm::host
