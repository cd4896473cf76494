// Port: what protects a datagram on its way. The envelope (datagram.h) is the same with every seal.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/status/status.h"

namespace ivfm {

enum class Protection : std::uint8_t {
  kChecksum = 0,   // CRC-32: against accidents only
  kEncrypted = 1,  // XChaCha20-Poly1305 with the robot's key: against strangers
};

inline constexpr std::size_t kMaxTrailerBytes = 16;

// What both sides know of a datagram without its being sent. A datagram of another direction, or
// for an earlier start of its receiver, does not open.
struct SealContext {
  bool from_server = false;
  std::uint64_t receiver_boot = 0;  // 0: the sender does not know it yet
};

// Works in place on whole datagrams: kSealHeaderBytes in the clear, content, trailer_bytes() of
// trailer. Implementations: PlainSeal, hal/linux/sodium_seal.h.
class DatagramSeal {
 public:
  virtual Protection protection() const = 0;
  virtual std::size_t trailer_bytes() const = 0;
  // Writes the trailer, and encrypts the content if that is what the seal does.
  virtual void seal(const SealContext& context, std::span<std::uint8_t> datagram) const = 0;
  // Undoes seal(). kRefused: somebody else has sealed or changed it, or for another receiver; the
  // content is then undefined.
  virtual Status open(const SealContext& context, std::span<std::uint8_t> datagram) const = 0;

 protected:
  ~DatagramSeal() = default;
};

// CRC-32 over the datagram and the context: for loopback, recordings, and machines without a
// cryptographic library.
class PlainSeal final : public DatagramSeal {
 public:
  Protection protection() const override { return Protection::kChecksum; }
  std::size_t trailer_bytes() const override { return 4; }
  void seal(const SealContext& context, std::span<std::uint8_t> datagram) const override;
  Status open(const SealContext& context, std::span<std::uint8_t> datagram) const override;
};
inline constexpr PlainSeal kPlainSeal;

}  // namespace ivfm
