#include "tests/replay/replay_reader.h"

#include <algorithm>

#include "shared/wire/byte_reader.h"
#include "shared/wire/crc.h"

namespace ivfm::replay {

void ReplayReader::fail(Status status) {
  if (ok(status_)) status_ = status;
  size_ = position_ = 0;
}

bool ReplayReader::fetch(std::span<std::uint8_t> out) {
  if (ok(status_) && source_.read(out) == out.size()) return true;
  fail(Status::kTruncated);
  return false;
}

// Each block's checksum goes on from the one before it, so that none can be lost or moved.
bool ReplayReader::next_block() {
  std::array<std::uint8_t, kBlockHeadBytes> head{};
  if (!ok(status_) || ended_ || !fetch(head)) return false;
  ByteReader fields(head);
  const std::size_t size = fields.u16();
  const std::uint32_t crc = fields.u32();
  if (size > kMaxBlockBytes) {
    fail(Status::kCorrupt);
    return false;
  }
  const std::span<std::uint8_t> content = std::span(block_).first(size);
  if (size > 0 && !fetch(content)) return false;
  crc_ = crc32(content, crc_);
  std::uint8_t more = 0;
  ended_ = size == 0;
  if (crc != crc_ || (ended_ && source_.read({&more, 1}) != 0)) {
    fail(Status::kCorrupt);
    return false;
  }
  size_ = size;
  position_ = 0;
  return !ended_;
}

bool ReplayReader::at_end() {
  if (position_ < size_) return false;
  return !next_block();
}

std::uint8_t ReplayReader::u8() {
  if (position_ == size_ && !next_block()) {
    fail(Status::kTruncated);
    return 0;
  }
  return block_[position_++];
}

std::uint64_t ReplayReader::varint() {
  std::uint64_t value = 0;
  for (unsigned shift = 0; shift < 70; shift += 7) {
    const std::uint8_t byte = u8();
    if (shift == 63 && byte > 1) break;
    value |= std::uint64_t{byte & 0x7fu} << shift;
    if ((byte & 0x80u) == 0) return value;
  }
  fail(Status::kCorrupt);
  return 0;
}

std::int64_t ReplayReader::signed_varint() {
  const std::uint64_t folded = varint();
  return static_cast<std::int64_t>((folded >> 1) ^ (0 - (folded & 1)));
}

void ReplayReader::bytes(std::span<std::uint8_t> out) {
  for (std::uint8_t& byte : out) byte = u8();
}

Status ReplayReader::read_header(Header& header) {
  std::array<std::uint8_t, kMagic.size() + 2> head{};
  if (!fetch(head)) return status_;
  if (!std::equal(kMagic.begin(), kMagic.end(), head.begin())) {
    fail(Status::kCorrupt);
    return status_;
  }
  if ((head[8] | head[9] << 8) != kVersion) {
    fail(Status::kUnsupported);
    return status_;
  }
  crc_ = crc32(head);
  const std::uint8_t subject = u8(), profile = u8();
  for_each_setting(header.config, [this](auto& setting) {
    from_stored(static_cast<std::int32_t>(signed_varint()), setting);
  });
  const bool known = (subject == 1 || subject == 2) && profile <= 2;
  const ExplorerConfig& explorer = header.config.explorer;
  const bool sane = explorer.pool >= 1 && explorer.pool <= kMaxPool &&
                    explorer.robot_radius_um >= 0 && explorer.robot_radius_um < 8 * 15'625 * 4 &&
                    explorer.fusion.footprint.kind <= VisitFootprint::Kind::kTrapezoid;
  if (!known || !sane) fail(Status::kCorrupt);
  header.subject = static_cast<Subject>(subject);
  header.profile = static_cast<ProfileId>(profile);
  return status_;
}

}  // namespace ivfm::replay
