// Port: a serial line with a motor enable output (DTR on an RPLIDAR A1).
#pragma once

#include <cstdint>
#include <span>

#include "shared/status/status.h"

namespace ivfm {

// Non-blocking. Implementations: linux/ (termios), fake/ (tests), cortex_m/ (semihosting replay).
class SerialPort {
 public:
  // Reads what is there, at most `buffer.size()` bytes; 0 when nothing is. kUnavailable: the device
  // is gone (unplugged); kIoError: anything else. The port tries to reopen itself on later calls.
  virtual Result<std::size_t> read(std::span<std::uint8_t> buffer) = 0;
  // Writes all of `bytes` or fails. kFull: the line does not drain; kUnavailable, kIoError as
  // above.
  virtual Status write(std::span<const std::uint8_t> bytes) = 0;
  // Turns the lidar's motor on or off. kUnavailable, kIoError as above.
  virtual Status set_motor(bool on) = 0;

 protected:
  ~SerialPort() = default;
};

}  // namespace ivfm
