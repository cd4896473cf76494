#include "firmware/nn/model_view.h"

#include <algorithm>
#include <cstring>

#include "firmware/nn/little_endian.h"
#include "firmware/nn/state_encoder.h"
#include "shared/wire/crc.h"

namespace ivfm {
namespace {

namespace format = model_format;

constexpr ModelStatus kGood{};
constexpr std::size_t align_up(std::size_t value) {
  return (value + format::kBlobAlignment - 1) / format::kBlobAlignment * format::kBlobAlignment;
}
constexpr ModelStatus corrupt(const char* reason) { return {Status::kCorrupt, reason}; }
constexpr ModelStatus unsupported(const char* reason) { return {Status::kUnsupported, reason}; }
constexpr ModelStatus exceeds(const char* reason) { return {Status::kOutOfRange, reason}; }

bool all_zero(const std::uint8_t* first, std::size_t size) {
  return std::all_of(first, first + size, [](std::uint8_t b) { return b == 0; });
}

bool is_positive_finite_f32(std::uint32_t bits) { return bits > 0 && bits < 0x7f800000u; }

// Reads the file from front to back; every step may answer a fault, which ends the reading.
class Loader {
 public:
  Loader(std::span<const std::uint8_t> file, ModelView& model) : file_(file), model_(model) {}

  ModelStatus run() {
    using Step = ModelStatus (Loader::*)();
    constexpr Step kSteps[] = {&Loader::read_envelope, &Loader::read_header, &Loader::read_inputs,
                               &Loader::read_tensors,  &Loader::read_layers, &Loader::check_buffers,
                               &Loader::check_totals};
    for (const Step step : kSteps)
      if (const ModelStatus fault = (this->*step)(); !ok(fault.status)) return fault;
    return kGood;
  }

 private:
  const std::uint8_t* at(std::size_t offset) const { return file_.data() + offset; }

  ModelStatus read_envelope() {
    if (file_.size() < format::kHeaderBytes)
      return {Status::kTruncated, "the file is shorter than a model's header"};
    if (read_u32(at(0)) != format::kMagic) return unsupported("not a model file");
    if (read_u16(at(4)) != format::kVersion)
      return unsupported("a model file of another version; ivfm-train quantize writes this one");
    if (read_u16(at(6)) != format::kHeaderBytes) return corrupt("wrong header size");
    const std::uint32_t size = read_u32(at(8));
    if (size > kMaxModelBytes) return exceeds("the model file is too large");
    if (size > file_.size()) return {Status::kTruncated, "the file ends before the model does"};
    if (size < file_.size()) return corrupt("bytes after the end of the model");
    model_.crc = read_u32(at(12));
    if (crc32(file_.subspan(format::kCrcFrom)) != model_.crc) return corrupt("wrong checksum");
    return kGood;
  }

  ModelStatus read_header() {
    model_.layer_count = *at(16);
    model_.tensor_count = *at(17);
    if (*at(18) > static_cast<int>(StateKind::kFoldedIvfm))
      return unsupported("unknown state kind");
    if (*at(19) > static_cast<int>(ValueKind::kScore)) return unsupported("unknown value kind");
    model_.state_kind = static_cast<StateKind>(*at(18));
    model_.value_kind = static_cast<ValueKind>(*at(19));
    model_.input_channels = *at(20);
    model_.tensor_bytes = read_u32(at(24));
    model_.output_scale_f32_bits = read_u32(at(28));
    model_.policy_cell_um = read_u32(at(32));
    if (model_.layer_count < 1 || model_.layer_count > kMaxLayers)
      return exceeds("no layers, or more than this build holds");
    if (model_.tensor_count != model_.layer_count)
      return corrupt("the numbers of tensors and layers do not fit");
    if (model_.input_channels != channels_of(model_.state_kind))
      return corrupt("the input channels are not those of the state");
    if (*at(21) != kPolicyCells) return unsupported("not a 32 x 32 policy grid");
    if (!all_zero(at(22), 2) || !all_zero(at(36), 4) || !all_zero(at(112), 16))
      return corrupt("reserved header bytes are not zero");
    if (!is_positive_finite_f32(model_.output_scale_f32_bits)) return corrupt("bad output scale");
    if (model_.tensor_bytes > kTensorMemoryBytes)
      return exceeds("the activations need too much memory");
    std::memcpy(model_.name.data(), at(40), kMaxNameBytes);
    return check_name();
  }

