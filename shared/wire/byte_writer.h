// Writes little-endian integers into bytes; never writes past their end.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

namespace ivfm {

// After the first write past the end, ok() is false for good and nothing more is written.
class ByteWriter {
 public:
  explicit ByteWriter(std::span<std::uint8_t> bytes) : bytes_(bytes) {}

  bool ok() const { return ok_; }
  std::size_t size() const { return size_; }
  std::span<std::uint8_t> rest() const { return bytes_.subspan(size_); }
  // Counts `size` bytes as written that the caller put into rest().
  void skip(std::size_t size) {
    if (has_room(size)) size_ += size;
  }

  void u8(std::uint8_t value) { little_endian(value, 1); }
  void u16(std::uint16_t value) { little_endian(value, 2); }
  void u24(std::uint32_t value) { little_endian(value, 3); }
  void u32(std::uint32_t value) { little_endian(value, 4); }
  void u64(std::uint64_t value) { little_endian(value, 8); }
  void i24(std::int32_t value) { u24(static_cast<std::uint32_t>(value)); }
  void i32(std::int32_t value) { u32(static_cast<std::uint32_t>(value)); }
  void bytes(std::span<const std::uint8_t> source) {
    if (!has_room(source.size())) return;
    std::copy(source.begin(), source.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(size_));
    size_ += source.size();
  }

 private:
  bool has_room(std::size_t size) {
    ok_ = ok_ && size <= bytes_.size() - size_;
    return ok_;
  }
  void little_endian(std::uint64_t value, std::size_t size) {
    if (!has_room(size)) return;
    for (std::size_t i = 0; i < size; ++i) {
      bytes_[size_++] = static_cast<std::uint8_t>(value >> (8 * i));
    }
  }

  std::span<std::uint8_t> bytes_;
  std::size_t size_ = 0;
  bool ok_ = true;
};

}  // namespace ivfm
