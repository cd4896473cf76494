// The agent's ports while it is recorded: pass everything through and note what it receives.
#pragma once

#include <vector>

#include "tests/replay/replay_writer.h"

namespace ivfm::replay {

// What the agent receives in one step goes into one record. What is beyond a step's limits waits.
class PortRecorder {
 public:
  PortRecorder(ReplayWriter& writer, SerialPort& serial, CanBus& can, DatagramSocket& radio)
      : writer_(writer), serial_(*this, serial), can_(*this, can), radio_(*this, radio) {}

  SerialPort& serial() { return serial_; }
  CanBus& can() { return can_; }
  DatagramSocket& radio() { return radio_; }

  // Writes what was received in the step at `now_us`.
  void end_step(TimeUs now_us) {
    writer_.step(now_us, bytes_, frames_, datagrams_, statuses_);
    bytes_.clear();
    frames_.clear();
    datagrams_.clear();
    statuses_ = {};
  }

 private:
  struct Serial final : SerialPort {
    Serial(PortRecorder& r, SerialPort& p) : recorder(r), port(p) {}
    Result<std::size_t> read(std::span<std::uint8_t> buffer) override {
      const std::size_t room = kMaxSerialBytes - recorder.bytes_.size();
      const auto got = port.read(buffer.first(std::min(buffer.size(), room)));
      if (!got.ok()) recorder.statuses_.serial_read = got.status();
      for (std::size_t i = 0; got.ok() && i < *got; ++i) recorder.bytes_.push_back(buffer[i]);
      return got;
    }
    Status write(std::span<const std::uint8_t> bytes) override { return note(port.write(bytes)); }
    Status set_motor(bool on) override { return note(port.set_motor(on)); }
    Status note(Status status) {
      if (!ok(status)) recorder.statuses_.serial_write = status;
      return status;
    }
    PortRecorder& recorder;
    SerialPort& port;
  };
  struct Can final : CanBus {
    Can(PortRecorder& r, CanBus& p) : recorder(r), port(p) {}
    Result<CanFrame> receive() override {
      if (recorder.frames_.size() == kMaxCanFrames) return Status::kEmpty;
      const auto frame = port.receive();
      if (frame.ok()) {
        recorder.frames_.push_back(*frame);
      } else if (frame.status() != Status::kEmpty) {
        recorder.statuses_.can_receive = frame.status();
      }
      return frame;
    }
    Status send(const CanFrame& frame) override {
      const Status status = port.send(frame);
      if (!ok(status)) recorder.statuses_.can_send = status;
      return status;
    }
    PortRecorder& recorder;
    CanBus& port;
  };
  struct Radio final : DatagramSocket {
    Radio(PortRecorder& r, DatagramSocket& p) : recorder(r), port(p) {}
    Result<std::size_t> receive(std::span<std::uint8_t> buffer) override {
      if (recorder.datagrams_.size() + 2 + buffer.size() > kMaxDatagramBytes) return Status::kEmpty;
      const auto size = port.receive(buffer);
      if (size.ok()) {
        recorder.datagrams_.push_back(static_cast<std::uint8_t>(*size));
        recorder.datagrams_.push_back(static_cast<std::uint8_t>(*size >> 8));
        for (std::size_t i = 0; i < *size; ++i) recorder.datagrams_.push_back(buffer[i]);
      }
      return size;
    }
    Status send(std::span<const std::uint8_t> datagram) override { return port.send(datagram); }
    PortRecorder& recorder;
    DatagramSocket& port;
  };

  ReplayWriter& writer_;
  Serial serial_;
  Can can_;
  Radio radio_;
  std::vector<std::uint8_t> bytes_, datagrams_;
  std::vector<CanFrame> frames_;
  PortStatuses statuses_;
};

}  // namespace ivfm::replay
