#include "host/quantizer/quantizer.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "firmware/nn/model_view.h"
#include "firmware/nn/state_encoder.h"
#include "host/quantizer/activation_memory.h"
#include "shared/wire/crc.h"

namespace ivfm::host {
namespace {

namespace format = model_format;

// Room above the largest value that the example states show.
constexpr double kHeadroom = 1.5;

// What the example states say about each tensor.
struct Statistics {
  std::vector<double> scales;              // what one step means
  std::vector<std::vector<double>> means;  // per channel
};

// The input's scale is 1 / kMaxActivation by definition; doubling keeps the scale.
Statistics find_statistics(const FloatNetwork& network, std::span<const std::uint16_t> states) {
  const std::size_t state_size = network.inputs.size() * kPolicyGridSize;
  if (states.empty() || states.size() % state_size != 0)
    throw std::invalid_argument("no example states, or not of " + std::to_string(state_size) +
                                " values each");
  const std::vector<Shape> shapes = network.shapes();
  FloatRunner runner(network);
  std::vector<float> largest(shapes.size(), 0.0f);
  Statistics result;
  for (const Shape& shape : shapes) result.means.emplace_back(shape.channels, 0.0);
  for (std::size_t at = 0; at < states.size(); at += state_size) {
    runner.run(states.subspan(at, state_size));
    for (std::size_t t = 0; t < shapes.size(); ++t) {
      const std::span<const float> values = runner.tensor(static_cast<int>(t));
      const std::size_t channels = result.means[t].size();
      const double share = static_cast<double>(channels * state_size) /
                           static_cast<double>(values.size() * states.size());
      for (std::size_t i = 0; i < values.size(); ++i) {
        largest[t] = std::max(largest[t], std::abs(values[i]));
        result.means[t][i % channels] += share * static_cast<double>(values[i]);
      }
    }
  }
  result.scales.assign(shapes.size(), 1.0 / kMaxActivation);
  for (std::size_t i = 0; i < network.layers.size(); ++i) {
    const double range = largest[i + 1] > 0 ? kHeadroom * largest[i + 1] : 1.0;
    result.scales[i + 1] = network.layers[i].kind == LayerKind::kUpsample2x
                               ? result.scales[static_cast<std::size_t>(network.layers[i].input_a)]
                               : range / kMaxActivation;
  }
  return result;
}

// A common shift for positive factors, and each one as an integer below 2^bits at that shift.
struct FixedPoint {
  int shift = 1;
  std::vector<std::uint32_t> multipliers;
};

FixedPoint to_fixed_point(const std::vector<double>& factors, int bits, int max_shift) {
  const double largest = *std::max_element(factors.begin(), factors.end());
  int exponent = 0;
  std::frexp(largest, &exponent);  // largest < 2^exponent
  FixedPoint fixed;
  fixed.shift = std::clamp(bits - exponent, 1, max_shift);
  const double limit = std::ldexp(1.0, bits) - 1;
  for (const double factor : factors) {
    const double scaled = std::round(std::ldexp(factor, fixed.shift));
    if (scaled > limit + 1) throw std::runtime_error("a scale is too large for fixed point");
    fixed.multipliers.push_back(static_cast<std::uint32_t>(std::min(scaled, limit)));
  }
  return fixed;
}

class ByteWriter {
 public:
  void u8(int v) { out.push_back(static_cast<std::uint8_t>(v)); }
  void u16(std::uint32_t v) {
    u8(static_cast<int>(v & 0xff));
    u8(static_cast<int>(v >> 8 & 0xff));
  }
  void u32(std::uint32_t v) {
    u16(v & 0xffff);
    u16(v >> 16);
  }
  void f32(double v) { u32(std::bit_cast<std::uint32_t>(static_cast<float>(v))); }
  void zeros(std::size_t count) { out.insert(out.end(), count, std::uint8_t{0}); }
  void align() { zeros((64 - out.size() % 64) % 64); }

  std::vector<std::uint8_t> out;
};

void patch_u32(std::vector<std::uint8_t>& bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
}

// A layer's row of the table and its blob.
struct EncodedLayer {
  std::vector<std::uint8_t> row;
  std::vector<std::uint8_t> blob;
};

// The weights from all inputs to one output channel.
std::span<const float> weights_of(const FloatLayer& layer, std::size_t output) {
  const std::size_t size = layer.weights.size() / static_cast<std::size_t>(layer.outputs);
  return std::span(layer.weights).subspan(output * size, size);
}

// What one step of the int8 weights of an output channel means.
double weight_scale(std::span<const float> weights) {
  double largest = 0;
  for (const float w : weights) largest = std::max<double>(largest, std::abs(w));
  return std::max(largest / 127, 1e-12);
}

// The same where a channel has tiny weights and a large bias, which stays within 2^29 steps.
double weight_scale(const FloatLayer& layer, std::size_t output, double input_scale) {
  return std::max(weight_scale(weights_of(layer, output)),
                  std::abs(layer.bias[output]) / (input_scale * 0x1p29));
}

class ModelWriter {
 public:
  ModelWriter(const FloatNetwork& network, Statistics statistics)
      : network_(network),
        shapes_(network.shapes()),
        scales_(std::move(statistics.scales)),
        means_(std::move(statistics.means)),
        plan_(plan_activations(network)) {}