  ModelStatus check_name() const {
    const auto& name = model_.name;
    const auto end = std::find(name.begin(), name.end(), '\0');
    if (end == name.end() || std::any_of(end, name.end(), [](char c) { return c; }))
      return corrupt("the model's name does not end with zeros");
    if (std::any_of(name.begin(), end, [](char c) { return c < 0x20 || c > 0x7e; }))
      return corrupt("the model's name is not printable ASCII");
    return kGood;
  }

  ModelStatus read_inputs() {
    for (std::size_t c = 0; c < kMaxInputChannels; ++c) {
      const std::uint8_t* p = at(64 + c * format::kInputChannelBytes);
      if (c >= model_.input_channels) {
        if (!all_zero(p, format::kInputChannelBytes)) return corrupt("an unused input is not zero");
        continue;
      }
      const InputChannelView input{read_i32(p), read_i32(p + 4), p[8]};
      // (65535 * 2^14 + 2^29) fits an int32.
      if (input.offset < 0 || input.offset > 65535 || input.multiplier < -(1 << 14) ||
          input.multiplier > 1 << 14 || input.shift < 1 || input.shift > 30 || !all_zero(p + 9, 3))
        return corrupt("an input channel's quantization is out of range");
      model_.inputs[c] = input;
    }
    return kGood;
  }

  ModelStatus read_tensors() {
    const std::size_t tables = format::kHeaderBytes + model_.tensor_count * format::kTensorBytes +
                               model_.layer_count * format::kLayerBytes;
    if (tables > file_.size()) return {Status::kTruncated, "the file ends inside its tables"};
    for (std::size_t i = 0; i < model_.tensor_count; ++i) {
      const std::uint8_t* p = at(format::kHeaderBytes + i * format::kTensorBytes);
      const TensorView tensor{p[0], p[1], p[2], false, read_u32(p + 4), read_u32(p + 8)};
      if (p[3] != 0) return corrupt("a tensor's reserved byte is not zero");
      if (tensor.height < 1 || tensor.height > kPolicyCells || tensor.width < 1 ||
          tensor.width > kPolicyCells || tensor.channels < 1 || tensor.channels > kMaxChannels)
        return exceeds("a tensor's shape is out of range");
      if (i != 0 && tensor.channels % format::kOutputGroup != 0)
        return unsupported("a tensor's channels are no multiple of 16");
      if (tensor.offset % format::kBlobAlignment != 0 || tensor.offset > model_.tensor_bytes ||
          tensor.bytes() > model_.tensor_bytes - tensor.offset)
        return exceeds("a tensor lies outside the activation memory");
      if (!is_positive_finite_f32(tensor.scale_f32_bits)) return corrupt("bad tensor scale");
      model_.tensors[i] = tensor;
    }
    TensorView& input = model_.tensors[0];
    input.non_negative = true;
    if (input.height != kPolicyCells || input.width != kPolicyCells ||
        input.channels != model_.input_channels)
      return corrupt("the first tensor is not the state");
    return kGood;
  }

  // Layer i makes tensor i + 1; the last one is the head and makes none.
  ModelStatus read_layers() {
    const std::size_t table = format::kHeaderBytes + model_.tensor_count * format::kTensorBytes;
    next_blob_ = align_up(table + model_.layer_count * format::kLayerBytes);
    if (const ModelStatus fault = check_padding(table + model_.layer_count * format::kLayerBytes);
        !ok(fault.status))
      return fault;
    for (std::size_t i = 0; i < model_.layer_count; ++i) {
      const std::uint8_t* p = at(table + i * format::kLayerBytes);
      if (const ModelStatus fault = read_layer(i, p); !ok(fault.status)) return fault;
    }
    if (next_blob_ != file_.size()) return corrupt("bytes that belong to no layer");
    return kGood;
  }

  // The bytes from `end` to the next blob exist and are zero.
  ModelStatus check_padding(std::size_t end) const {
    if (align_up(end) > file_.size()) return {Status::kTruncated, "the file ends inside a layer"};
    return all_zero(at(end), align_up(end) - end) ? kGood : corrupt("the padding is not zero");
  }

