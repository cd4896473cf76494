// A small hand-made model file for tests, every field of which can be set wrong.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "firmware/nn/model_format.h"

namespace ivfm {

// Rows of the file's tables as they are in the file; the defaults make a good model:
//   input 32x32x2 -> conv3x3 stride 2 -> 16x16x16 -> upsample -> 32x32x16 (A)
//   input 32x32x2 -> conv1x1 -> 32x32x16 (B);  A + B in B's place -> head
// All weights, biases are 0 and all multipliers 2^30 with shift 30: q = accumulator, clamped.
struct TestModel {
  struct Tensor {
    std::uint8_t height, width, channels, reserved;
    std::uint32_t offset, scale_bits;
  };
  struct Layer {
    std::uint8_t kind, stride, flags, shift, input_a, input_b, outputs, reserved;
    std::uint32_t multiplier_a, multiplier_b;
    int taps, stored_inputs;  // convolutions: the size of the blob
    std::vector<std::int32_t> bias, multipliers;
    std::vector<std::int8_t> weights;
  };
  struct Input {
    std::int32_t offset, multiplier;
    std::uint8_t shift;
  };

  TestModel() {
    constexpr std::uint32_t kOne = 0x3f800000;  // 1.0f
    tensors = {{32, 32, 2, 0, 0, kOne},
               {16, 16, 16, 0, 8192, kOne},
               {32, 32, 16, 0, 16384, kOne},
               {32, 32, 16, 0, 49152, kOne},
               {32, 32, 16, 0, 49152, kOne}};
    constexpr std::uint8_t kNone = 0xff, kRelu = 1, kRaw = 2;
    layers = {convolution(0, 2, kRelu, 0, 16, 9, 4),
              {2, 1, 0, 0, 1, kNone, 0, 0, 0, 0, 0, 0, {}, {}, {}},
              convolution(1, 1, kRelu, 0, 16, 1, 4),
              {3, 1, kRelu, 15, 2, 3, 0, 0, 1 << 15, 1 << 15, 0, 0, {}, {}, {}},
              convolution(1, 1, kRaw, 4, 1, 1, 16)};
    layers.back().shift = 0;
    layers.back().multipliers.assign(16, 0);
  }

  static Layer convolution(std::uint8_t kind, std::uint8_t stride, std::uint8_t flags,
                           std::uint8_t input, std::uint8_t outputs, int taps, int stored_inputs) {
    const std::size_t stored = (std::size_t{outputs} + 15) / 16 * 16;
    const std::size_t weights = stored * static_cast<std::size_t>(taps * stored_inputs);
    Layer layer{kind, stride, flags,         30, input, 0xff, outputs, 0, 0,
                0,    taps,   stored_inputs, {}, {},    {}};
    layer.bias.assign(stored, 0);
    layer.multipliers.assign(stored, 1 << 30);
    layer.weights.assign(weights, 0);
    return layer;
  }

  // The weight from input channel `input` at `tap` to `output`.
  std::int8_t& weight(std::size_t layer, int output, int tap, int input) {
    Layer& l = layers[layer];
    return l.weights[model_format::weight_index(output, tap, input, l.taps, l.stored_inputs)];
  }

  // The file, with its size and checksum.
  std::vector<std::uint8_t> bytes() const;
  // Sets the checksum of a changed file.
  static void fix_checksum(std::vector<std::uint8_t>& file);

  std::uint8_t state_kind = 0, value_kind = 0, input_channels = 2, grid = 32;
  std::uint32_t tensor_bytes = 81920, output_scale_bits = 0x3f800000, policy_cell_um = 400'000;
  std::vector<char> name = {'t', 'e', 's', 't'};
  std::vector<Input> inputs = {{0, 1, 1}, {0, 1, 1}};
  std::vector<Tensor> tensors;
  std::vector<Layer> layers;
};

}  // namespace ivfm