  std::vector<std::uint8_t> write() {
    const std::size_t count = network_.layers.size();
    std::vector<EncodedLayer> layers;
    std::size_t blob_at =
        format::kHeaderBytes + count * (format::kTensorBytes + format::kLayerBytes);
    blob_at = (blob_at + 63) / 64 * 64;
    for (std::size_t i = 0; i < count; ++i) {
      layers.push_back(encode_layer(i, static_cast<std::uint32_t>(blob_at)));
      blob_at += (layers.back().blob.size() + 63) / 64 * 64;
    }
    ByteWriter w;
    write_header(w);
    for (std::size_t t = 0; t < count; ++t) write_tensor(w, t);
    for (const EncodedLayer& layer : layers)
      w.out.insert(w.out.end(), layer.row.begin(), layer.row.end());
    w.align();
    for (const EncodedLayer& layer : layers) {
      w.out.insert(w.out.end(), layer.blob.begin(), layer.blob.end());
      w.align();
    }
    patch_u32(w.out, 8, static_cast<std::uint32_t>(w.out.size()));
    patch_u32(w.out, 12, crc32(std::span(w.out).subspan(format::kCrcFrom)));
    return std::move(w.out);
  }

 private:
  void write_header(ByteWriter& w) const {
    w.u32(format::kMagic);
    w.u16(format::kVersion);
    w.u16(format::kHeaderBytes);
    w.zeros(8);  // size and checksum, filled in at the end
    w.u8(static_cast<int>(network_.layers.size()));
    w.u8(static_cast<int>(network_.layers.size()));
    w.u8(static_cast<int>(network_.state_kind));
    w.u8(static_cast<int>(network_.value_kind));
    w.u8(static_cast<int>(network_.inputs.size()));
    w.u8(kPolicyCells);
    w.u16(0);
    w.u32(plan_.bytes);
    w.f32(head_scale_);
    w.u32(network_.policy_cell_um);
    w.u32(0);
    std::string name = network_.name;
    name.resize(kMaxNameBytes, '\0');
    w.out.insert(w.out.end(), name.begin(), name.end());
    for (const InputChannel& input : network_.inputs) write_input(w, input);
    w.zeros(format::kHeaderBytes - w.out.size());
  }

  static void write_input(ByteWriter& w, const InputChannel& input) {
    const FixedPoint fixed =
        to_fixed_point({std::abs(input.scale) * double{kMaxActivation}}, 14, 30);
    const auto multiplier = static_cast<std::int32_t>(fixed.multipliers[0]);
    w.u32(static_cast<std::uint32_t>(std::lround(input.offset)));
    w.u32(static_cast<std::uint32_t>(input.scale < 0 ? -multiplier : multiplier));
    w.u8(fixed.shift);
    w.zeros(3);
  }

  void write_tensor(ByteWriter& w, std::size_t t) const {
    w.u8(shapes_[t].height);
    w.u8(shapes_[t].width);
    w.u8(shapes_[t].channels);
    w.u8(0);
    w.u32(plan_.offsets[t]);
    w.f32(scales_[t]);
  }

  EncodedLayer encode_layer(std::size_t index, std::uint32_t blob_at) {
    const FloatLayer& layer = network_.layers[index];
    const bool is_head = index + 1 == network_.layers.size();
    const bool is_add = layer.kind == LayerKind::kAdd;
    const bool is_convolution = layer.kind != LayerKind::kUpsample2x && !is_add;
    EncodedLayer encoded;
    FixedPoint fixed{0, {0, 0}};
    if (is_convolution) fixed.shift = encode_weights(index, is_head, encoded.blob);
    if (is_add) {
      const double out = scales_[index + 1];
      fixed = to_fixed_point({scales_[static_cast<std::size_t>(layer.input_a)] / out,
                              scales_[static_cast<std::size_t>(layer.input_b)] / out},
                             15, 30);
    }
    ByteWriter w;
    w.u8(static_cast<int>(layer.kind));
    w.u8(layer.stride);
    w.u8((layer.relu ? format::kFlagRelu : 0) | (is_head ? format::kFlagRaw : 0));
    w.u8(fixed.shift);
    w.u8(layer.input_a);
    w.u8(is_add ? layer.input_b : format::kNoTensor);
    w.u8(layer.outputs);
    w.u8(0);
    w.u32(is_convolution ? blob_at : 0);
    w.u32(static_cast<std::uint32_t>(encoded.blob.size()));
    w.u32(is_add ? fixed.multipliers[0] : 0);
    w.u32(is_add ? fixed.multipliers[1] : 0);
    encoded.row = std::move(w.out);
    return encoded;
  }

