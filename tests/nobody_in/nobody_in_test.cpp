// Whoever has no key gets nothing in: forged, changed, cut, reflected, redirected and replayed
// datagrams, while two robots and the server work on. Environment variable IVFM_ATTACKS: how many.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "firmware/link/map_link.h"
#include "host/map_server/key_ring.h"
#include "host/map_server/map_server.h"
#include "host/map_server/scratch_folder.h"
#include "tests/support/fake_map.h"

namespace ivfm::host {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr CellRect kWindow{-30, -30, 60, 60};
constexpr TimeUs kTickUs = 50'000;
constexpr std::size_t kRobots = 2;
constexpr std::uint16_t kInsider = 3;  // has a key of its own, and evil intentions

// What was ever on the air: the enemy has it all.
struct Air {
  std::vector<Bytes> to_server;
  std::map<std::uint16_t, std::vector<Bytes>> to_robot;
};

class Radio final : public DatagramSocket {
 public:
  Result<std::size_t> receive(std::span<std::uint8_t> buffer) override {
    if (arriving.empty()) return Status::kEmpty;
    const Bytes bytes = arriving.front();
    arriving.erase(arriving.begin());
    if (bytes.size() > buffer.size()) return Status::kTruncated;
    std::copy(bytes.begin(), bytes.end(), buffer.begin());
    return bytes.size();
  }
  Status send(std::span<const std::uint8_t> datagram) override {
    leaving.emplace_back(datagram.begin(), datagram.end());
    return Status::kOk;
  }
  std::vector<Bytes> arriving, leaving;
};

struct Robot {
  Robot(std::uint16_t id_in, const RadioKey& key) : id(id_in), seal(key) { start(); }
  void start() {
    MapLinkConfig config;
    config.robot = id;
    config.boot = ++boot;
    config.batch_period_us = 200'000;
    map = std::make_unique<fake::SmallMap>(kWindow);
    link = std::make_unique<MapLink>(*map, radio, config, seal);
    link->clip(kWindow);
  }
  std::uint64_t dropped() const {
    const MapLinkCounters& c = link->counters();
    return std::uint64_t{c.dropped_malformed} + c.dropped_misdirected + c.dropped_refused +
           c.dropped_replayed + c.dropped_stale;
  }
  std::uint16_t id;
  SodiumSeal seal;
  std::uint64_t boot = id * 1000u;
  Radio radio;
  std::unique_ptr<fake::SmallMap> map;
  std::unique_ptr<MapLink> link;
};

class NobodyIn : public testing::Test, private DatagramSender {
 protected:
  NobodyIn() {
    for (std::uint16_t id = 1; id <= kInsider; ++id) keys_[id] = draw_radio_key();
    ring_ = std::make_unique<KeyRing>(keys_);
    for (std::uint16_t id = 1; id <= kRobots; ++id) {
      robots_.push_back(std::make_unique<Robot>(id, keys_[id]));
    }
    start_server();
  }

  // Another start; of a run of its own when `fresh`.
  void start_server(bool fresh = false) {
    server_.reset();
    database_.reset();
    if (fresh) ++runs_;
    database_ = std::make_unique<RunDatabase>(folder_ / ("run" + std::to_string(runs_) + ".db"));
    MapServerConfig config;
    config.boot = ++server_boot_;
    config.seals = ring_.get();
    DatagramSender& sender = *this;
    server_ =
        std::make_unique<MapServer>(*database_, sender, database_->begin_session(0, 1), config);
  }

  void send(const PeerAddress& to, std::span<const std::uint8_t> datagram) override {
    ++sent_;
    Bytes bytes(datagram.begin(), datagram.end());
    const std::uint16_t id = *peek_robot(bytes);
    air_.to_robot[id].push_back(bytes);
    if (to.size == id) robots_[id - 1u]->radio.arriving.push_back(std::move(bytes));
  }
  // The enemy's own address is 99.
  static PeerAddress address_of(unsigned id) {
    PeerAddress address;
    address.size = id;
    return address;
  }

