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
  __m256i sums[kPixels][2] = {};
  for (int plane = 0; plane < 2; ++plane) {
    const std::int8_t* weights = tile.weights;
#pragma GCC unroll 4
    for (int p = 0; p < kPixels; ++p)
      for (__m256i& sum : sums[p]) sum = _mm256_slli_epi32(sum, 7);
    for (int row = 0; row < tile.rows; ++row) {
      const std::uint8_t* input = tile.input + plane * tile.plane_bytes + row * tile.row_bytes;
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
  }
  std::int32_t values[16];
  for (int p = 0; p < kPixels; ++p) {
    std::memcpy(values, sums[p], sizeof values);
    for (int o = 0; o < 16; ++o)
      tile.output[p * tile.output_values + o] =
          requantize(values[o] + read_i32(tile.bias + 4 * o), read_i32(tile.multipliers + 4 * o),
                     tile.shift, tile.lowest);
  }
}

void convolve(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
              std::int16_t* out, std::int16_t* scratch) {
  static constexpr PatchLayout kLayout{2, store_two_planes_avx2};
  static constexpr TileKernel kKernels[] = {{4, 1, run_tile<4>}, {1, 1, run_tile<1>}};
  convolve_tiled(kLayout, kKernels, layer, in_shape, in, out, scratch);
}

IVFM_TARGET inline __m256i load_8_as_int32(const std::int16_t* p) {
  return _mm256_cvtepi16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p)));
}

}  // namespace

// Tensors hold multiples of 16 values.
IVFM_TARGET void add_scaled_avx2(const LayerView& layer, std::size_t size, const std::int16_t* a,
                                 const std::int16_t* b, std::int16_t* out) {
  const __m256i multiplier_a = _mm256_set1_epi32(static_cast<int>(layer.multiplier_a));
  const __m256i multiplier_b = _mm256_set1_epi32(static_cast<int>(layer.multiplier_b));
  const __m256i half = _mm256_set1_epi32(1 << (layer.shift - 1));
  const __m128i shift = _mm_cvtsi32_si128(layer.shift);
  const __m256i lowest = _mm256_set1_epi32(lowest_activation(layer));
  const __m256i highest = _mm256_set1_epi32(kMaxActivation);
  for (std::size_t i = 0; i < size; i += 8) {
    const __m256i scaled_a = _mm256_mullo_epi32(load_8_as_int32(a + i), multiplier_a);
    const __m256i scaled_b = _mm256_mullo_epi32(load_8_as_int32(b + i), multiplier_b);
    const __m256i sum = _mm256_add_epi32(_mm256_add_epi32(scaled_a, scaled_b), half);
    const __m256i clamped =
        _mm256_min_epi32(_mm256_max_epi32(_mm256_sra_epi32(sum, shift), lowest), highest);
    _mm_storeu_si128(
        reinterpret_cast<__m128i*>(out + i),
        _mm_packs_epi32(_mm256_castsi256_si128(clamped), _mm256_extracti128_si256(clamped, 1)));
  }
}

IVFM_TARGET void store_two_planes_avx2(const std::int16_t* values, std::size_t count,
                                       std::uint8_t* out, std::ptrdiff_t plane_bytes) {
  const __m256i lower_7_bits = _mm256_set1_epi16(127);
  std::size_t i = 0;
  for (; i + 32 <= count; i += 32) {
    const __m256i a = load(values + i), b = load(values + i + 16);
    const __m256i upper = _mm256_packus_epi16(_mm256_srli_epi16(a, 7), _mm256_srli_epi16(b, 7));
    const __m256i lower =
        _mm256_packus_epi16(_mm256_and_si256(a, lower_7_bits), _mm256_and_si256(b, lower_7_bits));
    // Packing works in each half of the register: put the quarters in order.
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + i), _mm256_permute4x64_epi64(upper, 0xd8));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + plane_bytes + i),
                        _mm256_permute4x64_epi64(lower, 0xd8));
  }
  for (; i < count; ++i) {
    out[i] = static_cast<std::uint8_t>(values[i] >> 7);
    out[plane_bytes + static_cast<std::ptrdiff_t>(i)] = static_cast<std::uint8_t>(values[i] & 127);
  }
}

const KernelSet& avx2_kernels() {
  static constexpr KernelSet kSet{"avx2", convolve, head_fast, upsample_nearest, add_scaled_avx2};
  return kSet;
}

}  // namespace ivfm
