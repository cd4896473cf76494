#include "tests/replay/replay_ports.h"

namespace ivfm::replay {

void StepInput::read(ReplayReader& reader) {
  now_us += static_cast<TimeUs>(reader.signed_varint());
  serial_size = serial_taken = frame_count = frames_taken = datagrams_size = datagrams_taken = 0;
  const std::uint8_t parts = reader.u8();
  if (parts > step_part::kAll) reader.fail(Status::kCorrupt);
  if (parts & step_part::kSerial) read_serial(reader);
  if (parts & step_part::kCan) read_can(reader);
  if (parts & step_part::kDatagrams) read_datagrams(reader);
  if (parts & step_part::kStatuses) read_statuses(reader);
}

void StepInput::read_serial(ReplayReader& reader) {
  const std::uint64_t size = reader.varint();
  if (size > serial.size()) return reader.fail(Status::kCorrupt);
  reader.bytes(std::span(serial).first(static_cast<std::size_t>(size)));
  serial_size = static_cast<std::size_t>(size);
}

void StepInput::read_can(ReplayReader& reader) {
  const std::uint64_t count = reader.varint();
  if (count > frames.size()) return reader.fail(Status::kCorrupt);
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint8_t tag = reader.u8();
    const std::size_t slot = tag & static_cast<std::uint8_t>(~kNewSlot);
    if (slot >= kCanSlots) return reader.fail(Status::kCorrupt);
    CanFrame& frame = history_.at(slot);
    if (tag & kNewSlot) {
      const std::uint8_t low = reader.u8(), high = reader.u8(), size = reader.u8();
      frame = {};
      frame.id = static_cast<std::uint16_t>(low | (high & 7u) << 8);
      frame.size = size & static_cast<std::uint8_t>(~kRemoteFlag);
      frame.remote = (size & kRemoteFlag) != 0;
      if (frame.size > 8) {
        frame = {};
        return reader.fail(Status::kCorrupt);
      }
    }
    const std::uint8_t changed = reader.u8();
    for (unsigned b = 0; b < frame.data.size(); ++b) {
      if ((changed >> b & 1u) == 0) continue;
      const std::uint8_t value = reader.u8();
      if (b < frame.size) frame.data[b] = value;
    }
    frames[frame_count++] = frame;
  }
}

void StepInput::read_datagrams(ReplayReader& reader) {
  const std::uint64_t size = reader.varint();
  if (size > datagrams.size()) return reader.fail(Status::kCorrupt);
  reader.bytes(std::span(datagrams).first(static_cast<std::size_t>(size)));
  datagrams_size = static_cast<std::size_t>(size);
}

void StepInput::read_statuses(ReplayReader& reader) {
  for_each_status(statuses, [&reader](Status& status) {
    const std::uint8_t code = reader.u8();
    if (code > static_cast<std::uint8_t>(Status::kRefused)) return reader.fail(Status::kCorrupt);
    status = static_cast<Status>(code);
  });
}

Result<std::size_t> ReplaySerialPort::read(std::span<std::uint8_t> buffer) {
  const std::size_t size = std::min(buffer.size(), input_.serial_size - input_.serial_taken);
  if (size == 0 && !ok(input_.statuses.serial_read)) return input_.statuses.serial_read;
  std::copy_n(input_.serial.begin() + static_cast<std::ptrdiff_t>(input_.serial_taken), size,
              buffer.begin());
  input_.serial_taken += size;
  return size;
}

Status ReplaySerialPort::write(std::span<const std::uint8_t> bytes) {
  hash_.add_bytes(bytes);
  return input_.statuses.serial_write;
}

Status ReplaySerialPort::set_motor(bool on) {
  hash_.add(static_cast<std::uint8_t>(on));
  return input_.statuses.serial_write;
}

Result<CanFrame> ReplayCanBus::receive() {
  if (input_.frames_taken < input_.frame_count) return input_.frames[input_.frames_taken++];
  return ok(input_.statuses.can_receive) ? Status::kEmpty : input_.statuses.can_receive;
}

Status ReplayCanBus::send(const CanFrame& frame) {
  hash_.add(frame.id);
  hash_.add(frame.size);
  hash_.add_bytes(frame.data);
  ++sent_;
  return input_.statuses.can_send;
}

Result<std::size_t> ReplayRadio::receive(std::span<std::uint8_t> buffer) {
  const std::size_t left = input_.datagrams_size - input_.datagrams_taken;
  const auto next = input_.datagrams.begin() + static_cast<std::ptrdiff_t>(input_.datagrams_taken);
  const std::size_t size = left < 2 ? 0 : static_cast<std::size_t>(next[0] | next[1] << 8);
  if (left < 2 || size > left - 2) {
    return ok(input_.statuses.radio_receive) ? Status::kEmpty : input_.statuses.radio_receive;
  }
  input_.datagrams_taken += size + 2;
  if (size > buffer.size()) return Status::kTruncated;
  std::copy_n(next + 2, size, buffer.begin());
  return size;
}

Status ReplayRadio::send(std::span<const std::uint8_t> datagram) {
  hash_.add_bytes(datagram);
  return Status::kOk;
}

}  // namespace ivfm::replay
