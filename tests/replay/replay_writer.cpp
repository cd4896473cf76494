#include "tests/replay/replay_writer.h"

#include "shared/wire/crc.h"

namespace ivfm::replay {

namespace {

std::uint64_t folded(std::int64_t value) {
  return (static_cast<std::uint64_t>(value) << 1) ^ static_cast<std::uint64_t>(value >> 63);
}

}  // namespace

ReplayWriter::ReplayWriter(const Header& header) : file_(kMagic.begin(), kMagic.end()) {
  file_.push_back(kVersion & 0xff);
  file_.push_back(kVersion >> 8);
  crc_ = crc32(file_);
  u8(static_cast<std::uint8_t>(header.subject));
  u8(static_cast<std::uint8_t>(header.profile));
  for_each_setting(header.config,
                   [this](const auto& setting) { signed_varint(to_stored(setting)); });
}

void ReplayWriter::step(TimeUs now_us, std::span<const std::uint8_t> serial,
                        std::span<const CanFrame> frames, std::span<const std::uint8_t> datagrams,
                        const PortStatuses& statuses) {
  signed_varint(static_cast<std::int64_t>(now_us - now_us_));
  now_us_ = now_us;
  const bool new_statuses = !(statuses == statuses_);
  u8(static_cast<std::uint8_t>(
      (serial.empty() ? 0 : step_part::kSerial) | (frames.empty() ? 0 : step_part::kCan) |
      (datagrams.empty() ? 0 : step_part::kDatagrams) | (new_statuses ? step_part::kStatuses : 0)));
  if (!serial.empty()) {
    varint(serial.size());
    bytes(serial);
  }
  if (!frames.empty()) {
    varint(frames.size());
    for (const CanFrame& f : frames) frame(f);
  }
  if (!datagrams.empty()) {
    varint(datagrams.size());
    bytes(datagrams);
  }
  if (new_statuses) {
    for_each_status(statuses, [this](Status status) { u8(static_cast<std::uint8_t>(status)); });
    statuses_ = statuses;
  }
}

void ReplayWriter::frame(const CanFrame& frame) {
  std::size_t slot = history_.find(frame);
  if (slot == kCanSlots) {
    slot = history_.take();
    u8(static_cast<std::uint8_t>(slot | kNewSlot));
    u8(static_cast<std::uint8_t>(frame.id));
    u8(static_cast<std::uint8_t>(frame.id >> 8));
    u8(static_cast<std::uint8_t>(frame.size | (frame.remote ? kRemoteFlag : 0)));
    CanFrame fresh;
    fresh.id = frame.id;
    fresh.size = frame.size;
    fresh.remote = frame.remote;
    history_.at(slot) = fresh;
  } else {
    u8(static_cast<std::uint8_t>(slot));
  }
  const CanFrame& known = history_.at(slot);
  unsigned changed = 0;
  for (unsigned b = 0; b < 8; ++b) changed |= (known.data[b] != frame.data[b] ? 1u : 0u) << b;
  u8(static_cast<std::uint8_t>(changed));
  for (unsigned b = 0; b < 8; ++b) {
    if (changed >> b & 1u) u8(frame.data[b]);
  }
  history_.at(slot) = frame;
}

void ReplayWriter::start(const Pose& start, Point window_center) {
  call(Call::kStart);
  pose(start);
  pose({window_center, {}});
}

void ReplayWriter::fuse(const Pose& at, const Scan& scan, bool count_visits) {
  call(Call::kFuse);
  pose(at);
  u8(count_visits ? 1 : 0);
  varint(scan.size);
  std::int64_t bearing = 0, range = 0;
  for (const ScanPoint& point : scan.points()) {
    signed_varint(point.bearing.raw() - bearing);
    varint(folded(point.range_mm - range) << 2 | static_cast<std::uint64_t>(point.echo));
    bearing = point.bearing.raw();
    range = point.range_mm;
  }
}

void ReplayWriter::decide(const Pose& at) {
  call(Call::kDecide);
  pose(at);
}

void ReplayWriter::pose(const Pose& pose) {
  signed_varint(pose.position.x_um);
  signed_varint(pose.position.y_um);
  varint(pose.heading.raw());
}

std::vector<std::uint8_t> ReplayWriter::finish() {
  if (!block_.empty()) end_block();
  end_block();  // an empty one: the end
  return file_;
}

void ReplayWriter::u8(std::uint8_t value) {
  block_.push_back(value);
  if (block_.size() == kMaxBlockBytes) end_block();
}

void ReplayWriter::varint(std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) u8(static_cast<std::uint8_t>(value | 0x80));
  u8(static_cast<std::uint8_t>(value));
}

void ReplayWriter::signed_varint(std::int64_t value) { varint(folded(value)); }

void ReplayWriter::bytes(std::span<const std::uint8_t> bytes) {
  for (const std::uint8_t byte : bytes) u8(byte);
}

void ReplayWriter::end_block() {
  crc_ = crc32(block_, crc_);
  const auto size = static_cast<unsigned>(block_.size());
  for (const unsigned byte : {size, size >> 8, crc_, crc_ >> 8, crc_ >> 16, crc_ >> 24}) {
    file_.push_back(static_cast<std::uint8_t>(byte));
  }
  file_.insert(file_.end(), block_.begin(), block_.end());
  block_.clear();
}

}  // namespace ivfm::replay
