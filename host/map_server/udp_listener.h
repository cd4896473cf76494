// The map server's socket: one UDP port for all robots.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "host/map_server/map_server.h"
#include "host/map_server/peer_address.h"

namespace ivfm::host {

class UdpListener final : public DatagramSender {
 public:
  // `address`: HOST:PORT or [IPV6]:PORT; port 0 takes a free one. Throws std::runtime_error with
  // one sentence when it is no address or the port is taken.
  explicit UdpListener(const std::string& address);
  ~UdpListener();
  UdpListener(const UdpListener&) = delete;
  UdpListener& operator=(const UdpListener&) = delete;

  // The address in use, with the real port.
  std::string text() const { return local_.text(); }
  int fd() const { return fd_; }  // to wait on with poll()
  // Whether only programs of this machine reach it.
  bool is_loopback() const { return local_.is_loopback(); }
  // Waits up to `timeout_ms` for a datagram.
  void wait(int timeout_ms);
  // The next datagram's size and sender; nothing when none is waiting. A longer one is cut to
  // buffer.size() bytes.
  std::optional<std::pair<std::size_t, PeerAddress>> receive(std::span<std::uint8_t> buffer);
  // Lossy: what the system does not take is gone, as on a radio.
  void send(const PeerAddress& to, std::span<const std::uint8_t> datagram) override;

 private:
  int fd_ = -1;
  PeerAddress local_;
};

}  // namespace ivfm::host
