#include "firmware/nn/kernels_tiled.h"

namespace ivfm {

const KernelSet& fast_kernels() { return portable_kernels(); }

}  // namespace ivfm
