// The number that tells this start of a program from all others.
#pragma once

#include <sys/random.h>

#include <cstdint>

namespace ivfm {

// 64 bits from the kernel's random numbers, not 0. Waits while the kernel has none yet, early after
// the machine has started.
inline std::uint64_t draw_boot() {
  std::uint64_t boot = 0;
  while (boot == 0) {
    if (::getrandom(&boot, sizeof boot, 0) != static_cast<ssize_t>(sizeof boot)) boot = 0;
  }
  return boot;
}

}  // namespace ivfm
