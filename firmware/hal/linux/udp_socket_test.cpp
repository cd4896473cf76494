#include "firmware/hal/linux/udp_socket.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <string>
#include <vector>

namespace ivfm {
namespace {

// A plain blocking UDP socket on a free loopback port.
class Peer {
 public:
  Peer() : fd_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    socklen_t size = sizeof address;
    ::getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size);
    name_ = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));
  }
  ~Peer() { ::close(fd_); }
  const std::string& name() const { return name_; }
  std::vector<std::uint8_t> receive() {
    std::vector<std::uint8_t> bytes(2000);
    socklen_t size = sizeof from_;
    const ssize_t received =
        ::recvfrom(fd_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&from_), &size);
    bytes.resize(received < 0 ? 0 : static_cast<std::size_t>(received));
    return bytes;
  }
  void answer(const std::vector<std::uint8_t>& bytes) {
    EXPECT_EQ(::sendto(fd_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&from_),
                       sizeof from_),
              static_cast<ssize_t>(bytes.size()));
  }

 private:
  int fd_;
  std::string name_;
  sockaddr_in from_{};
};

// Loopback delivers before sendto() returns; the loop is for slow machines.
Result<std::size_t> receive_soon(UdpSocket& socket, std::span<std::uint8_t> buffer) {
  for (int i = 0; i < 1000; ++i) {
    const auto size = socket.receive(buffer);
    if (size.status() != Status::kEmpty) return size;
    ::usleep(1000);
  }
  return Status::kEmpty;
}

TEST(UdpSocket, SendsAndReceivesDatagrams) {
  Peer peer;
  UdpSocket socket(peer.name());
  ASSERT_EQ(socket.status(), Status::kOk) << socket.error_text();
  std::array<std::uint8_t, 16> buffer{};
  EXPECT_EQ(socket.receive(buffer).status(), Status::kEmpty);
  ASSERT_EQ(socket.send(std::array<std::uint8_t, 3>{1, 2, 3}), Status::kOk);
  EXPECT_EQ(peer.receive(), (std::vector<std::uint8_t>{1, 2, 3}));
  peer.answer({4, 5});
  const auto size = receive_soon(socket, buffer);
  ASSERT_TRUE(size.ok());
  EXPECT_EQ(*size, 2u);
  EXPECT_EQ(buffer[1], 5);
}

TEST(UdpSocket, ReportsADatagramThatIsTooLong) {
  Peer peer;
  UdpSocket socket(peer.name());
  ASSERT_EQ(socket.send(std::array<std::uint8_t, 1>{1}), Status::kOk);
  peer.receive();
  peer.answer(std::vector<std::uint8_t>(17));
  std::array<std::uint8_t, 16> buffer{};
  EXPECT_EQ(receive_soon(socket, buffer).status(), Status::kTruncated);
}

TEST(UdpSocket, APeerThatIsGoneMakesItUnavailableUntilItIsBack) {
  std::string name;
  {
    Peer peer;
    name = peer.name();
  }
  UdpSocket socket(name);
  ASSERT_EQ(socket.status(), Status::kOk);
  ASSERT_EQ(socket.send(std::array<std::uint8_t, 1>{1}), Status::kOk);
  std::array<std::uint8_t, 16> buffer{};
  EXPECT_EQ(receive_soon(socket, buffer).status(), Status::kUnavailable);
  EXPECT_EQ(socket.receive(buffer).status(), Status::kEmpty);
}

TEST(UdpSocket, SaysWhatIsWrongWithAnAddress) {
  for (const char* bad : {"", "host", "host:", ":7700", "host:0", "host:65536", "host:77x"}) {
    UdpSocket socket(bad);
    EXPECT_EQ(socket.status(), Status::kInvalidArgument) << bad;
    EXPECT_STRNE(socket.error_text(), "");
    EXPECT_EQ(socket.send(std::array<std::uint8_t, 1>{1}), Status::kUnavailable);
    std::array<std::uint8_t, 16> buffer{};
    EXPECT_EQ(socket.receive(buffer).status(), Status::kUnavailable);
  }
  UdpSocket long_name(std::string(300, 'x') + ":7700");
  EXPECT_EQ(long_name.status(), Status::kInvalidArgument);
}

TEST(UdpSocket, UnderstandsIpv6Addresses) {
  UdpSocket socket("[::1]:7700");
  // A machine without IPv6 refuses the socket or the route, never the address.
  EXPECT_NE(socket.status(), Status::kInvalidArgument);
}

}  // namespace
}  // namespace ivfm
