// What the policy sees at a decision: the network's state and the goals within reach.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace ivfm::host {

inline constexpr int kGridSide = 32;                    // policy cells along a side
inline constexpr int kActions = kGridSide * kGridSide;  // one goal per policy cell
inline constexpr int kMostChannels = 4;                 // of a state (network_state.h)

// Channel-major, each channel row by row from the south row, x to the east. A state of fewer
// channels leaves the last ones 0.
using State = std::array<std::uint16_t, kMostChannels * kActions>;

// One bit per policy cell.
class ActionMask {
 public:
  bool test(int action) const {
    return (words_[static_cast<std::size_t>(action) / 64] >> (action % 64) & 1) != 0;
  }
  void set(int action) {
    words_[static_cast<std::size_t>(action) / 64] |= std::uint64_t{1} << (action % 64);
  }
  bool any() const {
    for (const std::uint64_t word : words_)
      if (word != 0) return true;
    return false;
  }
  int count() const {
    int n = 0;
    for (const std::uint64_t word : words_) n += __builtin_popcountll(word);
    return n;
  }
  bool operator==(const ActionMask&) const = default;

 private:
  std::array<std::uint64_t, kActions / 64> words_{};
};

struct Observation {
  State state{};
  ActionMask reachable;
};

}  // namespace ivfm::host
