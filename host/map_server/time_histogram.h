// How long something took, in classes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace ivfm::host {

struct TimeHistogram {
  static constexpr std::array kBoundsS{0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5};

  std::array<std::uint64_t, kBoundsS.size()> at_most{};  // each includes those before it
  std::uint64_t count = 0;
  double sum_s = 0;

  void add(double seconds) {
    for (std::size_t i = 0; i < kBoundsS.size(); ++i) at_most[i] += seconds <= kBoundsS[i] ? 1 : 0;
    ++count;
    sum_s += seconds;
  }
};

}  // namespace ivfm::host
