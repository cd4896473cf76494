#include "firmware/nn/kernels_tiled.h"

namespace ivfm {

const KernelSet& fast_kernels() {
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512vnni") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512vl"))
    return avx512_vnni_kernels();
  return __builtin_cpu_supports("avx2") ? avx2_kernels() : portable_kernels();
}

}  // namespace ivfm
