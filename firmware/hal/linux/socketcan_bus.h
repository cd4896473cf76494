// Port: a CAN interface of the Linux kernel (SocketCAN: can0, vcan0).
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "firmware/hal/can_bus.h"

namespace ivfm {

// Non-blocking; reopens the interface by itself when it went away. No heap after open().
class SocketCanBus final : public CanBus {
 public:
  SocketCanBus() = default;
  ~SocketCanBus() { close_now(); }
  SocketCanBus(const SocketCanBus&) = delete;
  SocketCanBus& operator=(const SocketCanBus&) = delete;

  // Opens `interface`. kInvalidArgument: its name; kUnsupported: a kernel without CAN;
  // kUnavailable: no such interface, or it is down; kIoError. `error` says it in words.
  Status open(std::string_view interface, std::string& error);

  // Error frames of the controller (bus off, no acknowledgement, ...) are kUnavailable and counted.
  Result<CanFrame> receive() override;
  Status send(const CanFrame& frame) override;

  int poll_fd() const { return fd_; }
  std::uint32_t error_frames() const { return error_frames_; }

 private:
  Status open_socket();
  Status on_error(int code);
  void close_now();

  std::array<char, 16> interface_{};
  int fd_ = -1;
  std::uint64_t retry_us_ = 0;
  std::uint32_t error_frames_ = 0;
};

}  // namespace ivfm
