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

void write_window(ByteWriter& writer, const CellRect& window) {
  writer.i24(window.x);
  writer.i24(window.y);
  writer.u16(static_cast<std::uint16_t>(window.width));
  writer.u16(static_cast<std::uint16_t>(window.height));
}

CellRect read_window(ByteReader& reader) {
  CellRect window;
  window.x = reader.i24();
  window.y = reader.i24();
  window.width = reader.u16();
  window.height = reader.u16();
  return window;
}

void write_cursor(ByteWriter& writer, const RestoreCursor& cursor) {
  writer.u8(cursor.layer);
  writer.i24(cursor.tile_y);
  writer.i24(cursor.tile_x);
}

RestoreCursor read_cursor(ByteReader& reader) {
  RestoreCursor cursor;
  cursor.layer = reader.u8();
  cursor.tile_y = reader.i24();
  cursor.tile_x = reader.i24();
  return cursor;
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

// The bitmap without its highest zero bytes.
Result<std::size_t> encode(const Acknowledgement& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  writer.u32(message.newest);
  for (std::uint64_t rest = message.earlier; rest != 0; rest >>= 8) {
    writer.u8(static_cast<std::uint8_t>(rest));
  }
  return finished(writer);
}

Result<Acknowledgement> decode_acknowledgement(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  Acknowledgement message;
  message.newest = reader.u32();
  std::uint8_t byte = 1;
  for (unsigned shift = 0; shift < 64 && reader.remaining() > 0; shift += 8) {
    byte = reader.u8();
    message.earlier |= static_cast<std::uint64_t>(byte) << shift;
  }
  if (const Status status = ending(reader); !ok(status)) return status;
  if (byte == 0) return Status::kCorrupt;
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
  write_window(writer, message.window);
  writer.u8(static_cast<std::uint8_t>((message.resuming ? 1 : 0) | (message.moved_frame ? 2 : 0) |
                                      (message.apart ? 4 : 0) | (message.rough ? 8 : 0)));
  writer.u8(message.name_size);
  for (const char c : message.name()) writer.u8(static_cast<std::uint8_t>(c));
  return finished(writer);
}

Result<Hello> decode_hello(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  Hello message;
  message.cell_um = static_cast<std::int32_t>(reader.u24());
  message.window = read_window(reader);
  const std::uint8_t flags = reader.u8();
  const std::uint8_t name_size = reader.u8();
  const auto name = reader.bytes(name_size);
  if (const Status status = ending(reader); !ok(status)) return status;
  if (name_size > Hello::kMaxName || message.cell_um == 0 || flags > 15) return Status::kCorrupt;
  message.resuming = (flags & 1) != 0;
  message.moved_frame = (flags & 2) != 0;
  message.apart = (flags & 4) != 0;
  message.rough = (flags & 8) != 0;
  for (const std::uint8_t c : name) {
    if (!is_printable(static_cast<char>(c))) return Status::kCorrupt;
    message.name_storage[message.name_size++] = static_cast<char>(c);
  }
  return message;
}

Result<std::size_t> encode(const Welcome& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  writer.u32(message.epoch);
  writer.u8(static_cast<std::uint8_t>((message.knows_epoch ? 1 : 0) | (message.has_cells ? 2 : 0)));
  return finished(writer);
}

Result<Welcome> decode_welcome(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  const std::uint32_t epoch = reader.u32();
  const std::uint8_t flags = reader.u8();
  if (const Status status = ending(reader); !ok(status)) return status;
  if (flags > 3) return Status::kCorrupt;
  return Welcome{epoch, (flags & 1) != 0, (flags & 2) != 0};
}

Result<std::size_t> encode(const RestoreRequest& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  write_window(writer, message.window);
  write_cursor(writer, message.from);
  return finished(writer);
}

Result<RestoreRequest> decode_restore_request(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  RestoreRequest message;
  message.window = read_window(reader);
  message.from = read_cursor(reader);
  if (const Status status = ending(reader); !ok(status)) return status;
  return message;
}

Result<std::size_t> encode(const RestoreHeader& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  write_cursor(writer, message.from);
  write_cursor(writer, message.next);
  return finished(writer);
}

Result<RestoreHeader> decode_restore_header(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  RestoreHeader message;
  message.from = read_cursor(reader);
  message.next = read_cursor(reader);
  if (!reader.ok()) return Status::kTruncated;
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

Result<std::size_t> encode(const RobotPlaces& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  for (const RobotPlace& place : message.places()) {
    writer.u16(place.x);
    writer.u16(place.y);
    writer.u8(place.age_10ms);
  }
  return finished(writer);
}

Result<RobotPlaces> decode_robot_places(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  RobotPlaces message;
  while (reader.remaining() > 0 && message.size < RobotPlaces::kMost) {
    RobotPlace& place = message.storage[message.size++];
    place.x = reader.u16();
    place.y = reader.u16();
    place.age_10ms = reader.u8();
    if (!um_from_float16(place.x).ok() || !um_from_float16(place.y).ok()) return Status::kCorrupt;
  }
  if (const Status status = ending(reader); !ok(status)) return status;
  return message;
}

Result<std::size_t> encode(const MapFrame& message, std::span<std::uint8_t> out) {
  ByteWriter writer(out);
  writer.u32(message.epoch);
  writer.i32(message.frame.position.x_um);
  writer.i32(message.frame.position.y_um);
  writer.u16(message.frame.heading.raw());
  return finished(writer);
}

Result<MapFrame> decode_map_frame(std::span<const std::uint8_t> body) {
  ByteReader reader(body);
  MapFrame message;
  message.epoch = reader.u32();
  message.frame.position.x_um = reader.i32();
  message.frame.position.y_um = reader.i32();
  message.frame.heading = BinaryAngle(reader.u16());
  if (const Status status = ending(reader); !ok(status)) return status;
  return message;
}

}  // namespace ivfm
