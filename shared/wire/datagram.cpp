#include "shared/wire/datagram.h"

#include "shared/wire/byte_reader.h"
#include "shared/wire/byte_writer.h"

namespace ivfm {
namespace {

constexpr std::uint8_t kUnboundBit = 2;

constexpr std::uint8_t version_byte(Protection protection, bool unbound) {
  return static_cast<std::uint8_t>(kWireVersion << 4 | (unbound ? kUnboundBit : 0) |
                                   static_cast<std::uint8_t>(protection));
}

constexpr bool is_known(MessageKind kind) {
  switch (kind) {
    case MessageKind::kMapUpdate:
    case MessageKind::kAcknowledgement:
    case MessageKind::kHello:
    case MessageKind::kStatus:
    case MessageKind::kFound:
    case MessageKind::kRestoreRequest:
    case MessageKind::kServerMapUpdate:
    case MessageKind::kServerAcknowledgement:
    case MessageKind::kCommand:
    case MessageKind::kWelcome:
    case MessageKind::kRestore:
    case MessageKind::kPlaces:
    case MessageKind::kMapFrame: return true;
  }
  return false;
}

}  // namespace

Result<std::size_t> seal_datagram(const DatagramHeader& header, std::size_t body_size,
                                  std::span<std::uint8_t> buffer, const DatagramSeal& seal,
                                  std::uint64_t receiver_boot) {
  if (buffer.size() < kMaxDatagramBytes || body_size > kMaxBodyBytes || header.robot == 0 ||
      header.boot == 0) {
    return Status::kInvalidArgument;
  }
  ByteWriter writer(buffer);
  writer.u8(kDatagramMagic);
  writer.u8(version_byte(seal.protection(), receiver_boot == 0));
  writer.u16(header.robot);
  writer.u32(header.epoch);
  writer.u32(header.sequence);
  writer.u64(header.boot);
  writer.u8(static_cast<std::uint8_t>(header.kind));
  const std::size_t size = kDatagramHeaderBytes + body_size + seal.trailer_bytes();
  seal.seal({is_from_server(header.kind), receiver_boot}, buffer.first(size));
  return size;
}

Result<std::uint16_t> peek_robot(std::span<const std::uint8_t> datagram) {
  if (datagram.size() < kDatagramHeaderBytes) return Status::kTruncated;
  if (datagram.size() > kMaxDatagramBytes) return Status::kOutOfRange;
  ByteReader reader(datagram);
  if (reader.u8() != kDatagramMagic) return Status::kCorrupt;
  if (reader.u8() >> 4 != kWireVersion) return Status::kUnsupported;
  const std::uint16_t robot = reader.u16();
  if (robot == 0) return Status::kCorrupt;
  return robot;
}

Result<OpenedDatagram> open_datagram(std::span<std::uint8_t> datagram, const DatagramSeal& seal,
                                     const SealContext& context) {
  const auto robot = peek_robot(datagram);
  if (!robot.ok()) return robot.status();
  if (datagram.size() < kDatagramHeaderBytes + seal.trailer_bytes()) return Status::kTruncated;
  if (datagram.size() > kDatagramHeaderBytes + kMaxBodyBytes + seal.trailer_bytes()) {
    return Status::kOutOfRange;
  }
  ByteReader reader(datagram.first(datagram.size() - seal.trailer_bytes()));
  reader.u8();
  const std::uint8_t version = reader.u8();
  const bool unbound = (version & kUnboundBit) != 0;
  if (version != version_byte(seal.protection(), unbound)) return Status::kUnsupported;
  const std::uint64_t receiver_boot = unbound ? 0 : context.receiver_boot;
  if (!ok(seal.open({context.from_server, receiver_boot}, datagram))) return Status::kRefused;
  OpenedDatagram opened;
  opened.bound = !unbound;
  opened.header.robot = reader.u16();
  opened.header.epoch = reader.u32();
  opened.header.sequence = reader.u32();
  opened.header.boot = reader.u64();
  opened.header.kind = static_cast<MessageKind>(reader.u8());
  if (opened.header.boot == 0) return Status::kCorrupt;
  if (!is_known(opened.header.kind)) return Status::kUnsupported;
  if (is_from_server(opened.header.kind) != context.from_server) return Status::kCorrupt;
  opened.body = reader.bytes(reader.remaining());
  return opened;
}

}  // namespace ivfm
