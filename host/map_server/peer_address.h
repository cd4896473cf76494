// The address of a robot's socket, opaque but for comparing and printing.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cstring>
#include <string>

namespace ivfm::host {

struct PeerAddress {
  sockaddr_storage storage{};
  socklen_t size = 0;

  bool operator==(const PeerAddress& other) const {
    return size == other.size && std::memcmp(&storage, &other.storage, size) == 0;
  }
  bool is_loopback() const {
    if (storage.ss_family == AF_INET) {
      const auto* v4 = reinterpret_cast<const sockaddr_in*>(&storage);
      return (ntohl(v4->sin_addr.s_addr) >> 24) == 127;
    }
    const auto* v6 = reinterpret_cast<const sockaddr_in6*>(&storage);
    return storage.ss_family == AF_INET6 && IN6_IS_ADDR_LOOPBACK(&v6->sin6_addr);
  }
  // "192.168.1.7:40001" or "[fe80::1]:40001".
  std::string text() const {
    std::array<char, INET6_ADDRSTRLEN> host{};
    if (storage.ss_family == AF_INET) {
      const auto* v4 = reinterpret_cast<const sockaddr_in*>(&storage);
      ::inet_ntop(AF_INET, &v4->sin_addr, host.data(), host.size());
      return std::string(host.data()) + ":" + std::to_string(ntohs(v4->sin_port));
    }
    const auto* v6 = reinterpret_cast<const sockaddr_in6*>(&storage);
    ::inet_ntop(AF_INET6, &v6->sin6_addr, host.data(), host.size());
    return std::string("[").append(host.data()) + "]:" + std::to_string(ntohs(v6->sin6_port));
  }
};

}  // namespace ivfm::host
