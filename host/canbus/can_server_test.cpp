#include "host/canbus/can_server.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "firmware/hal/linux/can_port.h"

namespace ivfm::host {
namespace {

using namespace std::chrono_literals;

CanServerOptions with_bus(const std::string& bus) {
  CanServerOptions options;
  options.buses = {bus};
  return options;
}
CanServerOptions with_log(const std::string& path) {
  CanServerOptions options;
  options.log_path = path;
  return options;
}

// A server on a free port, run by a thread.
class RunningServer {
 public:
  explicit RunningServer(CanServerOptions options = {}) : server_(with_free_port(options)) {}
  ~RunningServer() { stop(); }
  void stop() {
    server_.stop();
    if (thread_.joinable()) thread_.join();
  }
  std::string url(const std::string& bus) const {
    return "socketcand:127.0.0.1:" + std::to_string(server_.port()) + "/" + bus;
  }
  const CanServer& server() const { return server_; }

 private:
  static CanServerOptions with_free_port(CanServerOptions options) {
    options.port = "0";
    return options;
  }
  CanServer server_;
  std::thread thread_{[this] { server_.run(); }};
};

Result<CanFrame> receive_within(CanBus& bus, std::chrono::milliseconds limit) {
  const auto end = std::chrono::steady_clock::now() + limit;
  for (;;) {
    const Result<CanFrame> frame = bus.receive();
    if (frame.ok() || std::chrono::steady_clock::now() > end) return frame;
    std::this_thread::sleep_for(1ms);
  }
}

// A plain TCP client that says what it is told.
class TextClient {
 public:
  explicit TextClient(std::uint16_t port) : fd_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    const timeval limit{.tv_sec = 5, .tv_usec = 0};
    setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
  }
  ~TextClient() { close(fd_); }
  void say(const std::string& text) {
    EXPECT_EQ(::send(fd_, text.data(), text.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(text.size()));
  }
  // The next `< ... >`; empty when the server closed or said nothing for 5 s.
  std::string hear() {
    std::string text;
    char c = 0;
    while (text.empty() || text.back() != '>') {
      if (recv(fd_, &c, 1, 0) <= 0) return "";
      text.push_back(c);
    }
    return text;
  }

 private:
  int fd_;
};

const CanFrame kFrame{.id = 0x181, .size = 6, .data = {0x37, 0x06, 1, 2, 3, 4}};

TEST(CanServer, CarriesFramesBetweenClientsOfOneBusOnly) {
  RunningServer running;
  CanPort a, b, other;
  std::string error;
  ASSERT_EQ(a.open(running.url("robot1"), 2000, error), Status::kOk) << error;
  ASSERT_EQ(b.open(running.url("robot1"), 2000, error), Status::kOk) << error;
  ASSERT_EQ(other.open(running.url("robot2"), 2000, error), Status::kOk) << error;
  ASSERT_EQ(a.send(kFrame), Status::kOk);
  const auto frame = receive_within(b, 2000ms);
  ASSERT_TRUE(frame.ok());
  EXPECT_EQ(*frame, kFrame);
  EXPECT_EQ(a.receive().status(), Status::kEmpty) << "a sender does not hear itself";
  EXPECT_EQ(receive_within(other, 50ms).status(), Status::kEmpty);
}

TEST(CanServer, KeepsTheOrderOfManyFramesBothWays) {
  RunningServer running;
  CanPort a, b;
  std::string error;
  ASSERT_EQ(a.open(running.url("x"), 2000, error), Status::kOk) << error;
  ASSERT_EQ(b.open(running.url("x"), 2000, error), Status::kOk) << error;
  for (std::uint16_t i = 0; i < 500; ++i) {
    ASSERT_EQ(a.send({.id = i, .size = 0}), Status::kOk);
    ASSERT_EQ(b.send({.id = static_cast<std::uint16_t>(0x7ff - i), .remote = true}), Status::kOk);
  }
  for (std::uint16_t i = 0; i < 500; ++i) {
    const auto from_a = receive_within(b, 2000ms), from_b = receive_within(a, 2000ms);
    ASSERT_TRUE(from_a.ok() && from_b.ok()) << i;
    EXPECT_EQ(from_a->id, i);
    EXPECT_EQ(from_b->id, 0x7ff - i);
    EXPECT_TRUE(from_b->remote);
  }
}

TEST(CanServer, SpeaksTheProtocolOfTheDocument) {
  RunningServer running(with_bus("can0"));
  TextClient client(running.server().port()), listener(running.server().port());
  for (TextClient* c : {&client, &listener}) {
    EXPECT_EQ(c->hear(), "< hi >");
    c->say("< open can0 >");
    EXPECT_EQ(c->hear(), "< ok >");
  }
  listener.say("< rawmode >");
  EXPECT_EQ(listener.hear(), "< ok >");
  client.say("< echo >");
  EXPECT_EQ(client.hear(), "< echo >");
  client.say("< send 123 0 >< send 1AAAAAAA 2 1 F1 >< sendrtr 123 2 >");
  EXPECT_EQ(listener.hear().substr(0, 12), "< frame 123 ");
  EXPECT_NE(listener.hear().find(" 01F1 >"), std::string::npos);
  EXPECT_EQ(listener.hear().substr(0, 10), "< rtr 123 ");
  client.say("< send 123 3 1 >");
  EXPECT_EQ(client.hear(), "< error syntax error in send command >");
  client.say("< dance >");
  EXPECT_EQ(client.hear(), "< error unknown command >");
  client.say("< bcmmode >< controlmode >< send 123 0 >");
  EXPECT_EQ(client.hear(), "< ok >");
  EXPECT_EQ(client.hear(), "< ok >");
  EXPECT_EQ(client.hear(), "< error unknown command >") << "no frames in the control mode";
}

TEST(CanServer, RefusesABusThatWasNotDeclared) {
  RunningServer running(with_bus("can0"));
  TextClient client(running.server().port());
  EXPECT_EQ(client.hear(), "< hi >");
  client.say("< open can1 >");
  EXPECT_EQ(client.hear(), "< error could not open bus >");
  EXPECT_EQ(client.hear(), "") << "the connection is closed";
  CanPort port;
  std::string error;
  EXPECT_EQ(port.open(running.url("can1"), 2000, error), Status::kRefused);
  EXPECT_NE(error.find("can1"), std::string::npos);
}

TEST(CanServer, SurvivesNoiseAndGoesOnServing) {
  RunningServer running;
  std::uint32_t seed = 3;
  for (int round = 0; round < 20; ++round) {
    TextClient client(running.server().port());
    if (round % 2) client.say("< open x >< rawmode >");
    std::string noise;
    for (int i = 0; i < 5'000; ++i) {
      seed = seed * 1664525u + 1013904223u;
      noise.push_back("<> send123ABrawmode\n\0\xff"[(seed >> 16) % 21]);
    }
    client.say(noise);
  }
  CanPort a, b;
  std::string error;
  ASSERT_EQ(a.open(running.url("x"), 2000, error), Status::kOk) << error;
  ASSERT_EQ(b.open(running.url("x"), 2000, error), Status::kOk) << error;
  ASSERT_EQ(a.send(kFrame), Status::kOk);
  EXPECT_TRUE(receive_within(b, 2000ms).ok());
}

TEST(CanServer, DropsAClientThatDoesNotReadAndKeepsTheOthers) {
  CanServerOptions options;
  options.max_backlog = 20'000;
  RunningServer running(options);
  TextClient deaf(running.server().port());
  EXPECT_EQ(deaf.hear(), "< hi >");
  deaf.say("< open x >< rawmode >");
  EXPECT_EQ(deaf.hear(), "< ok >");
  EXPECT_EQ(deaf.hear(), "< ok >");
  std::this_thread::sleep_for(30ms);
  CanPort sender;
  std::string error;
  ASSERT_EQ(sender.open(running.url("x"), 2000, error), Status::kOk) << error;
  for (int i = 0; i < 1'000'000 && running.server().counters().slow_clients == 0; ++i) {
    (void)sender.send(kFrame);
  }
  EXPECT_EQ(running.server().counters().slow_clients, 1u);
  std::this_thread::sleep_for(20ms);
  EXPECT_NE(sender.receive().status(), Status::kUnavailable);
}

TEST(CanServer, TheClientComesBackWhenTheServerDoes) {
  CanPort port;
  std::string error;
  CanServerOptions options;
  {
    RunningServer running;
    options.port = std::to_string(running.server().port());
    ASSERT_EQ(port.open(running.url("x"), 2000, error), Status::kOk) << error;
  }
  EXPECT_EQ(receive_within(port, 50ms).status(), Status::kUnavailable);
  EXPECT_EQ(port.send(kFrame), Status::kUnavailable);
  CanServer again(options);
  std::thread thread([&] { again.run(); });
  const auto end = std::chrono::steady_clock::now() + 5s;
  while (port.receive().status() == Status::kUnavailable &&
         std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(5ms);
  }
  EXPECT_EQ(port.receive().status(), Status::kEmpty);
  again.stop();
  thread.join();
}

TEST(CanServer, ABusyPortAndABadLogAreOneClearSentence) {
  RunningServer running;
  CanServerOptions options;
  options.port = std::to_string(running.server().port());
  try {
    CanServer second(options);
    FAIL() << "two servers on one port";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("Address already in use"), std::string::npos);
  }
  EXPECT_THROW(CanServer{with_log("/no/such/folder/can.log")}, std::runtime_error);
  EXPECT_THROW(CanServer{with_bus("two words")}, std::runtime_error);
}

TEST(CanServer, NoServerIsOneClearSentence) {
  CanPort port;
  std::string error;
  EXPECT_EQ(port.open("socketcand:127.0.0.1:1/x", 50, error), Status::kUnavailable);
  EXPECT_NE(error.find("127.0.0.1:1"), std::string::npos) << error;
}

TEST(Candump, LinesLookLikeCandumps) {
  const SocketcandFrame frame{.id = 0x44, .size = 8, .data = {0x2a, 0x36, 0x6c, 0x2b, 0xba}};
  EXPECT_EQ(format_candump(1'436'509'052'249'713, "vcan0", frame),
            "(1436509052.249713) vcan0 044#2A366C2BBA000000\n");
  EXPECT_EQ(format_candump(0, "b", {.id = 0x80}), "(0000000000.000000) b 080#\n");
  EXPECT_EQ(format_candump(0, "b", {.id = 0x701, .remote = true}), "(0000000000.000000) b 701#R\n");
  EXPECT_EQ(format_candump(0, "b", {.id = 1, .extended = true, .size = 1}),
            "(0000000000.000000) b 00000001#00\n");
}

// can-utils reads our log: log2asc prints the frame of each line.
TEST(Candump, CanUtilsReadsOurLog) {
  if (std::system("command -v log2asc > /dev/null") != 0) GTEST_SKIP() << "no can-utils";
  const auto folder =
      std::filesystem::temp_directory_path() / ("ivfm-can-log-" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  {
    RunningServer running(with_log(folder / "can.log"));
    CanPort a;
    std::string error;
    ASSERT_EQ(a.open(running.url("robot1"), 2000, error), Status::kOk) << error;
    ASSERT_EQ(a.send(kFrame), Status::kOk);
    for (int i = 0; i < 400 && running.server().counters().frames == 0; ++i) {
      std::this_thread::sleep_for(5ms);
    }
  }
  const std::string command =
      "log2asc -I " + (folder / "can.log").string() + " robot1 > " + (folder / "can.asc").string();
  EXPECT_EQ(std::system(command.c_str()), 0);
  std::ifstream stream(folder / "can.asc");
  const std::string text((std::istreambuf_iterator<char>(stream)), {});
  EXPECT_NE(text.find("181"), std::string::npos) << text;
  EXPECT_NE(text.find("d 6 37 06 01 02 03 04"), std::string::npos) << text;
  std::filesystem::remove_all(folder);
}

// python-can, written by others, opens the bus, sees our frame and sends one.
TEST(CanServer, PythonCanSeesAndSendsFrames) {
  if (std::system("/usr/bin/python3 -c 'import can.interfaces.socketcand' 2> /dev/null") != 0) {
    GTEST_SKIP() << "no python3-can";
  }
  RunningServer running;
  CanPort ours;
  std::string error;
  ASSERT_EQ(ours.open(running.url("robot1"), 2000, error), Status::kOk) << error;
  const std::string script = std::string(IVFM_SOURCE_DIR) + "/host/canbus/python_can_peer.py";
  FILE* peer = popen(
      ("/usr/bin/python3 " + script + " " + std::to_string(running.server().port()) + " robot1")
          .c_str(),
      "r");
  ASSERT_NE(peer, nullptr);
  const auto hello = receive_within(ours, 20s);
  EXPECT_TRUE(hello.ok());
  if (hello.ok()) {
    EXPECT_EQ(*hello, (CanFrame{.id = 0x123, .size = 3, .data = {0x0a, 0xb0, 0xff}}));
  }
  EXPECT_EQ(ours.send(kFrame), Status::kOk);
  EXPECT_EQ(ours.send({.id = 0x080}), Status::kOk);
  std::string heard;
  for (int c = std::fgetc(peer); c != EOF; c = std::fgetc(peer)) {
    heard.push_back(static_cast<char>(c));
  }
  EXPECT_EQ(pclose(peer), 0);
  EXPECT_EQ(heard, "181 370601020304\n80 \n");
}

}  // namespace
}  // namespace ivfm::host
