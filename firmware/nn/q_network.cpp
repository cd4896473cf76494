#include "firmware/nn/q_network.h"

#include <algorithm>

namespace ivfm {

namespace {

// 1 / x of a positive IEEE 754 float, as a whole number: 0 where that is too small or too large.
// In integers, so that it is the same on every target.
std::int32_t reciprocal_of_f32(std::uint32_t bits) {
  const std::uint64_t mantissa = (bits & 0x7fffffu) | 0x800000u;
  const int shift = 150 - static_cast<int>(bits >> 23);  // x = mantissa / 2^shift
  if (shift < 23 || shift > 53) return 0;
  return static_cast<std::int32_t>((std::uint64_t{1} << shift) / mantissa);
}

}  // namespace

ModelStatus QNetwork::load(std::span<const std::uint8_t> file) {
  const ModelStatus status = load_model(file, model_);
  has_model_ = ok(status.status);
  unit_ = has_model_ ? reciprocal_of_f32(model_.output_scale_f32_bits) : 0;
  return status;
}

ModelStatus QNetwork::load_for_robot(std::span<const std::uint8_t> file) {
  const ModelStatus status = load(file);
  if (!ok(status.status) || model_.state_kind == StateKind::kIvfm) return status;
  has_model_ = false;
  return {Status::kUnsupported,
          "its state is not i-VFM and path, which robots have (run.state = ivfm in training)"};
}

std::span<const std::int32_t> QNetwork::run(std::span<const std::uint16_t> state) {
  if (!has_model_ || state.size() != std::size_t{model_.input_channels} * kPolicyGridSize)
    return {};
  quantize_state(state);
  for (std::size_t i = 0; i < model_.layer_count; ++i) run_layer(model_.layers[i]);
  return values_;
}

Status QNetwork::evaluate(const LocalState& state, std::span<std::int32_t> q_values) {
  if (!has_model_) return Status::kUnavailable;
  const std::span<const std::int32_t> values = run(state.channels);
  if (values.empty() || q_values.size() != values.size()) return Status::kInvalidArgument;
  std::copy(values.begin(), values.end(), q_values.begin());
  return Status::kOk;
}

void QNetwork::quantize_state(std::span<const std::uint16_t> state) {
  const auto stored = static_cast<std::size_t>(model_.tensors[0].stored_channels());
  std::int16_t* input = tensor(0);
  std::fill_n(input, model_.tensors[0].values(), std::int16_t{0});
  for (std::size_t c = 0; c < model_.input_channels; ++c) {
    const InputChannelView channel = model_.inputs[c];
    const std::uint16_t* values = state.data() + c * kPolicyGridSize;
    const std::int32_t half = 1 << (channel.shift - 1);
    for (std::size_t i = 0; i < kPolicyGridSize; ++i) {
      const std::int32_t scaled =
          ((values[i] - channel.offset) * channel.multiplier + half) >> channel.shift;
      input[i * stored + c] =
          static_cast<std::int16_t>(std::clamp<std::int32_t>(scaled, 0, kMaxActivation));
    }
  }
}

void QNetwork::run_layer(const LayerView& layer) {
  const TensorView& in_shape = model_.tensors[layer.input_a];
  const std::int16_t* in = tensor(layer.input_a);
  if (layer.raw) return kernels_->head(layer, in_shape, in, values_.data());
  std::int16_t* out = tensor(layer.output);
  switch (layer.kind) {
    case LayerKind::kConv3x3:
    case LayerKind::kConv1x1: return kernels_->convolve(layer, in_shape, in, out, scratch_.data());
    case LayerKind::kUpsample2x: return kernels_->upsample(in_shape, in, out);
    case LayerKind::kAdd:
      return kernels_->add(layer, in_shape.values(), in, tensor(layer.input_b), out);
  }
}

}  // namespace ivfm
