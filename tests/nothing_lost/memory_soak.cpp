// A day of robots' traffic in simulated time: the map server and its live page must not need more
// memory, nor the database more room, after a day than after an hour in the same mapped area.
#include <malloc.h>
#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <vector>

#include "firmware/hal/fake/fake_datagram.h"
#include "host/cli/progress_line.h"
#include "host/dashboard/live_state.h"
#include "host/map_server/map_server.h"
#include "host/map_server/scratch_folder.h"
#include "tests/nothing_lost/team_robot.h"

namespace ivfm::host {
namespace {

constexpr TimeUs kSecond = 1'000'000;
constexpr TimeUs kHour = 3600 * kSecond;
constexpr TimeUs kTickUs = kSecond / 4;
constexpr std::size_t kRobots = 3;
constexpr double kMemoryTolerance = 0.02;  // of what waits at one moment or another
constexpr double kFileTolerance = 0.03;    // of pages that rows which come and go leave half full
// SQLite keeps pages of the file in memory, up to 2,000 KiB as it comes (PRAGMA cache_size), and
// some buffers: it fills up for half a day, and that is all that grows.
constexpr std::size_t kSqliteLimit = 2'500 * 1024;

struct Usage {
  std::size_t heap_bytes = 0;  // without SQLite's
  std::size_t sqlite_bytes = 0;
  std::uint64_t database_bytes = 0;
};

class Day final : private DatagramSender {
 public:
  Day() {
    config_.retention_us = kHour / 2;
    DatagramSender& sender = *this;
    server_ =
        std::make_unique<MapServer>(database_, sender, database_.begin_session(0, 1), config_);
    for (std::uint16_t id = 1; id <= kRobots; ++id) {
      radios_.push_back(std::make_unique<FakeRadio>(id, RadioFaults{.drop = 0.1}));
      robots_.push_back(std::make_unique<TeamRobot>(id, radios_.back()->robot()));
    }
  }

  // The most that was in use within ten minutes from `begin_us` on.
  Usage peak_from(TimeUs begin_us) {
    while (now_us_ < begin_us) tick();
    Usage peak;
    for (const TimeUs end_us = now_us_ + kHour / 6; now_us_ < end_us;) {
      tick();
      const auto sqlite = static_cast<std::size_t>(sqlite3_memory_used());
      peak.heap_bytes = std::max<std::size_t>(peak.heap_bytes, mallinfo2().uordblks - sqlite);
      peak.sqlite_bytes = std::max(peak.sqlite_bytes, sqlite);
      peak.database_bytes = std::max(peak.database_bytes, database_.file_bytes());
    }
    return peak;
  }
  std::uint64_t datagrams() const { return server_->counters().traffic.datagrams_in; }

 private:
  void send(const PeerAddress& to, std::span<const std::uint8_t> datagram) override {
    static_cast<void>(radios_[to.size]->server().send(datagram));
  }

  void tick() {
    now_us_ += kTickUs;
    std::array<std::uint8_t, kMaxDatagramBytes> buffer;
    for (std::size_t i = 0; i < kRobots; ++i) {
      radios_[i]->set_now(now_us_);
      robots_[i]->explore(random_);
      robots_[i]->step(now_us_, pose_now());
      DatagramSocket& radio = radios_[i]->server();
      PeerAddress from;
      from.size = static_cast<socklen_t>(i);
      for (auto size = radio.receive(buffer); size.ok(); size = radio.receive(buffer)) {
        server_->receive(from, std::span(buffer).first(*size), now_us_);
      }
    }
    server_->step(now_us_);
    page_.update(*server_, now_us_);
    progress_(now_us_ / kHour);
  }

  // On a circle, 20 cm a second.
  Pose pose_now() const {
    const double angle = static_cast<double>(now_us_) / 1e7;
    return {{static_cast<std::int32_t>(2e6 * std::cos(angle)),
             static_cast<std::int32_t>(2e6 * std::sin(angle))},
            {}};
  }

  ScratchFolder folder_;
  RunDatabase database_{folder_ / "run.db"};
  MapServerConfig config_;
  std::unique_ptr<MapServer> server_;
  LiveState page_{"run"};
  std::vector<std::unique_ptr<FakeRadio>> radios_;
  std::vector<std::unique_ptr<TeamRobot>> robots_;
  std::mt19937 random_{1};
  TimeUs now_us_ = kSecond;
  ProgressLine progress_{24, "hours"};
};

// Says what was in use; false when it is more after a day than `limit`.
bool report(const char* what, std::uint64_t hour, std::uint64_t day, double limit) {
  const bool good = static_cast<double>(day) <= limit;
  std::printf("%-14s %6llu KiB after an hour, %6llu KiB after a day, limit %6.0f KiB%s\n", what,
              0ull + hour / 1024, 0ull + day / 1024, limit / 1024, good ? "" : ": it grows");
  return good;
}

int run() {
  Day day;
  const Usage hour = day.peak_from(kHour), end = day.peak_from(24 * kHour);
  std::printf("%llu datagrams of %zu robots\n", static_cast<unsigned long long>(day.datagrams()),
              kRobots);
  const bool memory = report("memory", hour.heap_bytes, end.heap_bytes,
                             static_cast<double>(hour.heap_bytes) * (1 + kMemoryTolerance));
  const bool sqlite = report("SQLite's cache", hour.sqlite_bytes, end.sqlite_bytes, kSqliteLimit);
  const bool file = report("database", hour.database_bytes, end.database_bytes,
                           static_cast<double>(hour.database_bytes) * (1 + kFileTolerance));
  return memory && sqlite && file ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace
}  // namespace ivfm::host

int main() { return ivfm::host::run(); }
