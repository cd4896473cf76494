// Integer square root: the same bits on every target.
#pragma once

#include <cstdint>

namespace ivfm {

// The largest r with r * r <= `value`.
constexpr std::uint32_t integer_sqrt(std::uint64_t value) {
  std::uint64_t root = 0, bit = std::uint64_t{1} << 62;
  while (bit > value) bit >>= 2;
  while (bit != 0) {
    if (value >= root + bit) {
      value -= root + bit;
      root = (root >> 1) + bit;
    } else {
      root >>= 1;
    }
    bit >>= 2;
  }
  return static_cast<std::uint32_t>(root);
}

}  // namespace ivfm
