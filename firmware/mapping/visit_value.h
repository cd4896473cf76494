// The logistic function of visit counts as a table: the i-VFM's value and the reward's penalty.
#pragma once

#include <array>
#include <cstdint>

namespace ivfm {

namespace detail {

// exp(-v) for a whole v >= 0; only run by the compiler.
consteval double exp_minus(int v) {
  double result = 1.0;
  for (int i = 0; i < v; ++i) result /= 2.718281828459045;
  return result;
}

// sigma(v) in Q16 for v = 0 .. 255.
consteval auto make_sigma_table() {
  std::array<std::uint32_t, 256> table{};
  for (int v = 0; v < 256; ++v) {
    table[static_cast<std::size_t>(v)] =
        static_cast<std::uint32_t>(65536.0 / (1.0 + exp_minus(v)) + 0.5);
  }
  return table;
}

inline constexpr auto kSigmaTable = make_sigma_table();

}  // namespace detail

// sigma(v) = 1 / (1 + e^-v) in Q16, v in 0 .. 255.
constexpr std::uint32_t sigma_q16(unsigned visits) {
  return detail::kSigmaTable[visits < 255 ? visits : 255];
}

// 2 sigma(v) - 1 in Q12: what re-seeing a cell costs (method.md, "Reward").
constexpr std::int32_t visit_penalty_q12(unsigned visits) {
  return static_cast<std::int32_t>(sigma_q16(visits) >> 3) - 4096;
}

}  // namespace ivfm
