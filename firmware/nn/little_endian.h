// Reads little-endian numbers at any alignment.
#pragma once

#include <cstdint>

namespace ivfm {

constexpr std::uint16_t read_u16(const std::uint8_t* p) {
  return static_cast<std::uint16_t>(p[0] | p[1] << 8);
}
constexpr std::uint32_t read_u32(const std::uint8_t* p) {
  return std::uint32_t{p[0]} | std::uint32_t{p[1]} << 8 | std::uint32_t{p[2]} << 16 |
         std::uint32_t{p[3]} << 24;
}
constexpr std::int32_t read_i32(const std::uint8_t* p) {
  return static_cast<std::int32_t>(read_u32(p));
}

}  // namespace ivfm
