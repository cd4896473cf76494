#include "firmware/hal/linux/udp_socket.h"

#include <netdb.h>
#include <netinet/in.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace ivfm {
namespace {

// A name cut out of "HOST:PORT", ended by a zero. False when it is empty or too long.
template <std::size_t kSize>
bool copy_name(std::string_view name, std::array<char, kSize>& out) {
  if (name.empty() || name.size() >= kSize) return false;
  std::copy(name.begin(), name.end(), out.begin());
  out[name.size()] = '\0';
  return true;
}

bool is_port(std::string_view text) {
  if (text.empty() || text.size() > 5) return false;
  std::uint32_t port = 0;
  for (const char c : text) {
    if (c < '0' || c > '9') return false;
    port = port * 10 + static_cast<std::uint32_t>(c - '0');
  }
  return port >= 1 && port <= 65535;
}

Status status_of(int error) {
  switch (error) {
    case EAGAIN:
    case ENOBUFS: return Status::kFull;
    case ECONNREFUSED:
    case ENETUNREACH:
    case EHOSTUNREACH:
    case ENETDOWN:
    case EHOSTDOWN:
    case EADDRNOTAVAIL:
    case EPERM: return Status::kUnavailable;
    default: return Status::kIoError;
  }
}

}  // namespace

UdpSocket::UdpSocket(std::string_view peer) { status_ = open(peer); }

UdpSocket::~UdpSocket() {
  if (fd_ >= 0) ::close(fd_);
}

Status UdpSocket::open(std::string_view peer) {
  error_text_ = "not HOST:PORT with a port from 1 to 65535";
  const std::size_t colon = peer.rfind(':');
  if (colon == std::string_view::npos) return Status::kInvalidArgument;
  std::string_view host_text = peer.substr(0, colon);
  const std::string_view port_text = peer.substr(colon + 1);
  if (host_text.size() > 2 && host_text.front() == '[' && host_text.back() == ']') {
    host_text = host_text.substr(1, host_text.size() - 2);
  }
  std::array<char, 256> host;
  std::array<char, 6> port;
  if (!is_port(port_text) || !copy_name(host_text, host) || !copy_name(port_text, port)) {
    return Status::kInvalidArgument;
  }
  if (const Status status = resolve(host.data(), port.data()); !ok(status)) return status;
  fd_ = ::socket(peer_.ss_family, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd_ < 0) {
    error_text_ = std::strerror(errno);
    return Status::kIoError;
  }
  error_text_ = "";
  connect_if_needed();
  return Status::kOk;
}

Status UdpSocket::resolve(const char* host, const char* port) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  const int error = ::getaddrinfo(host, port, &hints, &found);
  if (error != 0) {
    error_text_ = ::gai_strerror(error);
    return Status::kUnavailable;
  }
  peer_size_ = found->ai_addrlen;
  std::memcpy(&peer_, found->ai_addr, peer_size_);
  ::freeaddrinfo(found);
  return Status::kOk;
}

bool UdpSocket::peer_is_loopback() const {
  if (peer_.ss_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(peer_);
    return (ntohl(v4.sin_addr.s_addr) >> 24) == 127;
  }
  const auto& v6 = reinterpret_cast<const sockaddr_in6&>(peer_);
  return peer_.ss_family == AF_INET6 && IN6_IS_ADDR_LOOPBACK(&v6.sin6_addr);
}

// Connecting fails while there is no route; it is tried again with every call.
bool UdpSocket::connect_if_needed() {
  if (!connected_ && fd_ >= 0) {
    connected_ = ::connect(fd_, reinterpret_cast<const sockaddr*>(&peer_), peer_size_) == 0;
  }
  return connected_;
}

Result<std::size_t> UdpSocket::receive(std::span<std::uint8_t> buffer) {
  if (!connect_if_needed()) return Status::kUnavailable;
  const ssize_t size = ::recv(fd_, buffer.data(), buffer.size(), MSG_TRUNC);
  if (size < 0) {
    const int error = errno;
    if (error == EAGAIN || error == EINTR) return Status::kEmpty;
    return status_of(error);
  }
  if (static_cast<std::size_t>(size) > buffer.size()) return Status::kTruncated;
  return static_cast<std::size_t>(size);
}

Status UdpSocket::send(std::span<const std::uint8_t> datagram) {
  if (!connect_if_needed()) return Status::kUnavailable;
  if (::send(fd_, datagram.data(), datagram.size(), MSG_NOSIGNAL) >= 0) return Status::kOk;
  return status_of(errno);
}

}  // namespace ivfm
