#include <cstring>

#include "firmware/nn/kernels_tiled.h"
#include "firmware/nn/little_endian.h"

namespace ivfm {
namespace {

// Sums kPixels x 16 outputs; the compiler keeps them in vector registers where it has them.
template <int kPixels>
void run_tile(const Tile& tile) {
  std::int32_t sums[kPixels][16];
  const std::ptrdiff_t pixel_values = tile.pixel_bytes / 2, row_values = tile.row_bytes / 2;
  for (int o = 0; o < 16; ++o)
    for (int p = 0; p < kPixels; ++p) sums[p][o] = read_i32(tile.bias + 4 * o);
  const std::int8_t* weights = tile.weights;
  for (int row = 0; row < tile.rows; ++row) {
    const std::int16_t* input =
        reinterpret_cast<const std::int16_t*>(tile.input) + row * row_values;
    for (int quad = 0; quad < tile.quads; ++quad, input += 4, weights += 64)
      for (int p = 0; p < kPixels; ++p) {
        const std::int16_t* x = input + p * pixel_values;
        for (int o = 0; o < 16; ++o)
          sums[p][o] += x[0] * weights[4 * o] + x[1] * weights[4 * o + 1] +
                        x[2] * weights[4 * o + 2] + x[3] * weights[4 * o + 3];
      }
  }
  for (int p = 0; p < kPixels; ++p)
    for (int o = 0; o < 16; ++o)
      tile.output[p * tile.output_values + o] =
          requantize(sums[p][o], read_i32(tile.multipliers + 4 * o), tile.shift, tile.lowest);
}

void store_as_they_are(const std::int16_t* values, std::size_t count, std::uint8_t* out,
                       std::ptrdiff_t /*plane_bytes*/) {
  std::memcpy(out, values, count * sizeof *values);
}

void convolve(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
              std::int16_t* out, std::int16_t* scratch) {
  static constexpr PatchLayout kLayout{1, store_as_they_are};
  static constexpr TileKernel kKernels[] = {{2, 1, run_tile<2>}, {1, 1, run_tile<1>}};
  convolve_tiled(kLayout, kKernels, layer, in_shape, in, out, scratch);
}

}  // namespace

const KernelSet& portable_kernels() {
  static constexpr KernelSet kSet{"portable", convolve, head_fast, upsample_nearest, add_scaled};
  return kSet;
}

}  // namespace ivfm
