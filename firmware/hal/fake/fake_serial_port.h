// A serial port for tests: bytes go in and out by hand, errors on demand.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "firmware/hal/serial_port.h"

namespace ivfm {

class FakeSerialPort final : public SerialPort {
 public:
  Result<std::size_t> read(std::span<std::uint8_t> buffer) override {
    if (!ok(status)) return status;
    const std::size_t size = std::min(buffer.size(), incoming.size());
    std::copy_n(incoming.begin(), size, buffer.begin());
    incoming.erase(incoming.begin(), incoming.begin() + static_cast<std::ptrdiff_t>(size));
    return size;
  }
  Status write(std::span<const std::uint8_t> bytes) override {
    if (!ok(status)) return status;
    written.emplace_back(bytes.begin(), bytes.end());
    return Status::kOk;
  }
  Status set_motor(bool on) override {
    if (!ok(status)) return status;
    motor_on = on;
    return Status::kOk;
  }
  void feed(std::span<const std::uint8_t> bytes) {
    incoming.insert(incoming.end(), bytes.begin(), bytes.end());
  }

  std::deque<std::uint8_t> incoming;               // what read() will deliver
  std::vector<std::vector<std::uint8_t>> written;  // one entry a write()
  Status status = Status::kOk;                     // what every call answers
  bool motor_on = false;
};

}  // namespace ivfm
