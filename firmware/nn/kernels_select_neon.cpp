#include "firmware/nn/kernels_tiled.h"

namespace ivfm {

// Every AArch64 processor has NEON.
const KernelSet& fast_kernels() { return neon_kernels(); }

}  // namespace ivfm
