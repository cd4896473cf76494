// The integer kernels of the network: what a set of them does. All sets answer the same bits.
#pragma once

#include <cstdint>

#include "firmware/nn/model_view.h"

namespace ivfm {

// Inputs and outputs are as large as the layer's shapes say and, but for an addition, do not
// overlap.
struct KernelSet {
  const char* name;
  // 3x3 and 1x1 convolutions but the head. `scratch`: kScratchBytes, at a multiple of 64.
  void (*convolve)(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
                   std::int16_t* out, std::int16_t* scratch);
  // The head: one accumulator a pixel.
  void (*head)(const LayerView& layer, const TensorView& in_shape, const std::int16_t* in,
               std::int32_t* out);
  void (*upsample)(const TensorView& in_shape, const std::int16_t* in, std::int16_t* out);
  // `out` may be `a` or `b`.
  void (*add)(const LayerView& layer, std::size_t size, const std::int16_t* a,
              const std::int16_t* b, std::int16_t* out);
};

// The plainest code that is right: what the other sets are tested against.
const KernelSet& reference_kernels();

// The fastest set that this processor can run. On x86-64 chosen at run time.
const KernelSet& fast_kernels();

// The lowest activation that a layer answers.
constexpr int lowest_activation(const LayerView& layer) { return layer.relu ? 0 : -kMaxActivation; }

// An accumulator as an activation; see LayerView.
inline std::int16_t requantize(std::int32_t accumulator, std::int32_t multiplier, int shift,
                               int lowest) {
  const std::int64_t product = std::int64_t{accumulator} * multiplier;
  const std::int64_t scaled = (product + (std::int64_t{1} << (shift - 1))) >> shift;
  return static_cast<std::int16_t>(scaled < lowest           ? lowest
                                   : scaled > kMaxActivation ? kMaxActivation
                                                             : scaled);
}

}  // namespace ivfm
