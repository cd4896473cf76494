// Convolution cut into tiles of pixels and output channels, for kernels that fill registers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/nn/kernels.h"

namespace ivfm {

// How a patch lies in the scratch memory: activations either as they are, 16 bits each, or in two
// planes of bytes, the upper 7 bits and the lower 7, for processors that multiply bytes fastest:
//   sum of weight x activation = 128 x sum over the upper plane + sum over the lower one.
struct PatchLayout {
  int planes;  // 1 or 2
  // Writes activations that are not negative; the second plane begins `plane_bytes` after `out`.
  void (*store)(const std::int16_t* values, std::size_t count, std::uint8_t* out,
                std::ptrdiff_t plane_bytes);

  constexpr int value_bytes() const { return 2 / planes; }
};

// Neighbouring pixels of one output row by groups of 16 output channels. A pixel's patch is `rows`
// runs of `quads` * 4 consecutive values in each plane, in the order of the weights.
struct Tile {
  const std::uint8_t* input;   // the first pixel's patch
  std::ptrdiff_t plane_bytes;  // from the upper plane to the lower one
  std::ptrdiff_t pixel_bytes;  // from one pixel's patch to the next one's
  std::ptrdiff_t row_bytes;    // from one run of a patch to the next
  int rows;
  int quads;
  const std::int8_t* weights;  // of the first group: 64 bytes a quad
  std::ptrdiff_t group_bytes;  // from one group's weights to the next one's
  const std::uint8_t* bias;    // of the first group, little-endian int32
  const std::uint8_t* multipliers;
  int shift;
  int lowest;                    // of the activations that leave
  std::int16_t* output;          // the first pixel's first channel
  std::ptrdiff_t output_values;  // from one pixel to the next
};

// A function for tiles of `pixels` x `groups`. The last of a set takes 1 x 1.
struct TileKernel {
  int pixels;
  int groups;
  void (*run)(const Tile& tile);
};

// Lays out the input in `scratch`, so many rows at a time as fit, padded with zeros for 3x3, and
// covers the output with the first kernels that fit.
void convolve_tiled(const PatchLayout& layout, const TileKernel* kernels, const LayerView& layer,
                    const TensorView& in_shape, const std::int16_t* in, std::int16_t* out,
                    std::int16_t* scratch);

// The same for every set: cheap beside the convolutions.
void head_fast(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
               std::int32_t* out);
void upsample_nearest(const TensorView& in_shape, const std::int16_t* in, std::int16_t* out);
void add_scaled(const LayerView& layer, std::size_t size, const std::int16_t* a,
                const std::int16_t* b, std::int16_t* out);

// Compiled for x86-64 only; call them only where the processor has the instructions.
const KernelSet& avx512_vnni_kernels();
const KernelSet& avx2_kernels();
void add_scaled_avx2(const LayerView& layer, std::size_t size, const std::int16_t* a,
                     const std::int16_t* b, std::int16_t* out);
void store_two_planes_avx2(const std::int16_t* values, std::size_t count, std::uint8_t* out,
                           std::ptrdiff_t plane_bytes);
// Compiled for AArch64 only.
const KernelSet& neon_kernels();
// Compiled for ARMv7 only: Cortex-M7, 32-bit ARM Linux.
const KernelSet& dsp_kernels();
// Plain C++, for every other processor.
const KernelSet& portable_kernels();

}  // namespace ivfm
