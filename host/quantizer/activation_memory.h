// Where each tensor of a network lies in the firmware's activation memory.
#pragma once

#include <cstdint>
#include <vector>

#include "host/quantizer/float_network.h"

namespace ivfm::host {

struct ActivationPlan {
  std::vector<std::uint32_t>
      offsets;  // per tensor, multiples of 64; the head's output has none (0)
  std::uint32_t bytes = 0;
};

// Packs the tensors so that none overwrites another one that is still read; an addition takes the
// place of an operand that nobody reads later. Largest tensors first.
ActivationPlan plan_activations(const FloatNetwork& network);

}  // namespace ivfm::host
