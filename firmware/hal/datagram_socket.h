// Port: datagrams to and from the map server (UDP).
#pragma once

#include <cstdint>
#include <span>

#include "shared/status/status.h"

namespace ivfm {

// Non-blocking and lossy by nature. Implementations: linux/ (connected UDP), fake/ (tests).
class DatagramSocket {
 public:
  // Receives one datagram into `buffer`, returns its size; a longer one is cut off and reported as
  // kTruncated. kEmpty: none waiting; kUnavailable: no route or refused; kIoError: anything else.
  virtual Result<std::size_t> receive(std::span<std::uint8_t> buffer) = 0;
  // Sends one datagram. kFull, kUnavailable, kIoError; nothing is retried here.
  virtual Status send(std::span<const std::uint8_t> datagram) = 0;

 protected:
  ~DatagramSocket() = default;
};

}  // namespace ivfm
