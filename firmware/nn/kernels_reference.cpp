#include <algorithm>

#include "firmware/nn/kernels_tiled.h"
#include "firmware/nn/little_endian.h"

namespace ivfm {
namespace {

using model_format::weight_index;

// The accumulator of one output at one pixel: bias + sum of weight * input over the patch.
std::int32_t accumulate(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
                        int y, int x, int output) {
  const int side = layer.side();
  const int channels = in_shape.stored_channels();
  std::int32_t sum = read_i32(layer.bias + 4 * output);
  for (int tap = 0; tap < side * side; ++tap) {
    const int in_y = y * layer.stride + tap / side - side / 2;
    const int in_x = x * layer.stride + tap % side - side / 2;
    if (in_y < 0 || in_y >= in_shape.height || in_x < 0 || in_x >= in_shape.width) continue;
    const std::int16_t* pixel = in + (in_y * in_shape.width + in_x) * channels;
    for (int c = 0; c < channels; ++c)
      sum += layer.weights[weight_index(output, tap, c, side * side, channels)] * pixel[c];
  }
  return sum;
}

void convolve(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
              std::int16_t* out, std::int16_t* /*scratch*/) {
  const int height = (in_shape.height + layer.stride - 1) / layer.stride;
  const int width = (in_shape.width + layer.stride - 1) / layer.stride;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int o = 0; o < layer.outputs; ++o)
        *out++ =
            requantize(accumulate(layer, in_shape, in, y, x, o),
                       read_i32(layer.multipliers + 4 * o), layer.shift, lowest_activation(layer));
}

void head(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
          std::int32_t* out) {
  for (int y = 0; y < in_shape.height; ++y)
    for (int x = 0; x < in_shape.width; ++x) *out++ = accumulate(layer, in_shape, in, y, x, 0);
}

}  // namespace

void upsample_nearest(const TensorView& in_shape, const std::int16_t* in, std::int16_t* out) {
  const auto channels = static_cast<std::size_t>(in_shape.stored_channels());
  const std::size_t row = 2 * channels * in_shape.width;
  for (int y = 0; y < in_shape.height; ++y, out += 2 * row) {
    std::int16_t* pixel = out;
    for (int x = 0; x < in_shape.width; ++x, in += channels)
      for (int copy = 0; copy < 2; ++copy, pixel += channels) std::copy_n(in, channels, pixel);
    std::copy_n(out, row, out + row);
  }
}

void add_scaled(const LayerView& layer, std::size_t size, const std::int16_t* a,
                const std::int16_t* b, std::int16_t* out) {
  const auto multiplier_a = static_cast<std::int32_t>(layer.multiplier_a);
  const auto multiplier_b = static_cast<std::int32_t>(layer.multiplier_b);
  const std::int32_t half = 1 << (layer.shift - 1), lowest = lowest_activation(layer);
  for (std::size_t i = 0; i < size; ++i) {
    const std::int32_t sum = (a[i] * multiplier_a + b[i] * multiplier_b + half) >> layer.shift;
    out[i] = static_cast<std::int16_t>(std::clamp<std::int32_t>(sum, lowest, kMaxActivation));
  }
}

const KernelSet& reference_kernels() {
  static constexpr KernelSet kSet{"reference", convolve, head, upsample_nearest, add_scaled};
  return kSet;
}

}  // namespace ivfm
