// The serial port on Linux: termios, 115200 8N1 raw, motor by DTR, reopened after an unplug.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

#include "firmware/hal/serial_port.h"

namespace ivfm {

// Works on real ttys and on pseudo-terminals. A pseudo-terminal has no modem lines: there,
// set_motor() succeeds and does nothing (the emulator behind it turns its motor on by itself when
// a scan is requested). No heap.
class LinuxSerialPort final : public SerialPort {
 public:
  // `path`: e.g. /dev/ttyUSB0, at most 255 bytes; a longer one never opens.
  explicit LinuxSerialPort(std::string_view path);
  ~LinuxSerialPort();
  LinuxSerialPort(const LinuxSerialPort&) = delete;
  LinuxSerialPort& operator=(const LinuxSerialPort&) = delete;

  // Opens and configures the line; no effect when it is open. read(), write() and set_motor() do
  // it by themselves, this is for start-up, where the reason matters. kUnavailable: no such
  // device; kRefused: no permission, or another program has locked it; kInvalidArgument: not a
  // terminal, or the path is too long; kIoError: anything else. system_error() has the errno.
  Status open();
  bool is_open() const { return fd_ >= 0; }
  int system_error() const { return system_error_; }
  const char* path() const { return path_.data(); }

  Result<std::size_t> read(std::span<std::uint8_t> buffer) override;
  Status write(std::span<const std::uint8_t> bytes) override;
  Status set_motor(bool on) override;

 private:
  Status open_device();
  Status configure();
  Status apply_motor();
  Status fail(Status status);
  Status lose_device(int error);
  void close_device();

  std::array<char, 256> path_{};
  int fd_ = -1;
  int system_error_ = 0;
  bool motor_wanted_ = false;
};

}  // namespace ivfm
