// The envelope of every datagram between robot and map server (FORMAT.md, "Envelope").
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/status/status.h"

namespace ivfm {

// The header stays readable when protection 1 (authenticated encryption) arrives: it will be the
// associated data, the body the ciphertext, and the 16-byte tag takes the place of the CRC-32.
inline constexpr std::uint8_t kDatagramMagic = 0x49;  // 'I'
inline constexpr std::uint8_t kWireVersion = 1;
inline constexpr std::size_t kDatagramHeaderBytes = 13;
inline constexpr std::size_t kDatagramCrcBytes = 4;
inline constexpr std::size_t kDatagramTagBytes = 16;
inline constexpr std::size_t kMaxBodyBytes = 1160;
// Below 1,200 bytes with either trailer.
inline constexpr std::size_t kMaxDatagramBytes =
    kDatagramHeaderBytes + kMaxBodyBytes + kDatagramTagBytes;
static_assert(kMaxDatagramBytes < 1200);
// What IPv4 and UDP add to each datagram; counted in every traffic figure.
inline constexpr std::size_t kUdpIpOverheadBytes = 28;

// What the body is. Bit 7: from the server to a robot, so a reflected datagram is never taken.
enum class MessageKind : std::uint8_t {
  kMapUpdate = 0x01,
  kAcknowledgement = 0x02,
  kHello = 0x03,
  kStatus = 0x04,
  kFound = 0x05,
  kServerMapUpdate = 0x81,
  kServerAcknowledgement = 0x82,
  kCommand = 0x83,
};

constexpr bool is_from_server(MessageKind kind) {
  return (static_cast<unsigned>(kind) & 0x80u) != 0;
}

struct DatagramHeader {
  std::uint16_t robot = 0;     // 1 .. 65535: the robot that sends, or is addressed
  std::uint32_t epoch = 0;     // the sender's boot epoch: grows with every start of the sender
  std::uint32_t sequence = 0;  // the sender's, from 1 in every epoch, never repeated
  MessageKind kind = MessageKind::kMapUpdate;
  constexpr bool operator==(const DatagramHeader&) const = default;
};

// The place of the body inside a buffer of kMaxDatagramBytes: write it there, then call
// seal_datagram().
constexpr std::span<std::uint8_t> body_of(std::span<std::uint8_t> buffer) {
  return buffer.subspan(kDatagramHeaderBytes, kMaxBodyBytes);
}

// Completes the datagram around the `body_size` bytes already in body_of(buffer); returns its size.
// kInvalidArgument: buffer shorter than kMaxDatagramBytes, body too long, or robot id 0.
Result<std::size_t> seal_datagram(const DatagramHeader& header, std::size_t body_size,
                                  std::span<std::uint8_t> buffer);

struct OpenedDatagram {
  DatagramHeader header;
  std::span<const std::uint8_t> body;
};

// Checks the envelope. kTruncated: shorter than an envelope; kOutOfRange: longer than a datagram
// may be; kUnsupported: another version, protection or kind; kCorrupt: wrong magic or checksum, or
// robot id 0.
Result<OpenedDatagram> open_datagram(std::span<const std::uint8_t> datagram);

}  // namespace ivfm
