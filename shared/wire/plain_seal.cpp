#include "shared/wire/byte_reader.h"
#include "shared/wire/byte_writer.h"
#include "shared/wire/crc.h"
#include "shared/wire/datagram_seal.h"

namespace ivfm {
namespace {

constexpr std::size_t kCrcBytes = 4;

std::uint32_t checksum(const SealContext& context, std::span<const std::uint8_t> covered) {
  std::uint8_t unsent[9];
  ByteWriter writer(unsent);
  writer.u8(context.from_server ? 1 : 0);
  writer.u64(context.receiver_boot);
  return crc32(unsent, crc32(covered));
}

}  // namespace

void PlainSeal::seal(const SealContext& context, std::span<std::uint8_t> datagram) const {
  const auto covered = datagram.first(datagram.size() - kCrcBytes);
  ByteWriter(datagram.last(kCrcBytes)).u32(checksum(context, covered));
}

Status PlainSeal::open(const SealContext& context, std::span<std::uint8_t> datagram) const {
  const auto covered = datagram.first(datagram.size() - kCrcBytes);
  const std::uint32_t sent = ByteReader(datagram.last(kCrcBytes)).u32();
  return sent == checksum(context, covered) ? Status::kOk : Status::kRefused;
}

}  // namespace ivfm
