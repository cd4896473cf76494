// The `.fnet` file. Little endian; no padding:
//   "IVFMFNET", u32 version = 1, u8 state kind, u8 value kind, u16 layers, u32 policy_cell_um,
//   u16 name length and the name, u16 input channels and for each f32 offset, f32 scale,
//   and for each layer: u8 kind, u8 stride, u8 relu, u8 0, i32 input_a, i32 input_b, i32 outputs,
//   u32 count and f32 weights, u32 count and f32 biases.
#include <bit>
#include <cstring>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "host/quantizer/float_network.h"

namespace ivfm::host {
namespace {

constexpr char kMagic[] = "IVFMFNET";
constexpr std::uint32_t kVersion = 1;

class Writer {
 public:
  void bytes(const void* data, std::size_t size) {
    const auto* p = static_cast<const std::uint8_t*>(data);
    out.insert(out.end(), p, p + size);
  }
  void number(std::uint32_t value, int size) {
    for (int i = 0; i < size; ++i) out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
  }
  void real(float value) { number(std::bit_cast<std::uint32_t>(value), 4); }
  void reals(const std::vector<float>& values) {
    number(static_cast<std::uint32_t>(values.size()), 4);
    for (const float v : values) real(v);
  }

  std::vector<std::uint8_t> out;
};

class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : left_(bytes) {}

  std::span<const std::uint8_t> bytes(std::size_t size) {
    if (size > left_.size()) throw std::invalid_argument("the file ends too early");
    const auto taken = left_.first(size);
    left_ = left_.subspan(size);
    return taken;
  }
  std::uint32_t number(std::size_t size) {
    std::uint32_t value = 0;
    const auto taken = bytes(size);
    for (std::size_t i = 0; i < size; ++i) value |= std::uint32_t{taken[i]} << (8 * i);
    return value;
  }
  float real() {
    const float value = std::bit_cast<float>(number(4));
    if (!(value > -1e30f && value < 1e30f)) throw std::invalid_argument("a number is not finite");
    return value;
  }
  std::vector<float> reals() {
    const std::size_t count = number(4);
    if (count > left_.size() / 4) throw std::invalid_argument("the file ends too early");
    std::vector<float> values(count);
    for (float& v : values) v = real();
    return values;
  }
  bool at_end() const { return left_.empty(); }

 private:
  std::span<const std::uint8_t> left_;
};

FloatLayer read_layer(Reader& in) {
  FloatLayer layer;
  const std::uint32_t kind = in.number(1);
  if (kind > static_cast<std::uint32_t>(LayerKind::kAdd))
    throw std::invalid_argument("unknown layer kind " + std::to_string(kind));
  layer.kind = static_cast<LayerKind>(kind);
  layer.stride = static_cast<int>(in.number(1));
  layer.relu = in.number(2) != 0;
  layer.input_a = static_cast<int>(in.number(4));
  layer.input_b = static_cast<int>(in.number(4));
  layer.outputs = static_cast<int>(in.number(4));
  layer.weights = in.reals();
  layer.bias = in.reals();
  return layer;
}

}  // namespace

std::vector<std::uint8_t> encode_network(const FloatNetwork& network) {
  Writer w;
  w.bytes(kMagic, 8);
  w.number(kVersion, 4);
  w.number(static_cast<std::uint32_t>(network.state_kind), 1);
  w.number(static_cast<std::uint32_t>(network.value_kind), 1);
  w.number(static_cast<std::uint32_t>(network.layers.size()), 2);
  w.number(network.policy_cell_um, 4);
  w.number(static_cast<std::uint32_t>(network.name.size()), 2);
  w.bytes(network.name.data(), network.name.size());
  w.number(static_cast<std::uint32_t>(network.inputs.size()), 2);
  for (const InputChannel& input : network.inputs) {
    w.real(input.offset);
    w.real(input.scale);
  }
  for (const FloatLayer& layer : network.layers) {
    w.number(static_cast<std::uint32_t>(layer.kind), 1);
    w.number(static_cast<std::uint32_t>(layer.stride), 1);
    w.number(layer.relu ? 1 : 0, 2);
    w.number(static_cast<std::uint32_t>(layer.input_a), 4);
    w.number(static_cast<std::uint32_t>(layer.input_b), 4);
    w.number(static_cast<std::uint32_t>(layer.outputs), 4);
    w.reals(layer.weights);
    w.reals(layer.bias);
  }
  return std::move(w.out);
}

FloatNetwork decode_network(std::span<const std::uint8_t> bytes) {
  Reader in(bytes);
  if (std::memcmp(in.bytes(8).data(), kMagic, 8) != 0)
    throw std::invalid_argument("not a float network (.fnet)");
  if (const std::uint32_t version = in.number(4); version != kVersion)
    throw std::invalid_argument("version " + std::to_string(version) + ", this build reads " +
                                std::to_string(kVersion));
  FloatNetwork network;
  const std::uint32_t state_kind = in.number(1), value_kind = in.number(1);
  if (state_kind > static_cast<std::uint32_t>(StateKind::kFoldedIvfm) ||
      value_kind > static_cast<std::uint32_t>(ValueKind::kScore))
    throw std::invalid_argument("unknown state or value kind");
  network.state_kind = static_cast<StateKind>(state_kind);
  network.value_kind = static_cast<ValueKind>(value_kind);
  const std::uint32_t layers = in.number(2);
  network.policy_cell_um = in.number(4);
  const auto name = in.bytes(in.number(2));
  network.name.assign(name.begin(), name.end());
  const std::uint32_t inputs = in.number(2);
  for (std::uint32_t i = 0; i < inputs; ++i) {
    const float offset = in.real(), scale = in.real();
    network.inputs.push_back({offset, scale});
  }
  for (std::uint32_t i = 0; i < layers; ++i) network.layers.push_back(read_layer(in));
  if (!in.at_end()) throw std::invalid_argument("bytes after the last layer");
  network.shapes();
  return network;
}

void save_network(const FloatNetwork& network, const std::filesystem::path& path) {
  const std::vector<std::uint8_t> bytes = encode_network(network);
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
  out.flush();
  if (!out) throw std::runtime_error("cannot write " + path.string());
}

FloatNetwork load_network(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error("cannot open " + path.string());
  const std::vector<char> text((std::istreambuf_iterator<char>(in)),
                               std::istreambuf_iterator<char>());
  try {
    return decode_network({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(path.string() + ": " + error.what());
  }
}

}  // namespace ivfm::host
