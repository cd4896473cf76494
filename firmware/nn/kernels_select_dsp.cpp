#include "firmware/nn/kernels_tiled.h"

namespace ivfm {

// Cortex-M7 and 32-bit ARM Linux: ARMv7 with the DSP instructions.
const KernelSet& fast_kernels() { return dsp_kernels(); }

}  // namespace ivfm
