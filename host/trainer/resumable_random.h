// Random numbers with one 64-bit word of state, so that a checkpoint can hold it.
#pragma once

#include <cstdint>

namespace ivfm::host {

// SplitMix64 (Steele, Lea, Flood 2014): the same sequence on every machine.
class ResumableRandom {
 public:
  explicit ResumableRandom(std::uint64_t seed = 0) : state_(seed) {}

  std::uint64_t next() {
    std::uint64_t z = (state_ += 0x9E3779B97F4A7C15ull);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
    return z ^ (z >> 31);
  }
  // Uniform in [0, bound); the bias is below 2^-32 for bounds under 2^32. Requires bound > 0.
  std::uint64_t below(std::uint64_t bound) { return next() % bound; }
  // Uniform in [0, 1).
  double uniform() { return static_cast<double>(next() >> 11) * 0x1.0p-53; }

  std::uint64_t state() const { return state_; }
  void set_state(std::uint64_t state) { state_ = state; }

 private:
  std::uint64_t state_;
};

}  // namespace ivfm::host
