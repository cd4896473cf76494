// The envelope of every datagram between robot and map server (FORMAT.md, "Envelope").
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/status/status.h"
#include "shared/wire/datagram_seal.h"

namespace ivfm {

inline constexpr std::uint8_t kDatagramMagic = 0x49;  // 'I'
inline constexpr std::uint8_t kWireVersion = 2;
// In the clear: magic, version and protection, robot, epoch, sequence, boot.
inline constexpr std::size_t kSealHeaderBytes = 20;
inline constexpr std::size_t kDatagramHeaderBytes = kSealHeaderBytes + 1;  // and the kind
inline constexpr std::size_t kMaxBodyBytes = 1160;
inline constexpr std::size_t kMaxDatagramBytes =
    kDatagramHeaderBytes + kMaxBodyBytes + kMaxTrailerBytes;
static_assert(kMaxDatagramBytes < 1200);
// What IPv4 and UDP add to each datagram; counted in every traffic figure.
inline constexpr std::size_t kUdpIpOverheadBytes = 28;

// What the body is. Bit 7: from the server to a robot.
enum class MessageKind : std::uint8_t {
  kMapUpdate = 0x01,
  kAcknowledgement = 0x02,
  kHello = 0x03,
  kStatus = 0x04,
  kFound = 0x05,
  kRestoreRequest = 0x06,
  kServerMapUpdate = 0x81,
  kServerAcknowledgement = 0x82,
  kCommand = 0x83,
  kWelcome = 0x84,
  kRestore = 0x85,
  kPlaces = 0x86,
  kMapFrame = 0x87,
};

constexpr bool is_from_server(MessageKind kind) {
  return (static_cast<unsigned>(kind) & 0x80u) != 0;
}

struct DatagramHeader {
  std::uint16_t robot = 0;     // 1 .. 65535: the robot that sends, or is addressed
  std::uint32_t epoch = 0;     // the sender's boot epoch: grows with every start of the sender
  std::uint32_t sequence = 0;  // the sender's, from 1 at every start, never repeated
  std::uint64_t boot = 0;      // drawn at random at every start of the sender; never 0
  MessageKind kind = MessageKind::kMapUpdate;
  constexpr bool operator==(const DatagramHeader&) const = default;
};

// The place of the body inside a buffer of kMaxDatagramBytes: write it there, then call
// seal_datagram().
constexpr std::span<std::uint8_t> body_of(std::span<std::uint8_t> buffer) {
  return buffer.subspan(kDatagramHeaderBytes, kMaxBodyBytes);
}

// Completes the datagram around the `body_size` bytes already in body_of(buffer); returns its size.
// `receiver_boot`: the boot in the receiver's datagrams; 0 when none was received yet.
// kInvalidArgument: buffer shorter than kMaxDatagramBytes, body too long, robot id or boot 0.
Result<std::size_t> seal_datagram(const DatagramHeader& header, std::size_t body_size,
                                  std::span<std::uint8_t> buffer, const DatagramSeal& seal,
                                  std::uint64_t receiver_boot);

// The robot id of a datagram, as anybody could have written it: to find the seal that opens it.
// Codes as open_datagram, but kRefused.
Result<std::uint16_t> peek_robot(std::span<const std::uint8_t> datagram);

struct OpenedDatagram {
  DatagramHeader header;
  bool bound = false;  // the sender knew this start of the receiver: the datagram is no old one
  std::span<const std::uint8_t> body;
};

// Opens a datagram in place. `context`: where it must come from and the receiver's own boot.
// kTruncated: shorter than an envelope; kOutOfRange: longer than a datagram may be; kUnsupported:
// another version, protection or kind; kCorrupt: wrong magic, robot id or boot 0, or a kind of the
// other direction; kRefused: the seal does not open. Its bytes are undefined after an error.
Result<OpenedDatagram> open_datagram(std::span<std::uint8_t> datagram, const DatagramSeal& seal,
                                     const SealContext& context);

}  // namespace ivfm
