#include "firmware/nn/kernels_tiled.h"
#include "firmware/nn/little_endian.h"

namespace ivfm {
namespace {

// Sums kPixels x 16 outputs; the compiler keeps them in vector registers where it has them.
template <int kPixels>
void run_tile(const Tile& tile) {
  std::int32_t sums[kPixels][16];
  for (int o = 0; o < 16; ++o)
    for (int p = 0; p < kPixels; ++p) sums[p][o] = read_i32(tile.bias + 4 * o);
  const std::int8_t* weights = tile.weights;
  for (int row = 0; row < tile.rows; ++row) {
    const std::uint8_t* input = tile.input + row * tile.row_bytes;
    for (int quad = 0; quad < tile.quads; ++quad, input += 4, weights += 64)
      for (int p = 0; p < kPixels; ++p) {
        const std::uint8_t* x = input + p * tile.pixel_bytes;
        for (int o = 0; o < 16; ++o)
          sums[p][o] += x[0] * weights[4 * o] + x[1] * weights[4 * o + 1] +
                        x[2] * weights[4 * o + 2] + x[3] * weights[4 * o + 3];
      }
  }
  for (int p = 0; p < kPixels; ++p)
    for (int o = 0; o < 16; ++o)
      tile.output[p * tile.output_bytes + o] =
          requantize(sums[p][o], read_i32(tile.multipliers + 4 * o), tile.shift, tile.lowest);
}

void convolve(const LayerView& layer, const TensorView& in_shape, const std::int8_t* in,
              std::int8_t* out, std::int8_t* scratch) {
  static constexpr TileKernel kKernels[] = {{2, 1, run_tile<2>}, {1, 1, run_tile<1>}};
  convolve_tiled(kKernels, layer, in_shape, in, out, scratch);
}

}  // namespace

const KernelSet& portable_kernels() {
  static constexpr KernelSet kSet{"portable", convolve, head_fast, upsample_nearest, add_scaled};
  return kSet;
}

}  // namespace ivfm
