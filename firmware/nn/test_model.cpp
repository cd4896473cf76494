#include "firmware/nn/test_model.h"

#include "shared/wire/crc.h"

namespace ivfm {
namespace {

class Writer {
 public:
  void u8(unsigned v) { out.push_back(static_cast<std::uint8_t>(v & 0xffu)); }
  void u16(unsigned v) {
    u8(v);
    u8(v >> 8);
  }
  void u32(std::uint32_t v) {
    u16(v & 0xffffu);
    u16(v >> 16);
  }
  void i32(std::int32_t v) { u32(static_cast<std::uint32_t>(v)); }
  void pad_to(std::size_t size) { out.resize(size, 0); }
  void align() { pad_to((out.size() + 63) / 64 * 64); }

  std::vector<std::uint8_t> out;
};

std::size_t blob_bytes(const TestModel::Layer& layer) {
  return 4 * (layer.bias.size() + layer.multipliers.size()) + layer.weights.size();
}

}  // namespace

std::vector<std::uint8_t> TestModel::bytes() const {
  Writer w;
  w.u32(model_format::kMagic);
  w.u16(model_format::kVersion);
  w.u16(model_format::kHeaderBytes);
  w.pad_to(16);
  w.u8(static_cast<unsigned>(layers.size()));
  w.u8(static_cast<unsigned>(tensors.size()));
  w.u8(state_kind);
  w.u8(value_kind);
  w.u8(input_channels);
  w.u8(grid);
  w.u16(0);
  w.u32(tensor_bytes);
  w.u32(output_scale_bits);
  w.u32(policy_cell_um);
  w.u32(0);
  for (const char c : name) w.u8(static_cast<unsigned char>(c));
  w.pad_to(64);
  for (const Input& input : inputs) {
    w.i32(input.offset);
    w.i32(input.multiplier);
    w.u32(input.shift);
  }
  w.pad_to(model_format::kHeaderBytes);
  for (const Tensor& t : tensors) {
    for (const std::uint8_t v : {t.height, t.width, t.channels, t.reserved}) w.u8(v);
    w.u32(t.offset);
    w.u32(t.scale_bits);
  }
  std::size_t blob = (w.out.size() + layers.size() * model_format::kLayerBytes + 63) / 64 * 64;
  for (const Layer& l : layers) {
    for (const std::uint8_t v :
         {l.kind, l.stride, l.flags, l.shift, l.input_a, l.input_b, l.outputs, l.reserved})
      w.u8(v);
    w.u32(l.bias.empty() ? 0 : static_cast<std::uint32_t>(blob));
    w.u32(static_cast<std::uint32_t>(blob_bytes(l)));
    w.u32(l.multiplier_a);
    w.u32(l.multiplier_b);
    blob = (blob + blob_bytes(l) + 63) / 64 * 64;
  }
  w.align();
  for (const Layer& l : layers) {
    for (const std::int32_t v : l.bias) w.i32(v);
    for (const std::int32_t v : l.multipliers) w.i32(v);
    for (const std::int8_t v : l.weights) w.u8(static_cast<std::uint8_t>(v));
    w.align();
  }
  const auto size = static_cast<std::uint32_t>(w.out.size());
  for (std::size_t i = 0; i < 4; ++i) w.out[8 + i] = static_cast<std::uint8_t>(size >> (8 * i));
  fix_checksum(w.out);
  return w.out;
}

void TestModel::fix_checksum(std::vector<std::uint8_t>& file) {
  const std::uint32_t crc = crc32(std::span(file).subspan(model_format::kCrcFrom));
  for (std::size_t i = 0; i < 4; ++i) file[12 + i] = static_cast<std::uint8_t>(crc >> (8 * i));
}

}  // namespace ivfm
