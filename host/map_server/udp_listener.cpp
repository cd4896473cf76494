#include "host/map_server/udp_listener.h"

#include <netdb.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <stdexcept>

namespace ivfm::host {
namespace {

struct FreeAddresses {
  void operator()(addrinfo* list) const { ::freeaddrinfo(list); }
};

bool is_port(const std::string& text) {
  return !text.empty() && text.size() <= 5 &&
         text.find_first_not_of("0123456789") == std::string::npos && std::stoi(text) <= 65535;
}

std::unique_ptr<addrinfo, FreeAddresses> resolve(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  std::string host = colon == std::string::npos ? "" : address.substr(0, colon);
  const std::string port = colon == std::string::npos ? "" : address.substr(colon + 1);
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') {
    host = host.substr(1, host.size() - 2);
  }
  if (host.empty() || !is_port(port)) {
    throw std::runtime_error("--listen '" + address +
                             "' is not HOST:PORT with a port from 0 to 65535");
  }
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_DGRAM;
  hints.ai_flags = AI_PASSIVE;
  addrinfo* found = nullptr;
  if (const int error = ::getaddrinfo(host.c_str(), port.c_str(), &hints, &found); error != 0) {
    throw std::runtime_error("--listen '" + address + "': " + ::gai_strerror(error));
  }
  return std::unique_ptr<addrinfo, FreeAddresses>(found);
}

}  // namespace

UdpListener::UdpListener(const std::string& address) {
  const auto found = resolve(address);
  fd_ = ::socket(found->ai_family, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd_ < 0 || ::bind(fd_, found->ai_addr, found->ai_addrlen) != 0) {
    const int error = errno;
    if (fd_ >= 0) ::close(fd_);
    throw std::runtime_error(
        "cannot listen on UDP " + address + ": " +
        (error == EADDRINUSE ? "another program uses that port" : std::strerror(error)));
  }
  const int receive_buffer_bytes = 4 << 20;  // bursts of many robots; the system may give less
  ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer_bytes, sizeof receive_buffer_bytes);
  local_.size = sizeof local_.storage;
  ::getsockname(fd_, reinterpret_cast<sockaddr*>(&local_.storage), &local_.size);
}

UdpListener::~UdpListener() { ::close(fd_); }

void UdpListener::wait(int timeout_ms) {
  pollfd waiting{fd_, POLLIN, 0};
  ::poll(&waiting, 1, timeout_ms);
}

std::optional<std::pair<std::size_t, PeerAddress>> UdpListener::receive(
    std::span<std::uint8_t> buffer) {
  PeerAddress from;
  from.size = sizeof from.storage;
  const ssize_t size = ::recvfrom(fd_, buffer.data(), buffer.size(), 0,
                                  reinterpret_cast<sockaddr*>(&from.storage), &from.size);
  if (size < 0) return std::nullopt;
  return std::pair(static_cast<std::size_t>(size), from);
}

void UdpListener::send(const PeerAddress& to, std::span<const std::uint8_t> datagram) {
  static_cast<void>(::sendto(fd_, datagram.data(), datagram.size(), MSG_NOSIGNAL,
                             reinterpret_cast<const sockaddr*>(&to.storage), to.size));
}

}  // namespace ivfm::host
