// FNV-1a, 64 bits: a hash that is the same on every machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

namespace ivfm {

// Fowler, Noll and Vo; integers count with their bytes, lowest first.
class Fnv1a {
 public:
  template <typename T>
  void add(T value) {
    static_assert(std::is_integral_v<T>);
    const auto bits = static_cast<std::make_unsigned_t<T>>(value);
    for (std::size_t i = 0; i < sizeof(T); ++i)
      add_byte(static_cast<std::uint8_t>(bits >> (8 * i)));
  }
  void add_bytes(std::span<const std::uint8_t> bytes) {
    for (const std::uint8_t byte : bytes) add_byte(byte);
  }
  std::uint64_t value() const { return hash_; }

 private:
  void add_byte(std::uint8_t byte) { hash_ = (hash_ ^ byte) * 0x100000001b3u; }

  std::uint64_t hash_ = 0xcbf29ce484222325u;
};

}  // namespace ivfm