  ModelStatus read_layer(std::size_t index, const std::uint8_t* p) {
    const bool is_head = index + 1 == model_.layer_count;
    LayerView& layer = model_.layers[index];
    layer = {};
    if (p[0] > static_cast<int>(LayerKind::kAdd)) return unsupported("unknown layer kind");
    if ((p[2] & ~(format::kFlagRelu | format::kFlagRaw)) != 0)
      return unsupported("unknown layer flag");
    layer.kind = static_cast<LayerKind>(p[0]);
    layer.stride = p[1];
    layer.relu = (p[2] & format::kFlagRelu) != 0;
    layer.raw = (p[2] & format::kFlagRaw) != 0;
    layer.shift = p[3];
    layer.input_a = p[4];
    layer.input_b = p[5];
    layer.output = is_head ? format::kNoTensor : static_cast<std::uint8_t>(index + 1);
    layer.outputs = p[6];
    layer.multiplier_a = read_u32(p + 16);
    layer.multiplier_b = read_u32(p + 20);
    if (p[7] != 0) return corrupt("a layer's reserved byte is not zero");
    if (layer.raw != is_head) return corrupt("the head is not exactly the last layer");
    if (layer.input_a > index || (layer.input_b > index && layer.input_b != format::kNoTensor))
      return corrupt("a layer reads a tensor that is not made yet");
    if (layer.is_convolution()) return read_convolution(layer, read_u32(p + 8), read_u32(p + 12));
    if (layer.stride != 1 || layer.outputs != 0 || read_u32(p + 8) != 0 || read_u32(p + 12) != 0)
      return corrupt("a layer without weights has a convolution's fields");
    return layer.kind == LayerKind::kAdd ? check_add(layer) : check_upsample(layer);
  }

  ModelStatus check_upsample(const LayerView& layer) {
    const TensorView& in = model_.tensors[layer.input_a];
    TensorView& out = model_.tensors[layer.output];
    if (layer.input_b != format::kNoTensor || layer.relu || layer.shift != 0 ||
        layer.multiplier_a != 0 || layer.multiplier_b != 0)
      return corrupt("an upsampling layer has fields of other layers");
    if (out.height != 2 * in.height || out.width != 2 * in.width || out.channels != in.channels)
      return corrupt("an upsampling layer's shapes do not fit");
    out.non_negative = in.non_negative;
    return kGood;
  }

  ModelStatus check_add(const LayerView& layer) {
    if (layer.input_b == format::kNoTensor) return corrupt("an addition has one operand only");
    const TensorView& a = model_.tensors[layer.input_a];
    const TensorView& b = model_.tensors[layer.input_b];
    TensorView& out = model_.tensors[layer.output];
    if (!out.same_shape(a) || !out.same_shape(b)) return corrupt("an addition's shapes differ");
    // 2 * 16383 * 2^15 + 2^29 fits an int32.
    if (layer.shift < 1 || layer.shift > 30 || layer.multiplier_a > format::kMaxAddMultiplier ||
        layer.multiplier_b > format::kMaxAddMultiplier)
      return corrupt("an addition's scaling is out of range");
    out.non_negative = layer.relu || (a.non_negative && b.non_negative);
    return kGood;
  }

  ModelStatus read_convolution(LayerView& layer, std::uint32_t offset, std::uint32_t size) {
    const TensorView& in = model_.tensors[layer.input_a];
    if (layer.input_b != format::kNoTensor || layer.multiplier_a != 0 || layer.multiplier_b != 0)
      return corrupt("a convolution has an addition's fields");
    if (layer.stride != 1 && !(layer.stride == 2 && layer.kind == LayerKind::kConv3x3))
      return unsupported("a convolution's stride is not supported");
    if (layer.raw ? layer.relu || layer.shift != 0 : layer.shift < 1 || layer.shift > 62)
      return corrupt("a convolution's scaling is out of range");
    const int height = (in.height + layer.stride - 1) / layer.stride;
    const int width = (in.width + layer.stride - 1) / layer.stride;
    if (layer.raw) {
      if (layer.outputs != 1 || layer.kind != LayerKind::kConv1x1 || height != kPolicyCells ||
          width != kPolicyCells)
        return corrupt("the head does not answer one value a policy cell");
    } else {
      TensorView& out = model_.tensors[layer.output];
      if (out.height != height || out.width != width || out.channels != layer.outputs)
        return corrupt("a convolution's shapes do not fit");
      out.non_negative = layer.relu;
    }
    if (!in.non_negative) return unsupported("a convolution's input may be negative");
    return read_weights(layer, in, offset, size, height * width);
  }

