// ONNX is a protocol buffer: nested records of numbered fields (onnx.proto3, IR version 5). The few
// that a network needs are written here by hand, which saves the libraries of both.
#include "host/quantizer/onnx_file.h"

#include <bit>
#include <cstdint>
#include <fstream>
#include <span>
#include <stdexcept>
#include <vector>

#include "firmware/nn/state_encoder.h"

namespace ivfm::host {
namespace {

// Appends the fields of one record (protobuf's wire format).
class Record {
 public:
  Record& number(int field, std::uint64_t value) {
    varint(static_cast<std::uint64_t>(field) << 3);
    varint(value);
    return *this;
  }
  Record& real(int field, float value) {
    varint((static_cast<std::uint64_t>(field) << 3) | 5);
    fixed32(std::bit_cast<std::uint32_t>(value));
    return *this;
  }
  Record& bytes(int field, const std::string& value) {
    varint((static_cast<std::uint64_t>(field) << 3) | 2);
    varint(value.size());
    bytes_ += value;
    return *this;
  }
  Record& record(int field, const Record& value) { return bytes(field, value.bytes_); }
  const std::string& str() const { return bytes_; }

  void fixed32(std::uint32_t value) {
    for (int i = 0; i < 4; ++i) bytes_ += static_cast<char>(value >> (8 * i));
  }

 private:
  void varint(std::uint64_t value) {
    for (; value >= 0x80; value >>= 7) bytes_ += static_cast<char>(value | 0x80);
    bytes_ += static_cast<char>(value);
  }

  std::string bytes_;
};

constexpr std::uint64_t kFloat = 1;  // TensorProto.DataType

using Dimensions = std::vector<std::int64_t>;

// TensorProto: dims = 1, data_type = 2, name = 8, raw_data = 9.
Record tensor(const std::string& name, const Dimensions& dimensions,
              std::span<const float> values) {
  Record raw, out;
  for (const float v : values) raw.fixed32(std::bit_cast<std::uint32_t>(v));
  for (const std::int64_t d : dimensions) out.number(1, static_cast<std::uint64_t>(d));
  return out.number(2, kFloat).bytes(8, name).bytes(9, raw.str());
}

// ValueInfoProto: name = 1, type = 2 { tensor_type = 1 { elem_type = 1, shape = 2 { dim = 1 { value
// = 1 } } } }.
Record value_info(const std::string& name, const Dimensions& dimensions) {
  Record shape, type, any;
  for (const std::int64_t d : dimensions) {
    shape.record(1, Record().number(1, static_cast<std::uint64_t>(d)));
  }
  type.number(1, kFloat).record(2, shape);
  return Record().bytes(1, name).record(2, any.record(1, type));
}

// AttributeProto: name = 1, f = 2, s = 4, ints = 8, type = 20 (FLOAT 1, STRING 3, INTS 7).
Record attribute(const std::string& name, float value) {
  return Record().bytes(1, name).real(2, value).number(20, 1);
}
Record attribute(const std::string& name, const std::string& value) {
  return Record().bytes(1, name).bytes(4, value).number(20, 3);
}
Record attribute(const std::string& name, const Dimensions& values) {
  Record out;
  out.bytes(1, name);
  for (const std::int64_t v : values) out.number(8, static_cast<std::uint64_t>(v));
  return out.number(20, 7);
}

// Collects the nodes and constants of a GraphProto: node = 1, name = 2, initializer = 5, input =
// 11, output = 12.
class GraphWriter {
 public:
  // NodeProto: input = 1, output = 2, name = 3, op_type = 4, attribute = 5. Answers `output`.
  std::string node(const std::string& type, const std::vector<std::string>& inputs,
                   const std::string& output, const std::vector<Record>& attributes = {}) {
    Record out;
    for (const std::string& input : inputs) out.bytes(1, input);
    out.bytes(2, output).bytes(3, type + " " + output).bytes(4, type);
    for (const Record& a : attributes) out.record(5, a);
    graph_.record(1, out);
    return output;
  }
  std::string constant(const std::string& name, const Dimensions& dimensions,
                       std::span<const float> values) {
    graph_.record(5, tensor(name, dimensions, values));
    return name;
  }
  Record finish(const std::string& name, const Record& input, const Record& output) {
    return graph_.bytes(2, name).record(11, input).record(12, output);
  }

