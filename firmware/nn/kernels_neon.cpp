#include <arm_neon.h>

#include <cstring>

#include "firmware/nn/kernels_tiled.h"

// Products of two quads meet in an int16 (2 * 127 * 127 fits), then in pairs in an int32. Until the
// end of a tile each output has two half sums.
namespace ivfm {
namespace {

int8x16_t broadcast_quad(const std::uint8_t* p) {
  std::int32_t quad;
  std::memcpy(&quad, p, sizeof quad);
  return vreinterpretq_s8_s32(vdupq_n_s32(quad));
}

// Adds one quad or two to the half sums of 16 outputs.
template <bool kTwoQuads>
void add_products(const std::uint8_t* input, const std::int8_t* weights, int32x4_t sums[8]) {
  const int8x16_t x0 = broadcast_quad(input);
  const int8x16_t x1 = kTwoQuads ? broadcast_quad(input + 4) : x0;
#pragma GCC unroll 4
  for (int v = 0; v < 4; ++v) {
    const int8x16_t w0 = vld1q_s8(weights + 16 * v);
    int16x8_t low = vmull_s8(vget_low_s8(x0), vget_low_s8(w0));
    int16x8_t high = vmull_high_s8(x0, w0);
    if (kTwoQuads) {
      const int8x16_t w1 = vld1q_s8(weights + 64 + 16 * v);
      low = vmlal_s8(low, vget_low_s8(x1), vget_low_s8(w1));
      high = vmlal_high_s8(high, x1, w1);
    }
    sums[2 * v] = vpadalq_s16(sums[2 * v], low);
    sums[2 * v + 1] = vpadalq_s16(sums[2 * v + 1], high);
  }
}

// Requantizes 4 outputs; vrshl with a negative count rounds halves up.
int32x4_t requantize_4(int32x4_t sums, int32x4_t multipliers, int64x2_t left_shift) {
  const int64x2_t low = vmull_s32(vget_low_s32(sums), vget_low_s32(multipliers));
  const int64x2_t high = vmull_high_s32(sums, multipliers);
  return vcombine_s32(vqmovn_s64(vrshlq_s64(low, left_shift)),
                      vqmovn_s64(vrshlq_s64(high, left_shift)));
}

void store_16(const int32x4_t half_sums[8], const Tile& tile, std::int16_t* output) {
  const int64x2_t left_shift = vdupq_n_s64(-tile.shift);
  const int32x4_t lowest = vdupq_n_s32(tile.lowest), highest = vdupq_n_s32(kMaxActivation);
#pragma GCC unroll 4
  for (int v = 0; v < 4; ++v) {
    const int32x4_t bias = vreinterpretq_s32_u8(vld1q_u8(tile.bias + 16 * v));
    const int32x4_t sums = vaddq_s32(vpaddq_s32(half_sums[2 * v], half_sums[2 * v + 1]), bias);
    const int32x4_t q =
        requantize_4(sums, vreinterpretq_s32_u8(vld1q_u8(tile.multipliers + 16 * v)), left_shift);
    vst1_s16(output + 4 * v, vmovn_s32(vminq_s32(vmaxq_s32(q, lowest), highest)));
  }
}

void store_two_planes(const std::int16_t* values, std::size_t count, std::uint8_t* out,
                      std::ptrdiff_t plane_bytes) {
  std::size_t i = 0;
  for (; i + 8 <= count; i += 8) {
    const uint16x8_t v = vreinterpretq_u16_s16(vld1q_s16(values + i));
    vst1_u8(out + i, vshrn_n_u16(v, 7));
    vst1_u8(out + plane_bytes + i, vmovn_u16(vandq_u16(v, vdupq_n_u16(127))));
  }
  for (; i < count; ++i) {
    out[i] = static_cast<std::uint8_t>(values[i] >> 7);
    out[plane_bytes + static_cast<std::ptrdiff_t>(i)] = static_cast<std::uint8_t>(values[i] & 127);
  }
}

template <int kPixels>
void run_tile(const Tile& tile) {
  int32x4_t sums[kPixels][8] = {};
  for (int plane = 0; plane < 2; ++plane) {
    const std::int8_t* weights = tile.weights;
    for (int p = 0; p < kPixels; ++p)
      for (int32x4_t& sum : sums[p]) sum = vshlq_n_s32(sum, 7);
    for (int row = 0; row < tile.rows; ++row) {
      const std::uint8_t* input = tile.input + plane * tile.plane_bytes + row * tile.row_bytes;
      int quad = 0;
      for (; quad + 2 <= tile.quads; quad += 2, input += 8, weights += 128)
#pragma GCC unroll 2
        for (int p = 0; p < kPixels; ++p)
          add_products<true>(input + p * tile.pixel_bytes, weights, sums[p]);
      for (; quad < tile.quads; ++quad, input += 4, weights += 64)
#pragma GCC unroll 2
        for (int p = 0; p < kPixels; ++p)
          add_products<false>(input + p * tile.pixel_bytes, weights, sums[p]);
    }
  }
  for (int p = 0; p < kPixels; ++p) store_16(sums[p], tile, tile.output + p * tile.output_values);
}

void convolve(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
              std::int16_t* out, std::int16_t* scratch) {
  static constexpr PatchLayout kLayout{2, store_two_planes};
  static constexpr TileKernel kKernels[] = {{2, 1, run_tile<2>}, {1, 1, run_tile<1>}};
  convolve_tiled(kLayout, kKernels, layer, in_shape, in, out, scratch);
}

}  // namespace

const KernelSet& neon_kernels() {
  static constexpr KernelSet kSet{"neon", convolve, head_fast, upsample_nearest, add_scaled};
  return kSet;
}

}  // namespace ivfm