  ModelStatus read_weights(LayerView& layer, const TensorView& in, std::uint32_t offset,
                           std::uint32_t size, int pixels) {
    layer.stored_outputs = static_cast<std::uint16_t>((layer.outputs + 15) / 16 * 16);
    const std::size_t vector_bytes = align_up(std::size_t{layer.stored_outputs} * 4);
    const std::size_t weights = std::size_t{layer.stored_outputs} *
                                static_cast<std::size_t>(layer.taps() * in.stored_channels());
    if (offset != next_blob_ || size != 2 * vector_bytes + weights)
      return corrupt("a layer's weights are not where they belong");
    if (size > file_.size() - offset) return {Status::kTruncated, "the file ends inside a layer"};
    layer.bias = at(offset);
    layer.multipliers = layer.bias + vector_bytes;
    layer.weights = reinterpret_cast<const std::int8_t*>(layer.multipliers + vector_bytes);
    next_blob_ = align_up(offset + size);
    model_.weight_bytes += static_cast<std::uint32_t>(weights);
    model_.multiply_adds += static_cast<std::int64_t>(weights) * pixels;
    if (const ModelStatus fault = check_padding(offset + size); !ok(fault.status)) return fault;
    return check_accumulators(layer, in);
  }

  // Every output's accumulator stays within an int32, whatever the activations. Multipliers
  // are below 2^31, so that accumulator * multiplier + 2^61 fits an int64.
  ModelStatus check_accumulators(const LayerView& layer, const TensorView& in) const {
    std::array<std::int64_t, kMaxChannels> sums{};
    const std::size_t weights_per_group =
        std::size_t{format::kOutputGroup} *
        static_cast<std::size_t>(layer.taps() * in.stored_channels());
    for (std::size_t o = 0; o < layer.stored_outputs; ++o)
      sums[o] = std::abs(std::int64_t{read_i32(layer.bias + 4 * o)});
    for (std::size_t i = 0; i < weights_per_group * (layer.stored_outputs / 16u); ++i) {
      const int weight = layer.weights[i];
      if (weight == -128) return corrupt("a weight of -128");
      sums[i / weights_per_group * 16 + i / 4 % 16] += kMaxActivation * std::abs(weight);
    }
    for (std::size_t o = 0; o < layer.stored_outputs; ++o) {
      const std::int32_t multiplier = read_i32(layer.multipliers + 4 * o);
      if (sums[o] > INT32_MAX) return exceeds("a layer's sums can overflow");
      if (multiplier < 0 || (layer.raw && multiplier != 0))
        return corrupt("a layer's multiplier is out of range");
    }
    return kGood;
  }

  // The last layer that reads `tensor`, or -1.
  int last_use(std::size_t tensor) const {
    for (int i = model_.layer_count - 1; i >= 0; --i)
      if (model_.layers[static_cast<std::size_t>(i)].input_a == tensor ||
          model_.layers[static_cast<std::size_t>(i)].input_b == tensor)
        return i;
    return -1;
  }

  // No layer overwrites a tensor that it or a later layer still reads; an addition may replace an
  // operand that nobody needs afterwards.
  ModelStatus check_buffers() {
    for (int i = 0; i + 1 < model_.layer_count; ++i) {
      const auto layer = static_cast<std::size_t>(i);
      const TensorView& out = model_.tensors[layer + 1];
      for (std::size_t t = 0; t <= layer; ++t) {
        const TensorView& other = model_.tensors[t];
        const int last = last_use(t);
        const bool apart =
            out.offset >= other.offset + other.bytes() || other.offset >= out.offset + out.bytes();
        const bool in_place =
            last == i && model_.layers[layer].kind == LayerKind::kAdd && out.offset == other.offset;
        if (last >= i && !apart && !in_place) return corrupt("a layer overwrites a tensor in use");
      }
    }
    return kGood;
  }

  ModelStatus check_totals() {
    if (model_.weight_bytes > kMaxWeightBytes) return exceeds("too many weights");
    if (model_.multiply_adds > kMaxMultiplyAdds) return exceeds("too many multiply-adds");
    return kGood;
  }

  std::span<const std::uint8_t> file_;
  ModelView& model_;
  std::size_t next_blob_ = 0;
};

}  // namespace

ModelStatus load_model(std::span<const std::uint8_t> file, ModelView& model) {
  model = {};
  return Loader(file, model).run();
}

}  // namespace ivfm