 private:
  Record graph_;
};

// x = clamp((v - offset) * scale, 0, 1), channel by channel.
std::string normalized(GraphWriter& graph, const FloatNetwork& network) {
  std::vector<float> offsets, scales;
  for (const InputChannel& channel : network.inputs) {
    offsets.push_back(channel.offset);
    scales.push_back(channel.scale);
  }
  const Dimensions shape = {1, static_cast<std::int64_t>(offsets.size()), 1, 1};
  const std::string moved =
      graph.node("Sub", {"state", graph.constant("offset", shape, offsets)}, "moved");
  const std::string scaled =
      graph.node("Mul", {moved, graph.constant("scale", shape, scales)}, "scaled");
  return graph.node("Clip", {scaled}, "normalized",
                    {attribute("min", 0.0f), attribute("max", 1.0f)});
}

std::string convolution(GraphWriter& graph, const FloatLayer& layer, const std::string& input,
                        const std::string& output) {
  const std::int64_t side = layer.kind == LayerKind::kConv3x3 ? 3 : 1, pad = side / 2;
  const auto inputs =
      static_cast<std::int64_t>(layer.weights.size()) / (layer.outputs * side * side);
  const std::string weights =
      graph.constant(output + ".weight", {layer.outputs, inputs, side, side}, layer.weights);
  const std::string bias = graph.constant(output + ".bias", {layer.outputs}, layer.bias);
  return graph.node("Conv", {input, weights, bias}, output,
                    {attribute("kernel_shape", Dimensions{side, side}),
                     attribute("strides", Dimensions{layer.stride, layer.stride}),
                     attribute("pads", Dimensions{pad, pad, pad, pad})});
}

// The layer's output before its ReLU.
std::string layer_node(GraphWriter& graph, const FloatLayer& layer,
                       const std::vector<std::string>& tensors, const std::string& output) {
  const std::string& a = tensors[static_cast<std::size_t>(layer.input_a)];
  switch (layer.kind) {
    case LayerKind::kConv3x3:
    case LayerKind::kConv1x1: return convolution(graph, layer, a, output);
    case LayerKind::kUpsample2x: {
      const float scales[] = {1, 1, 2, 2};
      return graph.node("Resize", {a, graph.constant(output + ".scales", {4}, scales)}, output,
                        {attribute("mode", std::string("nearest"))});
    }
    case LayerKind::kAdd:
      return graph.node("Add", {a, tensors[static_cast<std::size_t>(layer.input_b)]}, output);
  }
  return {};
}

}  // namespace

std::string to_onnx(const FloatNetwork& network) {
  network.shapes();  // checks
  constexpr std::int64_t kSide = kPolicyCells;
  GraphWriter graph;
  std::vector<std::string> tensors = {normalized(graph, network)};
  for (std::size_t i = 0; i < network.layers.size(); ++i) {
    const FloatLayer& layer = network.layers[i];
    const bool is_head = i + 1 == network.layers.size();
    const std::string name = is_head ? "q" : "layer" + std::to_string(i);
    const std::string raw = layer_node(graph, layer, tensors, layer.relu ? name + ".raw" : name);
    tensors.push_back(layer.relu ? graph.node("Relu", {raw}, name) : raw);
  }
  const auto channels = static_cast<std::int64_t>(network.inputs.size());
  const Record body = graph.finish(network.name, value_info("state", {1, channels, kSide, kSide}),
                                   value_info("q", {1, 1, kSide, kSide}));
  // ModelProto: ir_version = 1, producer_name = 2, graph = 7, opset_import = 8 { version = 2 }.
  return Record()
      .number(1, 5)
      .bytes(2, "ivfm")
      .record(7, body)
      .record(8, Record().number(2, 10))
      .str();
}

void save_onnx(const FloatNetwork& network, const std::filesystem::path& path) {
  std::ofstream out(path, std::ios::binary);
  if (!(out << to_onnx(network)).flush()) throw std::runtime_error("cannot write " + path.string());
}

}  // namespace ivfm::host
