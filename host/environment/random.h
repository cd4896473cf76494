// Portable seeded random numbers: the same draws on every machine and with every library.
#pragma once

#include <cstdint>

namespace ivfm::host {

// SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014).
class Random {
 public:
  explicit constexpr Random(std::uint64_t seed) : state_(seed) {}
  // An independent generator for `stream`, e.g. one for each episode, agent or purpose.
  constexpr Random(std::uint64_t seed, std::uint64_t stream)
      : state_(mixed(seed) ^ mixed(stream + 0x632be59bd9b4e019u)) {}

  constexpr std::uint64_t next() { return mixed(state_ += 0x9e3779b97f4a7c15u); }

  // Uniform in [0, bound), without bias (Lemire 2019); 0 when `bound` is 0.
  constexpr std::uint32_t below(std::uint32_t bound) {
    if (bound == 0) return 0;
    const std::uint32_t threshold = (0u - bound) % bound;
    for (;;) {
      const std::uint64_t product = (next() >> 32) * bound;
      if (static_cast<std::uint32_t>(product) >= threshold) {
        return static_cast<std::uint32_t>(product >> 32);
      }
    }
  }
  // Uniform in [low, high]; requires low <= high.
  constexpr std::int32_t between(std::int32_t low, std::int32_t high) {
    return low + static_cast<std::int32_t>(below(static_cast<std::uint32_t>(high - low) + 1u));
  }
  constexpr bool chance(std::uint32_t percent) { return below(100) < percent; }
  // Uniform in [0, 1) with 53 random bits.
  constexpr double unit() { return static_cast<double>(next() >> 11) * 0x1p-53; }

 private:
  static constexpr std::uint64_t mixed(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
  }

  std::uint64_t state_;
};

}  // namespace ivfm::host
