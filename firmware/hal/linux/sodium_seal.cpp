#include "firmware/hal/linux/sodium_seal.h"

#include <sodium.h>

#include <cstdlib>

#include "shared/wire/byte_writer.h"
#include "shared/wire/datagram.h"

namespace ivfm {
namespace {

constexpr std::size_t kTagBytes = crypto_aead_xchacha20poly1305_ietf_ABYTES;
constexpr std::size_t kContextBytes = 9;
static_assert(kTagBytes <= kMaxTrailerBytes);
static_assert(crypto_aead_xchacha20poly1305_ietf_KEYBYTES == sizeof(RadioKey));

// What both sides derive from the datagram's head and its context.
struct Derived {
  Derived(const SealContext& context, std::span<const std::uint8_t> datagram) {
    const auto head = datagram.first(kSealHeaderBytes);
    ByteWriter out(associated);
    out.bytes(head);
    out.u8(context.from_server ? 1 : 0);
    out.u64(context.receiver_boot);
    ByteWriter nonce_writer(nonce);
    nonce_writer.bytes(head.subspan(2));
    nonce_writer.u8(context.from_server ? 1 : 0);
  }
  std::array<std::uint8_t, kSealHeaderBytes + kContextBytes> associated{};
  std::array<std::uint8_t, crypto_aead_xchacha20poly1305_ietf_NPUBBYTES> nonce{};
};

}  // namespace

bool has_encryption() { return true; }

RadioKey draw_radio_key() {
  RadioKey key;
  if (sodium_init() < 0) ::abort();  // no source of random numbers
  randombytes_buf(key.data(), key.size());
  return key;
}

SodiumSeal::SodiumSeal(const RadioKey& key) : key_(key) {
  if (sodium_init() < 0) ::abort();
}

void SodiumSeal::seal(const SealContext& context, std::span<std::uint8_t> datagram) const {
  const Derived with(context, datagram);
  const auto content =
      datagram.subspan(kSealHeaderBytes, datagram.size() - kSealHeaderBytes - kTagBytes);
  crypto_aead_xchacha20poly1305_ietf_encrypt_detached(
      content.data(), datagram.last(kTagBytes).data(), nullptr, content.data(), content.size(),
      with.associated.data(), with.associated.size(), nullptr, with.nonce.data(), key_.data());
}

Status SodiumSeal::open(const SealContext& context, std::span<std::uint8_t> datagram) const {
  const Derived with(context, datagram);
  const auto content =
      datagram.subspan(kSealHeaderBytes, datagram.size() - kSealHeaderBytes - kTagBytes);
  const int result = crypto_aead_xchacha20poly1305_ietf_decrypt_detached(
      content.data(), nullptr, content.data(), content.size(), datagram.last(kTagBytes).data(),
      with.associated.data(), with.associated.size(), with.nonce.data(), key_.data());
  return result == 0 ? Status::kOk : Status::kRefused;
}

}  // namespace ivfm
