#include <immintrin.h>

#include <cstring>

#include "firmware/nn/kernels_tiled.h"

// One vector holds the sums of 16 outputs; vpdpbusd adds four products to each at once.
#define IVFM_TARGET __attribute__((target("avx512f,avx512bw,avx512vl,avx512vnni")))

namespace ivfm {
namespace {

IVFM_TARGET inline __m512i broadcast_quad(const std::uint8_t* p) {
  int quad;
  std::memcpy(&quad, p, sizeof quad);
  return _mm512_set1_epi32(quad);
}

// Requantizes 16 sums, the even and the odd lanes apart, as 64-bit numbers.
IVFM_TARGET inline __m256i requantize_16(__m512i sums, __m512i multipliers, const Tile& tile) {
  const __m512i half = _mm512_set1_epi64(std::int64_t{1} << (tile.shift - 1));
  const __m128i shift = _mm_cvtsi32_si128(tile.shift);
  const __m512i low = _mm512_set1_epi64(tile.lowest), high = _mm512_set1_epi64(kMaxActivation);
  __m512i even = _mm512_mul_epi32(sums, multipliers);
  __m512i odd = _mm512_mul_epi32(_mm512_srli_epi64(sums, 32), _mm512_srli_epi64(multipliers, 32));
  even = _mm512_sra_epi64(_mm512_add_epi64(even, half), shift);
  odd = _mm512_sra_epi64(_mm512_add_epi64(odd, half), shift);
  even = _mm512_min_epi64(_mm512_max_epi64(even, low), high);
  odd = _mm512_min_epi64(_mm512_max_epi64(odd, low), high);
  return _mm512_cvtepi32_epi16(_mm512_mask_blend_epi32(0xaaaa, even, _mm512_slli_epi64(odd, 32)));
}

template <int kPixels, int kGroups>
IVFM_TARGET void run_tile(const Tile& tile) {
  __m512i sums[kPixels][kGroups] = {};
  for (int plane = 0; plane < 2; ++plane) {
    const std::int8_t* weights = tile.weights;
#pragma GCC unroll 16
    for (int p = 0; p < kPixels; ++p)
#pragma GCC unroll 4
      for (int g = 0; g < kGroups; ++g) sums[p][g] = _mm512_slli_epi32(sums[p][g], 7);
    for (int row = 0; row < tile.rows; ++row) {
      const std::uint8_t* input = tile.input + plane * tile.plane_bytes + row * tile.row_bytes;
      for (int quad = 0; quad < tile.quads; ++quad, input += 4, weights += 64) {
        __m512i w[kGroups];
#pragma GCC unroll 4
        for (int g = 0; g < kGroups; ++g) w[g] = _mm512_loadu_si512(weights + g * tile.group_bytes);
#pragma GCC unroll 16
        for (int p = 0; p < kPixels; ++p) {
          const __m512i x = broadcast_quad(input + p * tile.pixel_bytes);
#pragma GCC unroll 4
          for (int g = 0; g < kGroups; ++g) sums[p][g] = _mm512_dpbusd_epi32(sums[p][g], x, w[g]);
        }
      }
    }
  }
#pragma GCC unroll 4
  for (int g = 0; g < kGroups; ++g) {
    const __m512i bias = _mm512_loadu_si512(tile.bias + 64 * g);
    const __m512i multipliers = _mm512_loadu_si512(tile.multipliers + 64 * g);
#pragma GCC unroll 16
    for (int p = 0; p < kPixels; ++p)
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(tile.output + p * tile.output_values + 16 * g),
                          requantize_16(_mm512_add_epi32(sums[p][g], bias), multipliers, tile));
  }
}

void convolve(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
              std::int16_t* out, std::int16_t* scratch) {
  static constexpr PatchLayout kLayout{2, store_two_planes_avx2};
  static constexpr TileKernel kKernels[] = {{8, 2, run_tile<8, 2>},
                                            {4, 4, run_tile<4, 4>},
                                            {16, 1, run_tile<16, 1>},
                                            {4, 1, run_tile<4, 1>},
                                            {1, 1, run_tile<1, 1>}};
  convolve_tiled(kLayout, kKernels, layer, in_shape, in, out, scratch);
}

}  // namespace

const KernelSet& avx512_vnni_kernels() {
  static constexpr KernelSet kSet{"avx512-vnni", convolve, head_fast, upsample_nearest,
                                  add_scaled_avx2};
  return kSet;
}

}  // namespace ivfm
