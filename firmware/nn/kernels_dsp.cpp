#include <cstring>

#include "firmware/nn/kernels_tiled.h"
#include "firmware/nn/little_endian.h"

// The 16-bit multiply-accumulate instructions that Cortex-M4, M7 and ARMv7-A have: SXTB16 spreads
// two of a quad's weights, SMLAD adds two products at once. Two outputs of two pixels a pass fit
// the registers.
namespace ivfm {
namespace {

std::int32_t load_word(const void* p) {
  std::int32_t word;
  std::memcpy(&word, p, sizeof word);
  return word;
}

// The first and the third byte of a quad as int16.
std::int32_t spread_even(std::int32_t quad) {
  std::int32_t spread;
  asm("sxtb16 %0, %1" : "=r"(spread) : "r"(quad));
  return spread;
}

// The second and the fourth.
std::int32_t spread_odd(std::int32_t quad) {
  std::int32_t spread;
  asm("sxtb16 %0, %1, ror #8" : "=r"(spread) : "r"(quad));
  return spread;
}

std::int32_t add_products(std::int32_t x, std::int32_t w, std::int32_t sum) {
  asm("smlad %0, %1, %2, %0" : "+r"(sum) : "r"(x), "r"(w));
  return sum;
}

// A patch's activations lie in the scratch memory as SMLAD takes them: the even two of a quad in
// one word, the odd ones in the next.
void store_spread(const std::int16_t* values, std::size_t count, std::uint8_t* out,
                  std::ptrdiff_t /*plane_bytes*/) {
  for (std::size_t i = 0; i < count; i += 4) {
    const std::int16_t quad[4] = {values[i], values[i + 2], values[i + 1], values[i + 3]};
    std::memcpy(out + 2 * i, quad, sizeof quad);
  }
}

// Outputs `output` and the next one of all the tile's pixels.
template <int kPixels>
void run_two_outputs(const Tile& tile, int output) {
  std::int32_t sums[2][kPixels];
  for (int o = 0; o < 2; ++o)
    for (int p = 0; p < kPixels; ++p) sums[o][p] = read_i32(tile.bias + 4 * (output + o));
  const std::int8_t* weights = tile.weights + 4 * output;
  const std::ptrdiff_t pixel_bytes = tile.pixel_bytes;
  for (int row = 0; row < tile.rows; ++row) {
    const std::uint8_t* input = tile.input + row * tile.row_bytes;
    const std::uint8_t* const end = input + std::ptrdiff_t{8} * tile.quads;
    for (; input != end; input += 8, weights += 64) {
      std::int32_t even[kPixels], odd[kPixels];
      for (int p = 0; p < kPixels; ++p) {
        even[p] = load_word(input + p * pixel_bytes);
        odd[p] = load_word(input + p * pixel_bytes + 4);
      }
      for (int o = 0; o < 2; ++o) {
        const std::int32_t quad = load_word(weights + 4 * o);
        const std::int32_t w_even = spread_even(quad), w_odd = spread_odd(quad);
        for (int p = 0; p < kPixels; ++p)
          sums[o][p] = add_products(odd[p], w_odd, add_products(even[p], w_even, sums[o][p]));
      }
    }
  }
  for (int o = 0; o < 2; ++o)
    for (int p = 0; p < kPixels; ++p)
      tile.output[p * tile.output_values + output + o] = requantize(
          sums[o][p], read_i32(tile.multipliers + 4 * (output + o)), tile.shift, tile.lowest);
}

template <int kPixels>
void run_tile(const Tile& tile) {
  for (int output = 0; output < model_format::kOutputGroup; output += 2)
    run_two_outputs<kPixels>(tile, output);
}

void convolve(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
              std::int16_t* out, std::int16_t* scratch) {
  static constexpr PatchLayout kLayout{1, store_spread};
  static constexpr TileKernel kKernels[] = {{2, 1, run_tile<2>}, {1, 1, run_tile<1>}};
  convolve_tiled(kLayout, kKernels, layer, in_shape, in, out, scratch);
}

}  // namespace

const KernelSet& dsp_kernels() {
  static constexpr KernelSet kSet{"dsp", convolve, head_fast, upsample_nearest, add_scaled};
  return kSet;
}

}  // namespace ivfm
