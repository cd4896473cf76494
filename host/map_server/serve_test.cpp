// The server as it runs, over real UDP on loopback.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <streambuf>
#include <thread>

#include "firmware/hal/linux/udp_socket.h"
#include "firmware/link/map_link.h"
#include "host/map_server/map_reader.h"
#include "host/map_server/scratch_folder.h"
#include "host/map_server/serve_command.h"
#include "host/map_server/udp_listener.h"

namespace ivfm::host {
namespace {

using testing::HasSubstr;

// What the server says, readable while it runs.
class Output : public std::streambuf {
 public:
  std::string first_line() {
    for (int i = 0; i < 10000; ++i) {
      {
        const std::lock_guard lock(mutex_);
        if (const auto end = text_.find('\n'); end != std::string::npos)
          return text_.substr(0, end);
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    throw std::runtime_error("the server says nothing");
  }

 protected:
  std::streamsize xsputn(const char* text, std::streamsize size) override {
    const std::lock_guard lock(mutex_);
    text_.append(text, static_cast<std::size_t>(size));
    return size;
  }
  int overflow(int c) override {
    const std::lock_guard lock(mutex_);
    text_.push_back(static_cast<char>(c));
    return c;
  }

 private:
  std::mutex mutex_;
  std::string text_;
};

// A server in a thread of its own; stops when it goes out of scope.
class RunningServer {
 public:
  explicit RunningServer(const std::filesystem::path& database)
      : thread_([this, database] {
          std::ostream out(&output_);
          ServeOptions options;
          options.listen = "127.0.0.1:0";
          options.database = database.string();
          serve(options, stop_, out);
        }) {
    const std::string line = output_.first_line();
    const std::string start = "listening on ";
    address_ = line.substr(start.size(), line.find(',') - start.size());
  }
  ~RunningServer() {
    stop_ = true;
    thread_.join();
  }
  const std::string& address() const { return address_; }

 private:
  Output output_;
  std::atomic<bool> stop_{false};
  std::string address_;
  std::thread thread_;
};

// A robot whose own visits are all `count`.
struct UniformMap final : SharedMap {
  std::uint8_t count = 1;
  std::uint8_t peers = 0;
  Status read_own(Layer layer, const CellRect&, std::span<std::uint8_t> out) const override {
    for (auto& cell : out) cell = layer == Layer::kVisits ? count : std::uint8_t{0};
    return Status::kOk;
  }
  Status write_peers(Layer layer, const CellRect&, std::span<const std::uint8_t> cells) override {
    if (layer == Layer::kVisits) peers = cells[0];
    return Status::kOk;
  }
  Status restore_own(Layer, const CellRect&, std::span<const std::uint8_t>) override {
    return Status::kOk;
  }
};

// Steps a link on the real clock until `done`, ten seconds at most.
template <typename Done>
bool step_until(MapLink& link, Done done) {
  for (int i = 0; i < 2000; ++i) {
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    link.step(
        static_cast<TimeUs>(std::chrono::duration_cast<std::chrono::microseconds>(now).count()),
        {});
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

MapLinkConfig config_of(std::uint16_t robot) {
  MapLinkConfig config;
  config.robot = robot;
  config.batch_period_us = 50000;
  config.retry_us = 300000;
  return config;
}

TEST(Serve, MergesTwoRobotsOverLoopbackAndContinuesAfterARestart) {
  ScratchFolder folder;
  const auto path = folder / "run.db";
  UniformMap first_map, second_map;
  {
    RunningServer server(path);
    UdpSocket first_socket(server.address()), second_socket(server.address());
    ASSERT_EQ(first_socket.status(), Status::kOk) << server.address();
    MapLink first(first_map, first_socket, config_of(1));
    first_map.count = 3;
    first.mark_dirty(Layer::kVisits, {0, 0, 50, 50});
    ASSERT_TRUE(step_until(first, [&] { return first.all_acknowledged(); }));
    MapLink second(second_map, second_socket, config_of(2));
    ASSERT_TRUE(step_until(second, [&] { return second_map.peers == 3; }));
  }
  EXPECT_EQ(load_robot_map(path, 1).value(Layer::kVisits, {49, 49}), 3);
  RunningServer server(path);
  UdpSocket socket(server.address());
  MapLink second(second_map, socket, config_of(2));
  second_map.peers = 0;
  second.mark_dirty(Layer::kVisits, {49, 49, 1, 1});
  ASSERT_TRUE(
      step_until(second, [&] { return second_map.peers == 3 && second.all_acknowledged(); }));
  EXPECT_EQ(load_merged_map(path).value(Layer::kVisits, {49, 49}), 4);
}

TEST(Serve, SaysInOneSentenceWhyItCannotStart) {
  ScratchFolder folder;
  const auto failure = [&](const std::string& listen, const std::filesystem::path& database) {
    const std::atomic<bool> stop{true};
    std::ostringstream out;
    try {
      ServeOptions options;
      options.listen = listen;
      options.database = database.string();
      serve(options, stop, out);
    } catch (const std::exception& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const UdpListener busy("127.0.0.1:0");
  EXPECT_THAT(failure(busy.text(), folder / "a.db"), HasSubstr("another program uses that port"));
  EXPECT_FALSE(std::filesystem::exists(folder / "a.db"));
  EXPECT_THAT(failure("127.0.0.1", folder / "a.db"), HasSubstr("is not HOST:PORT"));
  EXPECT_THAT(failure("127.0.0.1:99999", folder / "a.db"), HasSubstr("is not HOST:PORT"));
  EXPECT_THAT(failure("127.0.0.1:0", folder / "none" / "a.db"), HasSubstr("cannot be written"));
  EXPECT_EQ(failure("127.0.0.1:0", folder / "b.db"), "");
}

}  // namespace
}  // namespace ivfm::host