  void tick() {
    now_us_ += kTickUs;
    for (auto& robot : robots_) {
      robot->link->step(now_us_, {});
      for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
        robot->link->mark_dirty(layer, robot->map->take_changes(layer));
      }
      for (Bytes& bytes : std::exchange(robot->radio.leaving, {})) {
        air_.to_server.push_back(bytes);
        server_->receive(address_of(robot->id), bytes, now_us_);
      }
    }
    server_->step(now_us_);
  }
  void run(TimeUs duration_us) {
    for (const TimeUs end = now_us_ + duration_us; now_us_ < end;) tick();
  }
  void explore() {
    Robot& robot = *robots_[random_() % kRobots];
    const auto place = [&] { return static_cast<std::int32_t>(random_() % 50) - 30; };
    const CellRect seen{place(), place(), 8, 8};
    fake::for_each_cell(seen, [&](Cell c) {
      const int count = robot.map->own(Layer::kVisits, c) + 1;
      robot.map->set_own(Layer::kVisits, c, static_cast<std::uint8_t>(std::min(255, count)));
    });
    robot.link->mark_dirty(Layer::kVisits, seen);
  }
  void expect_service() {
    run(15'000'000);
    ASSERT_TRUE(server_->all_delivered());
    for (const auto& robot : robots_) ASSERT_TRUE(robot->link->all_acknowledged());
    fake::for_each_cell(kWindow, [&](Cell c) {
      unsigned sum = 0;
      for (const auto& robot : robots_) {
        const unsigned own = robot->map->own(Layer::kVisits, c);
        ASSERT_EQ(server_->map().robot_value(robot->id, Layer::kVisits, c), own);
        sum += own;
      }
      for (const auto& robot : robots_) {
        ASSERT_EQ(robot->map->peers(Layer::kVisits, c),
                  std::min(255u, sum - robot->map->own(Layer::kVisits, c)));
      }
    });
    EXPECT_EQ(server_->map().robot_tiles(kInsider), nullptr);
  }

  const Bytes& any(const std::vector<Bytes>& recorded) {
    return recorded[random_() % recorded.size()];
  }
  const Bytes& anything() {
    return random_() % 2 == 0 ? any(air_.to_server) : any(air_.to_robot[1 + random_() % kRobots]);
  }
  // A datagram that nobody may take, for the server or for a robot.
  Bytes hostile(bool for_server) {
    Bytes bytes = anything();
    switch (random_() % 7) {
      case 0:  // noise behind a right head
        for (std::size_t i = 20; i < bytes.size(); ++i) {
          bytes[i] = static_cast<std::uint8_t>(random_() & 0xffu);
        }
        break;
      case 1:
        for (auto n = 1 + random_() % 3; n > 0; --n) {
          const std::size_t bit = random_() % (bytes.size() * 8);
          bytes[bit / 8] = static_cast<std::uint8_t>(bytes[bit / 8] ^ (1u << bit % 8));
        }
        break;
      case 2: bytes.resize(random_() % bytes.size()); break;
      case 3:  // back to where it came from
        return for_server ? any(air_.to_robot[1 + random_() % kRobots]) : any(air_.to_server);
      case 4:  // under another robot's number
        bytes[2] = static_cast<std::uint8_t>(1 + (bytes[2] + random_() % 2) % kInsider);
        break;
      case 5: return insiders(for_server);
      default: break;  // again, as it was
    }
    return bytes;
  }
  // Well formed, and sealed with a key that is right for another robot.
  Bytes insiders(bool for_server) {
    Bytes bytes(kMaxDatagramBytes);
    MapUpdateWriter writer(body_of(bytes), 50000, {});
    static_cast<void>(writer.add(Layer::kVisits, {0, 0, 1, 1}, Bytes{255}));
    const auto kind = for_server ? MessageKind::kMapUpdate : MessageKind::kServerMapUpdate;
    const DatagramHeader header{static_cast<std::uint16_t>(1 + random_() % kRobots), 1000000000,
                                static_cast<std::uint32_t>(1 + random_() % 1000), 77, kind};
    bytes.resize(*seal_datagram(header, writer.size(), bytes, SodiumSeal(keys_[kInsider]),
                                for_server ? server_boot_ : robots_[0]->boot));
    return bytes;
  }

