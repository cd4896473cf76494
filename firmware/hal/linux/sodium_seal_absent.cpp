// Stands in for sodium_seal.cpp where libsodium is missing.
#include <cstdlib>

#include "firmware/hal/linux/sodium_seal.h"

namespace ivfm {

bool has_encryption() { return false; }
RadioKey draw_radio_key() { std::abort(); }
SodiumSeal::SodiumSeal(const RadioKey& key) : key_(key) {}
void SodiumSeal::seal(const SealContext&, std::span<std::uint8_t>) const { std::abort(); }
Status SodiumSeal::open(const SealContext&, std::span<std::uint8_t>) const {
  return Status::kRefused;
}

}  // namespace ivfm
