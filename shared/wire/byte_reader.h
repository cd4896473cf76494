// Reads little-endian integers from bytes; never reads past their end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace ivfm {

// After the first read past the end, ok() is false for good and every value read is 0.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  bool ok() const { return ok_; }
  std::size_t remaining() const { return bytes_.size(); }

  std::uint8_t u8() { return static_cast<std::uint8_t>(little_endian(1)); }
  std::uint16_t u16() { return static_cast<std::uint16_t>(little_endian(2)); }
  std::uint32_t u24() { return static_cast<std::uint32_t>(little_endian(3)); }
  std::uint32_t u32() { return static_cast<std::uint32_t>(little_endian(4)); }
  std::uint64_t u64() { return little_endian(8); }
  std::int32_t i24() {
    const std::uint32_t raw = u24();
    return static_cast<std::int32_t>(raw) - (raw & 0x800000u ? 0x1000000 : 0);
  }
  std::int32_t i32() { return static_cast<std::int32_t>(u32()); }

  // The next `size` bytes, or an empty span (and no longer ok) when there are fewer.
  std::span<const std::uint8_t> bytes(std::size_t size) {
    if (!ok_ || size > bytes_.size()) {
      ok_ = false;
      bytes_ = {};
      return {};
    }
    const auto taken = bytes_.first(size);
    bytes_ = bytes_.subspan(size);
    return taken;
  }

 private:
  std::uint64_t little_endian(std::size_t size) {
    std::uint64_t value = 0;
    unsigned shift = 0;
    for (const std::uint8_t byte : bytes(size)) {
      value |= static_cast<std::uint64_t>(byte) << shift;
      shift += 8;
    }
    return value;
  }

  std::span<const std::uint8_t> bytes_;
  bool ok_ = true;
};

}  // namespace ivfm
