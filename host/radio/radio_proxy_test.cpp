#include "host/radio/radio_proxy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <stdexcept>

namespace ivfm::host {
namespace {

using Bytes = std::vector<std::uint8_t>;

// A server that sends everything back to where it came from, behind a proxy; all in this thread.
class RadioProxyTest : public testing::Test {
 protected:
  RadioProxy make_proxy(RadioFaults faults) {
    return RadioProxy({"127.0.0.1:0", echo_.text(), std::move(faults), 7, 1});
  }
  // Steps proxy and server until the robot has heard `expected` datagrams, or for 200 turns in
  // which nothing came.
  static std::vector<Bytes> answers(RadioProxy& proxy, UdpListener& echo, UdpSocket& robot,
                                    std::size_t expected) {
    std::vector<Bytes> out;
    std::array<std::uint8_t, 2000> buffer;
    for (int idle = 0; idle < 200 && out.size() < expected; ++idle) {
      proxy.step(5);
      while (const auto datagram = echo.receive(buffer)) {
        echo.send(datagram->second, std::span(buffer).first(datagram->first));
      }
      for (auto size = robot.receive(buffer); size.ok(); size = robot.receive(buffer)) {
        out.emplace_back(buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(*size));
        idle = 0;
      }
    }
    return out;
  }

  UdpListener echo_{"127.0.0.1:0"};
};

TEST_F(RadioProxyTest, PassesDatagramsOnBothWaysForEachSender) {
  RadioProxy proxy = make_proxy({});
  UdpSocket first(proxy.listening_on()), second(proxy.listening_on());
  ASSERT_EQ(first.send(Bytes{1, 2, 3}), Status::kOk);
  ASSERT_EQ(second.send(Bytes(1199, 9)), Status::kOk);
  EXPECT_THAT(answers(proxy, echo_, first, 1), testing::ElementsAre(Bytes{1, 2, 3}));
  EXPECT_THAT(answers(proxy, echo_, second, 1), testing::ElementsAre(Bytes(1199, 9)));
  EXPECT_EQ(proxy.client_count(), 2u);
  EXPECT_EQ(proxy.counters().sent, 4u);
}

TEST_F(RadioProxyTest, InjectsFaultsUntilTheyEnd) {
  RadioProxy proxy = make_proxy({.drop = 1});
  UdpSocket robot(proxy.listening_on());
  for (int i = 0; i < 5; ++i) ASSERT_EQ(robot.send(Bytes{7}), Status::kOk);
  while (proxy.counters().lost < 5) proxy.step(5);
  proxy.end_faults();
  ASSERT_EQ(robot.send(Bytes{8}), Status::kOk);
  EXPECT_THAT(answers(proxy, echo_, robot, 1), testing::ElementsAre(Bytes{8}));
}

TEST_F(RadioProxyTest, AServerThatIsAwayForATimeIsFoundAgain) {
  auto server = std::make_unique<UdpListener>("127.0.0.1:0");
  const std::string address = server->text();
  RadioProxy proxy({"127.0.0.1:0", address, {}, 1, 1});
  UdpSocket robot(proxy.listening_on());
  server.reset();
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(robot.send(Bytes{1}), Status::kOk);
    proxy.step(20);
  }
  server = std::make_unique<UdpListener>(address);
  // The first may be lost to what the system remembers of the server's absence.
  for (int i = 0; i < 3; ++i) ASSERT_EQ(robot.send(Bytes{2}), Status::kOk);
  EXPECT_THAT(answers(proxy, *server, robot, 1), testing::Contains(Bytes{2}));
}

TEST_F(RadioProxyTest, SaysInOneSentenceWhyItCannotStart) {
  const auto failure = [](const std::string& listen, const std::string& to) {
    try {
      RadioProxy proxy({listen, to, {}, 1, 1});
    } catch (const std::runtime_error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(failure(echo_.text(), echo_.text()), testing::HasSubstr("uses that port"));
  EXPECT_THAT(failure("127.0.0.1:0", "nonsense"), testing::HasSubstr("--to 'nonsense'"));
}

}  // namespace
}  // namespace ivfm::host
