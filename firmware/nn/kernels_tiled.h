// Convolution cut into tiles of pixels and output channels, for kernels that fill registers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/nn/kernels.h"

namespace ivfm {

// Neighbouring pixels of one output row by groups of 16 output channels. A pixel's patch is `rows`
// runs of `quads` * 4 consecutive input bytes, in the order of the weights.
struct Tile {
  const std::uint8_t* input;   // the first pixel's patch; all values at most 127
  std::ptrdiff_t pixel_bytes;  // from one pixel's patch to the next one's
  std::ptrdiff_t row_bytes;    // from one run of a patch to the next
  int rows;
  int quads;
  const std::int8_t* weights;  // of the first group: 64 bytes a quad
  std::ptrdiff_t group_bytes;  // from one group's weights to the next one's
  const std::uint8_t* bias;    // of the first group, little-endian int32
  const std::uint8_t* multipliers;
  int shift;
  int lowest;                   // -127, or 0 with ReLU
  std::int8_t* output;          // the first pixel's first channel
  std::ptrdiff_t output_bytes;  // from one pixel to the next
};

// A function for tiles of `pixels` x `groups`. The last of a set takes 1 x 1.
struct TileKernel {
  int pixels;
  int groups;
  void (*run)(const Tile& tile);
};

// Pads the input into `scratch` for 3x3 and covers the output with the first kernels that fit.
void convolve_tiled(const TileKernel* kernels, const LayerView& layer, const TensorView& in_shape,
                    const std::int8_t* in, std::int8_t* out, std::int8_t* scratch);

// The same for every set: cheap beside the convolutions.
void head_fast(const LayerView& layer, const TensorView& in_shape, const std::int8_t* in,
               std::int32_t* out);
void upsample_nearest(const TensorView& in_shape, const std::int8_t* in, std::int8_t* out);
void add_scaled(const LayerView& layer, std::size_t size, const std::int8_t* a,
                const std::int8_t* b, std::int8_t* out);

// Compiled for x86-64 only; call them only where the processor has the instructions.
const KernelSet& avx512_vnni_kernels();
const KernelSet& avx2_kernels();
void add_scaled_avx2(const LayerView& layer, std::size_t size, const std::int8_t* a,
                     const std::int8_t* b, std::int8_t* out);
// Compiled for AArch64 only.
const KernelSet& neon_kernels();
// Compiled for ARMv7 only: Cortex-M7, 32-bit ARM Linux.
const KernelSet& dsp_kernels();
// Plain C++, for every other processor.
const KernelSet& portable_kernels();

}  // namespace ivfm
