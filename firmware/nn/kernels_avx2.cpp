#include <immintrin.h>

#include <cstring>

#include "firmware/nn/kernels_tiled.h"
#include "firmware/nn/little_endian.h"

// Two vectors hold the sums of 16 outputs. vpmaddubsw adds two products of at most 127 * 127 to an
// int16, which cannot saturate; vpmaddwd adds the two halves of a quad.
#define IVFM_TARGET __attribute__((target("avx2")))

namespace ivfm {
namespace {

IVFM_TARGET inline __m256i load(const void* p) {
  return _mm256_loadu_si256(static_cast<const __m256i*>(p));
}

IVFM_TARGET inline __m256i add_products(__m256i sums, __m256i inputs, __m256i weights) {
  const __m256i pairs = _mm256_maddubs_epi16(inputs, weights);
  return _mm256_add_epi32(sums, _mm256_madd_epi16(pairs, _mm256_set1_epi16(1)));
}

template <int kPixels>
IVFM_TARGET void run_tile(const Tile& tile) {
  __m256i sums[kPixels][2];
#pragma GCC unroll 4
  for (int p = 0; p < kPixels; ++p) {
    sums[p][0] = load(tile.bias);
    sums[p][1] = load(tile.bias + 32);
  }
  const std::int8_t* weights = tile.weights;
  for (int row = 0; row < tile.rows; ++row) {
    const std::uint8_t* input = tile.input + row * tile.row_bytes;
    for (int quad = 0; quad < tile.quads; ++quad, input += 4, weights += 64) {
      const __m256i low = load(weights), high = load(weights + 32);
#pragma GCC unroll 4
      for (int p = 0; p < kPixels; ++p) {
        int bytes;
        std::memcpy(&bytes, input + p * tile.pixel_bytes, sizeof bytes);
        const __m256i x = _mm256_set1_epi32(bytes);
        sums[p][0] = add_products(sums[p][0], x, low);
        sums[p][1] = add_products(sums[p][1], x, high);
      }
    }
  }
  std::int32_t values[16];
  for (int p = 0; p < kPixels; ++p) {
    std::memcpy(values, sums[p], sizeof values);
    for (int o = 0; o < 16; ++o)
      tile.output[p * tile.output_bytes + o] =
          requantize(values[o], read_i32(tile.multipliers + 4 * o), tile.shift, tile.lowest);
  }
}

void convolve(const LayerView& layer, const TensorView& in_shape, const std::int8_t* in,
              std::int8_t* out, std::int8_t* scratch) {
  static constexpr TileKernel kKernels[] = {{4, 1, run_tile<4>}, {1, 1, run_tile<1>}};
  convolve_tiled(kKernels, layer, in_shape, in, out, scratch);
}

}  // namespace

const KernelSet& avx2_kernels() {
  static constexpr KernelSet kSet{"avx2", convolve, head_fast, upsample_nearest, add_scaled};
  return kSet;
}

}  // namespace ivfm
