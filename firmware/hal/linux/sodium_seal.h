// The seal against strangers: XChaCha20-Poly1305 with the robot's key (FORMAT.md, "Protection 1").
#pragma once

#include <array>
#include <cstdint>

#include "shared/wire/datagram_seal.h"

namespace ivfm {

using RadioKey = std::array<std::uint8_t, 32>;

// False: this build has no libsodium (a cross build without it), and SodiumSeal opens nothing.
bool has_encryption();

// A key from the kernel's random numbers.
RadioKey draw_radio_key();

class SodiumSeal final : public DatagramSeal {
 public:
  explicit SodiumSeal(const RadioKey& key);
  Protection protection() const override { return Protection::kEncrypted; }
  std::size_t trailer_bytes() const override { return 16; }
  void seal(const SealContext& context, std::span<std::uint8_t> datagram) const override;
  Status open(const SealContext& context, std::span<std::uint8_t> datagram) const override;

 private:
  RadioKey key_;
};

}  // namespace ivfm
