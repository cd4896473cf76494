// CRC-32 as in IEEE 802.3, zlib and PNG: reflected, polynomial 0x04c11db7.
#pragma once

#include <cstdint>
#include <span>

namespace ivfm {

// The CRC-32 of `bytes`. To continue over several pieces, pass the previous result as `crc`.
std::uint32_t crc32(std::span<const std::uint8_t> bytes, std::uint32_t crc = 0);

}  // namespace ivfm
