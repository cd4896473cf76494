#include "shared/wire/datagram.h"

#include "shared/wire/byte_reader.h"
#include "shared/wire/byte_writer.h"
#include "shared/wire/crc.h"

namespace ivfm {
namespace {

constexpr std::uint8_t kProtectionCrc = 0;
constexpr std::uint8_t kVersionByte = (kWireVersion << 4) | kProtectionCrc;

constexpr bool is_known(MessageKind kind) {
  switch (kind) {
    case MessageKind::kMapUpdate:
    case MessageKind::kAcknowledgement:
    case MessageKind::kHello:
    case MessageKind::kStatus:
    case MessageKind::kFound:
    case MessageKind::kServerMapUpdate:
    case MessageKind::kServerAcknowledgement:
    case MessageKind::kCommand: return true;
  }
  return false;
}

}  // namespace

Result<std::size_t> seal_datagram(const DatagramHeader& header, std::size_t body_size,
                                  std::span<std::uint8_t> buffer) {
  if (buffer.size() < kMaxDatagramBytes || body_size > kMaxBodyBytes || header.robot == 0) {
    return Status::kInvalidArgument;
  }
  ByteWriter writer(buffer);
  writer.u8(kDatagramMagic);
  writer.u8(kVersionByte);
  writer.u16(header.robot);
  writer.u32(header.epoch);
  writer.u32(header.sequence);
  writer.u8(static_cast<std::uint8_t>(header.kind));
  writer.skip(body_size);
  writer.u32(crc32(buffer.first(writer.size())));
  return writer.size();
}

Result<OpenedDatagram> open_datagram(std::span<const std::uint8_t> datagram) {
  if (datagram.size() < kDatagramHeaderBytes + kDatagramCrcBytes) return Status::kTruncated;
  if (datagram.size() > kMaxDatagramBytes) return Status::kOutOfRange;
  const auto covered = datagram.first(datagram.size() - kDatagramCrcBytes);
  ByteReader reader(covered);
  if (reader.u8() != kDatagramMagic) return Status::kCorrupt;
  if (reader.u8() != kVersionByte) return Status::kUnsupported;
  if (ByteReader(datagram.last(kDatagramCrcBytes)).u32() != crc32(covered)) return Status::kCorrupt;
  OpenedDatagram opened;
  opened.header.robot = reader.u16();
  opened.header.epoch = reader.u32();
  opened.header.sequence = reader.u32();
  opened.header.kind = static_cast<MessageKind>(reader.u8());
  if (opened.header.robot == 0) return Status::kCorrupt;
  if (!is_known(opened.header.kind)) return Status::kUnsupported;
  opened.body = reader.bytes(reader.remaining());
  if (opened.body.size() > kMaxBodyBytes) return Status::kOutOfRange;
  return opened;
}

}  // namespace ivfm
