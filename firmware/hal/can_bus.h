// Port: a classic CAN 2.0 bus.
#pragma once

#include <array>
#include <cstdint>

#include "shared/status/status.h"

namespace ivfm {

// One classic frame with an 11-bit identifier. Data beyond `size` is zero.
struct CanFrame {
  std::uint16_t id = 0;   // 0 .. 0x7ff
  std::uint8_t size = 0;  // 0 .. 8
  bool remote = false;    // a remote transmission request (no data)
  std::array<std::uint8_t, 8> data{};
  constexpr bool operator==(const CanFrame&) const = default;
};

// Non-blocking. Implementations: linux/ (SocketCAN, socketcand client), fake/ (tests).
class CanBus {
 public:
  // The next received frame. kEmpty: none waiting; kUnavailable: bus off, interface down or server
  // gone (the port tries to come back on later calls); kIoError: anything else.
  virtual Result<CanFrame> receive() = 0;
  // Queues a frame. kFull: the transmit queue is full; kUnavailable, kIoError as above.
  virtual Status send(const CanFrame& frame) = 0;

 protected:
  ~CanBus() = default;
};

}  // namespace ivfm
