// A validated view of a model file (MODEL_FORMAT.md) that stays where it is, in flash or in memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/nn/model_format.h"
#include "shared/status/status.h"

namespace ivfm {

// An int16 tensor [y][x][channel] in the tensor memory. Channels are stored in multiples of 4; the
// ones that only fill up are 0.
struct TensorView {
  std::uint8_t height = 0;
  std::uint8_t width = 0;
  std::uint8_t channels = 0;
  bool non_negative = false;         // see kMaxActivation
  std::uint32_t offset = 0;          // in the tensor memory, a multiple of 64
  std::uint32_t scale_f32_bits = 0;  // what one step means, as an IEEE 754 float; host tools only

  constexpr int stored_channels() const { return (channels + 3) / 4 * 4; }
  constexpr std::size_t values() const {
    return std::size_t{height} * width * static_cast<std::size_t>(stored_channels());
  }
  constexpr std::size_t bytes() const { return values() * sizeof(std::int16_t); }
  constexpr bool same_shape(const TensorView& o) const {
    return height == o.height && width == o.width && channels == o.channels;
  }
};

// Requantization: q = (accumulator * multiplier + 2^(shift - 1)) >> shift in 64 bits, an arithmetic
// shift, so halves round up; then clamped to the range of an activation (kMaxActivation).
struct LayerView {
  LayerKind kind = LayerKind::kConv3x3;
  std::uint8_t stride = 1;
  bool relu = false;
  bool raw = false;  // the head: answers its accumulators
  std::uint8_t shift = 1;
  std::uint8_t input_a = 0;
  std::uint8_t input_b = model_format::kNoTensor;
  std::uint8_t output = model_format::kNoTensor;  // none for the head
  std::uint8_t outputs = 0;                       // output channels of a convolution
  std::uint16_t stored_outputs = 0;               // the same, up to a multiple of 16
  std::uint32_t multiplier_a = 0;                 // additions: one multiplier an operand
  std::uint32_t multiplier_b = 0;
  // Convolutions; little-endian int32 a stored output, at multiples of 64 bytes of the file.
  const std::uint8_t* bias = nullptr;
  const std::uint8_t* multipliers = nullptr;
  const std::int8_t* weights = nullptr;  // see model_format::weight_index()

  constexpr int side() const { return kind == LayerKind::kConv3x3 ? 3 : 1; }
  constexpr int taps() const { return side() * side(); }
  constexpr bool is_convolution() const {
    return kind == LayerKind::kConv3x3 || kind == LayerKind::kConv1x1;
  }
};

// q = clamp(((v - offset) * multiplier + 2^(shift - 1)) >> shift, 0, kMaxActivation) for a state
// value v.
struct InputChannelView {
  std::int32_t offset = 0;
  std::int32_t multiplier = 0;
  std::uint8_t shift = 1;
};

// What a network needs to run. Fields are only meaningful after load_model() said kOk.
struct ModelView {
  StateKind state_kind = StateKind::kIvfm;
  ValueKind value_kind = ValueKind::kDiscountedReturn;
  std::array<char, kMaxNameBytes> name{};   // ends with 0
  std::uint32_t policy_cell_um = 0;         // side of a policy cell in training, 0 when not fixed
  std::uint32_t output_scale_f32_bits = 0;  // Q = accumulator * scale; host tools only
  std::uint32_t crc = 0;                    // identifies the model in logs
  std::uint32_t tensor_bytes = 0;           // of the tensor memory in use
  std::uint32_t weight_bytes = 0;
  std::int64_t multiply_adds = 0;
  std::uint8_t input_channels = 0;
  std::uint8_t layer_count = 0;
  std::uint8_t tensor_count = 0;
  std::array<InputChannelView, kMaxInputChannels> inputs{};
  std::array<TensorView, kMaxTensors> tensors{};
  std::array<LayerView, kMaxLayers> layers{};
};

// The outcome of load_model(): `reason` is a phrase for people, never null, empty when all is well.
struct ModelStatus {
  Status status = Status::kOk;
  const char* reason = "";
};

// Checks `file` completely and fills `model`, which points into `file`: those bytes must outlive
// it. After kOk no input state can make the kernels leave their buffers or overflow an accumulator.
// kTruncated: shorter than it says; kCorrupt: checksum, structure or trailing bytes;
// kUnsupported: another kind of file, version, layer or state; kOutOfRange: a limit is exceeded.
ModelStatus load_model(std::span<const std::uint8_t> file, ModelView& model);

}  // namespace ivfm