  // One hostile datagram. What is not dropped may be an old hello only: answered, and that is all.
  void attack() {
    const bool for_server = random_() % 2 == 0;
    Bytes bytes = hostile(for_server);
    if (for_server) {
      const std::uint64_t before = server_->counters().dropped(), sent = sent_;
      const bool is_unbound = bytes.size() > 1 && (bytes[1] & 2) != 0;
      server_->receive(address_of(99), bytes, now_us_);
      const std::uint64_t dropped = server_->counters().dropped() - before;
      ASSERT_EQ(dropped + (is_unbound ? sent_ - sent : 0), 1u);
      ASSERT_LE(sent_ - sent, 1u);
    } else {
      Robot& robot = *robots_[random_() % kRobots];
      robot.link->step(now_us_, {});  // what is under way to it arrives first
      const std::uint64_t before = robot.dropped();
      robot.radio.arriving = {bytes};
      robot.link->step(now_us_, {});
      ASSERT_EQ(robot.dropped() - before, 1u);
    }
  }

  std::mt19937 random_{1};
  ScratchFolder folder_;
  RadioKeys keys_;
  std::unique_ptr<KeyRing> ring_;
  std::vector<std::unique_ptr<Robot>> robots_;
  std::unique_ptr<RunDatabase> database_;
  std::unique_ptr<MapServer> server_;
  Air air_;
  TimeUs now_us_ = 1'000'000;
  int runs_ = 0;
  std::uint64_t server_boot_ = 5000;
  std::uint64_t sent_ = 0;
};

TEST_F(NobodyIn, AndTheRobotsNoticeNothing) {
  const char* wanted = std::getenv("IVFM_ATTACKS");
  const int attacks = wanted != nullptr ? std::atoi(wanted) : 40'000;
  for (int i = 0; i < 20; ++i) {
    explore();
    run(500'000);
  }
  expect_service();
  for (int i = 0; i < attacks; ++i) {
    ASSERT_NO_FATAL_FAILURE(attack()) << "attack " << i;
    if (i % 50 == 0) explore();
    if (i % 20 == 0) tick();
    if (i % 10'000 == 9'999) {  // all that was recorded so far is of earlier starts then
      expect_service();
      start_server();
      robots_[random_() % kRobots]->start();
      run(8'000'000);
    }
    if (air_.to_server.size() > 4000)
      air_.to_server.erase(air_.to_server.begin() + 100, air_.to_server.begin() + 2000);
  }
  expect_service();
}

// The same keys in another run: what was recorded in the first one gets nothing into its map.
TEST_F(NobodyIn, RecordingsOfAnEarlierRunAreWorthless) {
  for (int i = 0; i < 10; ++i) {
    explore();
    run(500'000);
  }
  start_server(true);
  for (Bytes bytes : std::vector<Bytes>(air_.to_server)) {
    server_->receive(address_of(1), bytes, now_us_);
  }
  server_->step(now_us_ + 1'000'000);
  EXPECT_EQ(server_->map().explored_cells(), 0u);
  EXPECT_TRUE(server_->robots().empty());
}

TEST_F(NobodyIn, NorARobotWhoseKeyWasTakenAway) {
  keys_.erase(2);
  ring_ = std::make_unique<KeyRing>(keys_);
  start_server();
  for (int i = 0; i < 10; ++i) {
    explore();
    run(500'000);
  }
  EXPECT_EQ(server_->map().robot_tiles(2), nullptr);
  EXPECT_GT(server_->counters().dropped_unknown, 0u);
}

}  // namespace
}  // namespace ivfm::host