  // Biases, multipliers and weights of a convolution; answers the shift.
  int encode_weights(std::size_t index, bool is_head, std::vector<std::uint8_t>& blob) {
    const FloatLayer& layer = network_.layers[index];
    const auto outputs = static_cast<std::size_t>(layer.outputs);
    const double in_scale = scales_[static_cast<std::size_t>(layer.input_a)];
    const int inputs = shapes_[static_cast<std::size_t>(layer.input_a)].channels;
    const std::vector<double>& input_means = means_[static_cast<std::size_t>(layer.input_a)];
    const int taps = layer.kind == LayerKind::kConv3x3 ? 9 : 1;
    const int stored_inputs = (inputs + 3) / 4 * 4;
    const std::size_t stored_outputs = (outputs + 15) / 16 * 16;
    std::vector<double> factors;
    std::vector<std::uint8_t> weights(stored_outputs *
                                      static_cast<std::size_t>(taps * stored_inputs));
    ByteWriter w;
    for (std::size_t o = 0; o < outputs; ++o) {
      const double scale = weight_scale(layer, o, in_scale);
      factors.push_back(in_scale * scale / scales_[index + 1]);
      double bias = layer.bias[o];
      for (int c = 0; c < inputs; ++c)
        for (int t = 0; t < taps; ++t) {
          const double weight =
              layer.weights[(o * static_cast<std::size_t>(inputs) + c) * taps + t];
          const long rounded = std::lround(weight / scale);
          weights[format::weight_index(static_cast<int>(o), t, c, taps, stored_inputs)] =
              static_cast<std::uint8_t>(rounded);
          // What rounding the weights adds on average goes into the bias (Nagel et al. 2019).
          bias += (weight - static_cast<double>(rounded) * scale) * input_means[c];
        }
      w.u32(static_cast<std::uint32_t>(
          static_cast<std::int32_t>(std::lround(bias / (in_scale * scale)))));
      if (is_head) head_scale_ = in_scale * scale;
    }
    w.zeros(4 * (stored_outputs - outputs));
    FixedPoint fixed{0, std::vector<std::uint32_t>(outputs, 0)};
    if (!is_head) fixed = to_fixed_point(factors, 31, 62);
    for (const std::uint32_t multiplier : fixed.multipliers) w.u32(multiplier);
    w.zeros(4 * (stored_outputs - outputs));
    w.out.insert(w.out.end(), weights.begin(), weights.end());
    blob = std::move(w.out);
    return fixed.shift;
  }

  const FloatNetwork& network_;
  std::vector<Shape> shapes_;
  std::vector<double> scales_;
  std::vector<std::vector<double>> means_;
  ActivationPlan plan_;
  double head_scale_ = 1;
};

}  // namespace

void round_weights(FloatNetwork& network) {
  for (FloatLayer& layer : network.layers)
    for (std::size_t o = 0; o < static_cast<std::size_t>(layer.outputs); ++o) {
      const std::span<const float> weights = weights_of(layer, o);
      const double scale = weight_scale(weights);
      const std::size_t first = o * weights.size();
      for (std::size_t i = first; i < first + weights.size(); ++i)
        layer.weights[i] = static_cast<float>(std::round(layer.weights[i] / scale) * scale);
    }
}

std::vector<std::uint8_t> quantize(const FloatNetwork& network,
                                   std::span<const std::uint16_t> states) {
  if (network.layers.size() > kMaxLayers)
    throw std::runtime_error("more than " + std::to_string(kMaxLayers) + " layers");
  if (network.name.size() >= kMaxNameBytes)
    throw std::invalid_argument("the name is longer than " + std::to_string(kMaxNameBytes - 1));
  std::vector<std::uint8_t> file = ModelWriter(network, find_statistics(network, states)).write();
  ModelView model;
  if (const ModelStatus status = load_model(file, model); !ok(status.status))
    throw std::runtime_error(std::string("the firmware would refuse the model: ") + status.reason);
  return file;
}

}  // namespace ivfm::host
