#include "firmware/nn/kernels_tiled.h"

#include <cstring>

#include "firmware/nn/little_endian.h"

namespace ivfm {
namespace {

// Copies `in` with a border of zeros, one pixel wide.
void pad(const TensorView& shape, const std::int8_t* in, std::int8_t* padded) {
  const auto channels = static_cast<std::size_t>(shape.stored_channels());
  const std::size_t row = shape.width * channels, padded_row = row + 2 * channels;
  std::memset(padded, 0, padded_row);
  for (int y = 0; y < shape.height; ++y) {
    padded += padded_row;
    std::memset(padded, 0, channels);
    std::memcpy(padded + channels, in, row);
    std::memset(padded + channels + row, 0, channels);
    in += row;
  }
  std::memset(padded + padded_row, 0, padded_row);
}

}  // namespace

void convolve_tiled(const TileKernel* kernels, const LayerView& layer, const TensorView& in_shape,
                    const std::int8_t* in, std::int8_t* out, std::int8_t* scratch) {
  const bool is_3x3 = layer.kind == LayerKind::kConv3x3;
  if (is_3x3) pad(in_shape, in, scratch);
  const auto* input = reinterpret_cast<const std::uint8_t*>(is_3x3 ? scratch : in);
  const int channels = in_shape.stored_channels();
  const int input_width = in_shape.width + (is_3x3 ? 2 : 0);
  const int height = (in_shape.height + layer.stride - 1) / layer.stride;
  const int width = (in_shape.width + layer.stride - 1) / layer.stride;
  const int groups = layer.stored_outputs / model_format::kOutputGroup;
  while (width % kernels->pixels != 0 || groups % kernels->groups != 0) ++kernels;

  Tile tile{};
  tile.pixel_bytes = std::ptrdiff_t{layer.stride} * channels;
  tile.row_bytes = std::ptrdiff_t{input_width} * channels;
  tile.rows = is_3x3 ? 3 : 1;
  tile.quads = tile.rows * channels / 4;
  tile.group_bytes = std::ptrdiff_t{64} * tile.rows * tile.quads;
  tile.shift = layer.shift;
  tile.lowest = layer.relu ? 0 : -127;
  tile.output_bytes = layer.outputs;
  for (int group = 0; group < groups; group += kernels->groups) {
    tile.weights = layer.weights + group * tile.group_bytes;
    tile.bias = layer.bias + std::ptrdiff_t{64} * group;
    tile.multipliers = layer.multipliers + std::ptrdiff_t{64} * group;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; x += kernels->pixels) {
        tile.input = input + y * layer.stride * tile.row_bytes + x * tile.pixel_bytes;
        tile.output = out + (y * width + x) * tile.output_bytes + group * 16;
        kernels->run(tile);
      }
  }
}

void head_fast(const LayerView& layer, const TensorView& in_shape, const std::int8_t* in,
               std::int32_t* out) {
  std::array<std::int16_t, kMaxChannels> weights{};
  const int channels = in_shape.stored_channels();
  for (int c = 0; c < channels; ++c)
    weights[static_cast<std::size_t>(c)] =
        layer.weights[model_format::weight_index(0, 0, c, 1, channels)];
  const std::int32_t bias = read_i32(layer.bias);
  for (int i = 0; i < in_shape.height * in_shape.width; ++i, in += channels) {
    std::int32_t sum = bias;
    for (int c = 0; c < channels; ++c) sum += weights[static_cast<std::size_t>(c)] * in[c];
    out[i] = sum;
  }
}

}  // namespace ivfm
