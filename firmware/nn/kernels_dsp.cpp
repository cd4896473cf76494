#include <cstring>

#include "firmware/nn/kernels_tiled.h"
#include "firmware/nn/little_endian.h"

// The 16-bit multiply-accumulate instructions that Cortex-M4, M7 and ARMv7-A have: SXTB16 spreads
// two of a quad's bytes, SMLAD adds two products at once. Two outputs of two pixels a pass fit the
// registers.
namespace ivfm {
namespace {

struct SpreadQuad {
  std::int32_t even;  // bytes 0 and 2 as int16
  std::int32_t odd;   // bytes 1 and 3
};

SpreadQuad spread(const void* quad_bytes) {
  std::uint32_t quad;
  std::memcpy(&quad, quad_bytes, sizeof quad);
  SpreadQuad s;
  asm("sxtb16 %0, %1" : "=r"(s.even) : "r"(quad));
  asm("sxtb16 %0, %1, ror #8" : "=r"(s.odd) : "r"(quad));
  return s;
}

std::int32_t add_products(const SpreadQuad& x, const SpreadQuad& w, std::int32_t sum) {
  asm("smlad %0, %1, %2, %0" : "+r"(sum) : "r"(x.even), "r"(w.even));
  asm("smlad %0, %1, %2, %0" : "+r"(sum) : "r"(x.odd), "r"(w.odd));
  return sum;
}

// Outputs `output` and the next one of all the tile's pixels.
template <int kPixels>
void run_two_outputs(const Tile& tile, int output) {
  std::int32_t sums[2][kPixels];
  for (int o = 0; o < 2; ++o)
    for (int p = 0; p < kPixels; ++p) sums[o][p] = read_i32(tile.bias + 4 * (output + o));
  const std::int8_t* weights = tile.weights + 4 * output;
  for (int row = 0; row < tile.rows; ++row) {
    const std::uint8_t* input = tile.input + row * tile.row_bytes;
    for (int quad = 0; quad < tile.quads; ++quad, input += 4, weights += 64) {
      SpreadQuad x[kPixels];
      for (int p = 0; p < kPixels; ++p) x[p] = spread(input + p * tile.pixel_bytes);
      for (int o = 0; o < 2; ++o) {
        const SpreadQuad w = spread(weights + 4 * o);
        for (int p = 0; p < kPixels; ++p) sums[o][p] = add_products(x[p], w, sums[o][p]);
      }
    }
  }
  for (int o = 0; o < 2; ++o)
    for (int p = 0; p < kPixels; ++p)
      tile.output[p * tile.output_bytes + output + o] = requantize(
          sums[o][p], read_i32(tile.multipliers + 4 * (output + o)), tile.shift, tile.lowest);
}

template <int kPixels>
void run_tile(const Tile& tile) {
  for (int output = 0; output < model_format::kOutputGroup; output += 2)
    run_two_outputs<kPixels>(tile, output);
}

void convolve(const LayerView& layer, const TensorView& in_shape, const std::int8_t* in,
              std::int8_t* out, std::int8_t* scratch) {
  static constexpr TileKernel kKernels[] = {{2, 1, run_tile<2>}, {1, 1, run_tile<1>}};
  convolve_tiled(kKernels, layer, in_shape, in, out, scratch);
}

}  // namespace

const KernelSet& dsp_kernels() {
  static constexpr KernelSet kSet{"dsp", convolve, head_fast, upsample_nearest, add_scaled};
  return kSet;
}

}  // namespace ivfm
