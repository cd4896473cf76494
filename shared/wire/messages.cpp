#include "shared/wire/messages.h"

#include "shared/wire/byte_reader.h"
#include "shared/wire/byte_writer.h"

namespace ivfm {
namespace {

constexpr bool is_printable(char c) { return c >= ' ' && c <= '~'; }

void write_pose(ByteWriter& writer, const PackedPose& pose) {
  writer.u16(pose.x);
  writer.u16(pose.y);
  writer.u16(pose.heading);
}

PackedPose read_pose(ByteReader& reader) {
  PackedPose pose;
  pose.x = reader.u16();
  pose.y = reader.u16();
  pose.heading = reader.u16();
  return pose;
}

Result<std::size_t> finished(const ByteWriter& writer) {
  if (!writer.ok()) return Status::kFull;
  return writer.size();
}

// Whether the body had exactly the bytes that were read.
Status ending(const ByteReader& reader) {
  if (!reader.ok()) return Status::kTruncated;
  return reader.remaining() == 0 ? Status::kOk : Status::kCorrupt;
}

}  // namespace

Result<std::size_t> encode(const Acknowledgement& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  writer.u32(message.epoch);
  writer.u32(message.newest);
  writer.u64(message.earlier);
  return finished(writer);
}

Result<Acknowledgement> decode_acknowledgement(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  Acknowledgement message;
  message.epoch = reader.u32();
  message.newest = reader.u32();
  message.earlier = reader.u64();
  if (const Status status = ending(reader); !ok(status)) return status;
  return message;
}

void Hello::set_name(std::string_view name) {
  name_size = 0;
  for (const char c : name.substr(0, kMaxName)) {
    name_storage[name_size++] = is_printable(c) ? c : '?';
  }
}

Result<std::size_t> encode(const Hello& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  writer.u24(static_cast<std::uint32_t>(message.cell_um));
  writer.u16(message.window_width);
  writer.u16(message.window_height);
  writer.u8(message.name_size);
  for (const char c : message.name()) writer.u8(static_cast<std::uint8_t>(c));
  return finished(writer);
}

Result<Hello> decode_hello(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  Hello message;
  message.cell_um = static_cast<std::int32_t>(reader.u24());
  message.window_width = reader.u16();
  message.window_height = reader.u16();
  const std::uint8_t name_size = reader.u8();
  const auto name = reader.bytes(name_size);
  if (const Status status = ending(reader); !ok(status)) return status;
  if (name_size > Hello::kMaxName || message.cell_um == 0) return Status::kCorrupt;
  for (const std::uint8_t c : name) {
    if (!is_printable(static_cast<char>(c))) return Status::kCorrupt;
    message.name_storage[message.name_size++] = static_cast<char>(c);
  }
  return message;
}

Result<std::size_t> encode(const RobotStatus& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  write_pose(writer, message.pose);
  writer.u8(message.state);
  writer.u8(message.fault);
  writer.i24(message.goal.x);
  writer.i24(message.goal.y);
  writer.u32(message.uptime_ms);
  writer.u32(message.actions);
  writer.u32(message.distance_mm);
  writer.u32(message.decision_us);
  writer.u32(message.datagrams_sent);
  writer.u32(message.retransmissions);
  return finished(writer);
}

Result<RobotStatus> decode_robot_status(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  RobotStatus message;
  message.pose = read_pose(reader);
  message.state = reader.u8();
  message.fault = reader.u8();
  message.goal.x = reader.i24();
  message.goal.y = reader.i24();
  message.uptime_ms = reader.u32();
  message.actions = reader.u32();
  message.distance_mm = reader.u32();
  message.decision_us = reader.u32();
  message.datagrams_sent = reader.u32();
  message.retransmissions = reader.u32();
  if (const Status status = ending(reader); !ok(status)) return status;
  return message;
}

Result<std::size_t> encode(const FoundReport& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  write_pose(writer, message.pose);
  writer.i32(message.target.x_um);
  writer.i32(message.target.y_um);
  return finished(writer);
}

Result<FoundReport> decode_found_report(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  FoundReport message;
  message.pose = read_pose(reader);
  message.target.x_um = reader.i32();
  message.target.y_um = reader.i32();
  if (const Status status = ending(reader); !ok(status)) return status;
  return message;
}

Result<std::size_t> encode(const Command& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  writer.u8(static_cast<std::uint8_t>(message.code));
  writer.u32(message.revision);
  return finished(writer);
}

Result<Command> decode_command(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  const std::uint8_t code = reader.u8();
  const std::uint32_t revision = reader.u32();
  if (const Status status = ending(reader); !ok(status)) return status;
  if (code < static_cast<std::uint8_t>(CommandCode::kStart) ||
      code > static_cast<std::uint8_t>(CommandCode::kFound)) {
    return Status::kCorrupt;
  }
  return Command{static_cast<CommandCode>(code), revision};
}

}  // namespace ivfm
