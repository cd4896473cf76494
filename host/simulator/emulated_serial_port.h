// A serial port with an emulated RPLIDAR at its far end, in process and without an operating
// system: for tests and for replaying recordings through the core's own decoder.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <span>

#include "firmware/hal/serial_port.h"
#include "host/simulator/rplidar_emulator.h"

namespace ivfm::host {

class EmulatedSerialPort final : public SerialPort {
 public:
  explicit EmulatedSerialPort(RplidarEmulator& emulator) : emulator_(emulator) {}

  // The time at which the following calls happen.
  void set_now(TimeUs now_us) { now_us_ = now_us; }

  Result<std::size_t> read(std::span<std::uint8_t> buffer) override {
    const auto due = emulator_.transmit(now_us_);
    line_.insert(line_.end(), due.begin(), due.end());
    const std::size_t size = std::min(buffer.size(), line_.size());
    const auto end = line_.begin() + static_cast<std::ptrdiff_t>(size);
    std::copy(line_.begin(), end, buffer.begin());
    line_.erase(line_.begin(), end);
    return size;
  }
  Status write(std::span<const std::uint8_t> bytes) override {
    emulator_.receive(bytes, now_us_);
    return Status::kOk;
  }
  Status set_motor(bool on) override {
    emulator_.set_motor(on, now_us_);
    return Status::kOk;
  }

 private:
  RplidarEmulator& emulator_;
  TimeUs now_us_ = 0;
  std::deque<std::uint8_t> line_;
};

}  // namespace ivfm::host
