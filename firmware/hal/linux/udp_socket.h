// The datagram port on Linux: a non-blocking UDP socket connected to one peer.
#pragma once

#include <sys/socket.h>

#include <cstdint>
#include <span>
#include <string_view>

#include "firmware/hal/datagram_socket.h"

namespace ivfm {

// Resolves its peer once, when constructed: the only moment that may block or use the heap
// (getaddrinfo). A network that goes away and comes back later is fine.
class UdpSocket final : public DatagramSocket {
 public:
  // `peer`: HOST:PORT or [IPV6]:PORT, port 1 .. 65535, e.g. "192.168.1.5:7700" or "server:7700".
  explicit UdpSocket(std::string_view peer);
  ~UdpSocket();
  UdpSocket(const UdpSocket&) = delete;
  UdpSocket& operator=(const UdpSocket&) = delete;

  // kOk: usable; kInvalidArgument: `peer` is not HOST:PORT; kUnavailable: no such host (it is not
  // asked for again); kIoError: no socket.
  Status status() const { return status_; }
  // Says why status() is not kOk, in a few words. Never null.
  const char* error_text() const { return error_text_; }

  int fd() const { return fd_; }  // to wait on with poll(); -1 when not usable

  // Whether the peer is on this machine.
  bool peer_is_loopback() const;

  Result<std::size_t> receive(std::span<std::uint8_t> buffer) override;
  Status send(std::span<const std::uint8_t> datagram) override;

 private:
  Status open(std::string_view peer);
  Status resolve(const char* host, const char* port);
  bool connect_if_needed();

  int fd_ = -1;
  bool connected_ = false;
  Status status_ = Status::kOk;
  const char* error_text_ = "";
  sockaddr_storage peer_{};
  socklen_t peer_size_ = 0;
};

}  // namespace ivfm
