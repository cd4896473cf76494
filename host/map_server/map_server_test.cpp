#include "host/map_server/map_server.h"

#include <gtest/gtest.h>

#include <memory>
#include <random>

#include "firmware/hal/fake/fake_datagram.h"
#include "firmware/link/map_link.h"
#include "host/map_server/scratch_folder.h"
#include "tests/support/fake_map.h"

namespace ivfm::host {
namespace {

using fake::for_each_cell;
using fake::SmallMap;

constexpr TimeUs kSecond = 1000000;
constexpr TimeUs kTick = 50000;
constexpr CellRect kWindow = {-40, -40, 100, 80};

PeerAddress address_of(std::size_t robot) {
  PeerAddress address;
  address.size = sizeof(sockaddr_in);
  auto* v4 = reinterpret_cast<sockaddr_in*>(&address.storage);
  v4->sin_family = AF_INET;
  v4->sin_port = htons(static_cast<std::uint16_t>(robot));
  return address;
}

// Robots with real links, each on a radio of its own, and a real server on a real database.
class Team : public DatagramSender {
 public:
  // The last `apart` of the robots do not know where they are.
  explicit Team(std::size_t robots, std::uint32_t seed = 1, RadioFaults faults = {},
                std::size_t apart = 0) {
    for (std::size_t i = 0; i < robots; ++i) {
      auto member = std::make_unique<Member>(seed * 100 + static_cast<std::uint32_t>(i), faults);
      MapLinkConfig config;
      config.robot = static_cast<std::uint16_t>(i + 1);
      config.epoch = 10;
      config.name = "robot";
      config.batch_period_us = 300000;
      config.apart = i + apart >= robots;
      member->link.emplace(member->map, member->radio.robot(), config);
      members_.push_back(std::move(member));
    }
    start_server();
  }
  ~Team() { stop_server(); }

  void start_server() {
    database_ = std::make_unique<RunDatabase>(folder_ / "run.db");
    const std::uint32_t epoch = database_->begin_session(0, 1.0);
    server_ = std::make_unique<MapServer>(*database_, *this, epoch);
  }
  // In place of the one with a database, which has not heard anybody yet.
  void start_server_without_database() {
    stop_server();
    server_ = std::make_unique<MapServer>(*this, 1);
  }
  // Like kill -9: nothing is finished.
  void stop_server() {
    server_.reset();
    database_.reset();
  }
  void send(const PeerAddress& to, std::span<const std::uint8_t> datagram) override {
    const auto robot = ntohs(reinterpret_cast<const sockaddr_in*>(&to.storage)->sin_port);
    static_cast<void>(members_[robot - 1u]->radio.server().send(datagram));
  }

  void tick() {
    now_ += kTick;
    for (auto& member : members_) {
      member->radio.set_now(now_);
      member->link->step(now_, member->pose);
    }
    std::array<std::uint8_t, kMaxDatagramBytes> buffer;
    for (std::size_t i = 0; i < members_.size(); ++i) {
      while (true) {
        const auto size = members_[i]->radio.server().receive(buffer);
        if (!size.ok()) break;
        if (server_) server_->receive(address_of(i + 1), std::span(buffer).first(*size), now_);
      }
    }
    if (server_) server_->step(now_);
  }
  void run(TimeUs duration_us) {
    for (const TimeUs end = now_ + duration_us; now_ < end;) tick();
  }
  // Until everything is known everywhere, or time is up. A status message of every robot comes
  // first, so that a server that has just started knows whom to tell.
  bool settle(TimeUs limit_us) {
    run(6 * kSecond);
    for (const TimeUs end = now_ + limit_us; now_ < end;) {
      tick();
      bool done = server_ && server_->all_delivered();
      for (auto& member : members_) done = done && member->link->all_acknowledged();
      if (done) return true;
    }
    return false;
  }

  void visit(std::size_t robot, const CellRect& rect) {
    members_[robot]->map.visit(rect);
    members_[robot]->link->mark_dirty(Layer::kVisits, rect);
  }
  void place(std::size_t robot, Point at) { members_[robot]->pose.position = at; }
  // The robot's map frame was wrong: its visits are those of `rect` now, and there is no obstacle.
  void move_frame(std::size_t robot, const CellRect& rect) {
    SmallMap& map = members_[robot]->map;
    for_each_cell(kWindow, [&](Cell c) {
      map.set_own(Layer::kVisits, c, rect.contains({c.x, c.y, 1, 1}) ? 1 : 0);
      map.set_own(Layer::kObstacles, c, 0);
    });
    members_[robot]->link->move_frame();
    for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
      members_[robot]->link->mark_dirty(layer, kWindow);
    }
  }
  // The robot's map is turned by half a turn, so that cell (0, 0) comes to `to`.
  void turn_half(std::size_t robot, Cell to) {
    SmallMap& map = members_[robot]->map;
    const SmallMap before = map;
    for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
      for_each_cell(kWindow, [&](Cell c) {
        const Cell from{to.x - c.x, to.y - c.y};
        map.set_own(layer, c, before.own(layer, from));
      });
      members_[robot]->link->mark_dirty(layer, kWindow);
    }
  }
  const SmallMap& map_of(std::size_t robot) const { return members_[robot]->map; }
  void set_obstacles(std::size_t robot, const CellRect& rect, std::uint8_t value) {
    SmallMap& map = members_[robot]->map;
    for_each_cell(rect, [&](Cell c) { map.set_own(Layer::kObstacles, c, value); });
    members_[robot]->link->mark_dirty(Layer::kObstacles, rect);
  }

  // The server's map is the sum of the robots', and each robot has the sum of the others'.
  void expect_consistent(const std::string& note) {
    for_each_cell(kWindow, [&](Cell c) {
      unsigned visits = 0, obstacles = 0;
      for (auto& member : members_) {
        visits += member->map.own(Layer::kVisits, c);
        obstacles += member->map.own(Layer::kObstacles, c);
      }
      const MapStore& map = server_->map();
      ASSERT_EQ(map.merged_value(Layer::kVisits, c), std::min(255u, visits)) << note;
      ASSERT_EQ(map.merged_value(Layer::kObstacles, c), std::min(1u, obstacles)) << note;
      for (auto& member : members_) {
        SmallMap& robot = member->map;
        ASSERT_EQ(robot.peers(Layer::kVisits, c),
                  std::min(255u, visits - robot.own(Layer::kVisits, c)))
            << note;
        ASSERT_EQ(robot.peers(Layer::kObstacles, c),
                  std::min(1u, obstacles - robot.own(Layer::kObstacles, c)))
            << note;
      }
    });
  }

  MapServer& server() { return *server_; }
  bool has_server() const { return server_ != nullptr; }
  MapLink& link(std::size_t robot) { return *members_[robot]->link; }
  FakeRadio& radio(std::size_t robot) { return members_[robot]->radio; }
  std::size_t size() const { return members_.size(); }
  TimeUs now_us() const { return now_; }
  RunDatabase& database() { return *database_; }

 private:
  struct Member {
    Member(std::uint32_t seed, RadioFaults faults) : radio(seed, faults) {}
    FakeRadio radio;
    SmallMap map{kWindow};
    std::optional<MapLink> link;
    Pose pose;
  };
  ScratchFolder folder_;
  TimeUs now_ = kSecond;
  std::vector<std::unique_ptr<Member>> members_;
  std::unique_ptr<RunDatabase> database_;
  std::unique_ptr<MapServer> server_;
};

TEST(MapServer, SaysTheSameWithoutADatabase) {
  const auto traffic_of = [](Team& team) {
    team.visit(0, {0, 0, 10, 10});
    team.set_obstacles(1, {-40, -40, 100, 1}, 1);
    EXPECT_TRUE(team.settle(10 * kSecond));
    team.expect_consistent("");
    return team.server().counters().traffic;
  };
  Team keeping(2), forgetting(2);
  forgetting.start_server_without_database();
  EXPECT_EQ(traffic_of(forgetting), traffic_of(keeping));
}

TEST(MapServer, RobotsSeeWhatTheOthersSaw) {
  Team team(3);
  team.visit(0, {0, 0, 10, 10});
  team.visit(1, {5, 5, 10, 10});
  team.set_obstacles(2, {-40, -40, 100, 1}, 1);
  ASSERT_TRUE(team.settle(10 * kSecond));
  team.expect_consistent("");
  EXPECT_EQ(team.server().robot_count(), 3u);
  EXPECT_EQ(team.server().counters().dropped(), 0u);
}

TEST(MapServer, AcknowledgesOnlyWhatIsCommitted) {
  Team team(1);
  ASSERT_TRUE(team.settle(5 * kSecond));
  team.visit(0, {0, 0, 10, 10});
  while (!team.link(0).all_acknowledged()) team.tick();
  team.stop_server();  // at once, without a last commit
  team.start_server();
  EXPECT_EQ(team.server().map().robot_value(1, Layer::kVisits, {5, 5}), 1);
}

TEST(MapServer, GoesOnAfterARestartAndTellsEverybodyEverything) {
  Team team(2);
  team.visit(0, {0, 0, 10, 10});
  ASSERT_TRUE(team.settle(5 * kSecond));
  team.stop_server();
  team.visit(1, {3, 3, 10, 10});
  team.run(3 * kSecond);
  team.start_server();
  EXPECT_EQ(team.server().cell_um(), 50000);
  ASSERT_TRUE(team.settle(60 * kSecond));
  team.expect_consistent("");
}

TEST(MapServer, RemembersWhenACellWasSeenFirstAndWhatTheLayersCost) {
  Team team(2);
  team.visit(0, {0, 0, 10, 10});
  ASSERT_TRUE(team.settle(5 * kSecond));
  team.stop_server();
  team.start_server();
  const TimeUs before = team.now_us();
  team.visit(0, {5, 5, 10, 10});
  team.visit(1, {5, 5, 10, 10});
  ASSERT_TRUE(team.settle(5 * kSecond));
  const FirstSeen seen = team.database().load_first_seen().at({Layer::kVisits, 0, 0});
  EXPECT_GT(seen[tile_index({9, 9})], 0u);
  EXPECT_LE(seen[tile_index({9, 9})], before / 100'000 + 1);  // not again by the second visit
  EXPECT_GT(seen[tile_index({14, 14})], before / 100'000);
  EXPECT_EQ(seen[tile_index({15, 15})], 0u);
  const auto robots = team.database().load_robots();
  EXPECT_GE(robots[0].traffic.layers[0].cells, 200u);
  EXPECT_GT(robots[0].traffic.layers[0].bytes, 0u);
  EXPECT_EQ(robots[0].traffic.layers[1].cells, 0u);
}

TEST(MapServer, ARobotThatJoinsLateIsToldEverything) {
  Team team(2);
  team.radio(1).set_partitioned(true);
  team.visit(0, {-40, -40, 100, 80});
  team.run(20 * kSecond);
  EXPECT_EQ(team.server().robot_count(), 1u);
  team.radio(1).set_partitioned(false);
  team.run(20 * kSecond);
  ASSERT_TRUE(team.settle(20 * kSecond));
  team.expect_consistent("");
}

TEST(MapServer, SendsOnlyWhatChangedSinceTheLastAcknowledgement) {
  Team team(2);
  team.visit(0, {-40, -40, 100, 80});
  ASSERT_TRUE(team.settle(10 * kSecond));
  const auto before = team.link(1).counters().regions_received;
  team.run(10 * kSecond);
  EXPECT_EQ(team.link(1).counters().regions_received, before);
  team.visit(0, {1, 1, 2, 2});
  ASSERT_TRUE(team.settle(10 * kSecond));
  EXPECT_EQ(team.link(1).counters().regions_received, before + 1);
}

TEST(MapServer, AFindEndsTheSearchForTheOthers) {
  Team team(3);
  ASSERT_TRUE(team.settle(5 * kSecond));
  team.radio(2).set_partitioned(true);
  team.link(0).report_found({1000000, 2000000});
  team.run(3 * kSecond);
  EXPECT_FALSE(team.link(0).take_command().has_value());
  EXPECT_EQ(team.link(1).take_command(), CommandCode::kFound);
  EXPECT_FALSE(team.link(2).take_command().has_value());
  team.stop_server();  // the server remembers
  team.start_server();
  team.radio(2).set_partitioned(false);
  team.run(20 * kSecond);
  EXPECT_EQ(team.link(2).take_command(), CommandCode::kFound);
}

TEST(MapServer, RobotsHearWhereTheOthersNearThemAre) {
  Team team(4);
  team.place(1, {3'000'000, -1'000'000});
  team.place(2, {1'000'000, 1'000'000});
  team.place(3, {20'000'000, 0});
  team.run(5 * kSecond);
  ASSERT_EQ(team.link(0).peers().size(), 2u);  // the nearest first
  EXPECT_EQ(team.link(0).peers()[0].position, (Point{1'000'000, 1'000'000}));
  EXPECT_EQ(team.link(0).peers()[1].position, (Point{3'000'000, -1'000'000}));
  EXPECT_TRUE(team.link(3).peers().empty());
  for (const PeerRobot& peer : team.link(0).peers()) {
    EXPECT_LE(team.now_us() - peer.told_us, kSecond + 2 * kTick + 400'000);
  }
  team.radio(2).set_partitioned(true);  // what it told is forgotten
  team.run(4 * kSecond);
  ASSERT_EQ(team.link(0).peers().size(), 1u);
  EXPECT_EQ(team.link(0).peers()[0].position, (Point{3'000'000, -1'000'000}));
}

TEST(MapServer, WhatARobotSaidInAWrongFrameIsForgottenEverywhere) {
  Team team(2, 3, {.drop = 0.3, .duplicate = 0.2, .reorder = 0.3});
  team.visit(0, {0, 0, 10, 10});
  team.visit(0, {0, 0, 10, 10});
  team.set_obstacles(0, {-40, -40, 100, 1}, 1);
  team.visit(1, {5, 5, 10, 10});
  ASSERT_TRUE(team.settle(60 * kSecond));
  team.visit(0, {20, 20, 10, 10});  // still on its way
  team.run(2 * kTick);
  team.move_frame(0, {3, 2, 10, 10});
  ASSERT_TRUE(team.settle(60 * kSecond));
  team.expect_consistent("in the new frame");
  team.stop_server();
  team.start_server();
  ASSERT_TRUE(team.settle(60 * kSecond));
  team.expect_consistent("after a restart of the server");
  team.stop_server();
  team.move_frame(0, {4, 2, 10, 10});  // while nobody listens
  team.run(3 * kSecond);
  team.start_server();
  ASSERT_TRUE(team.settle(60 * kSecond));
  team.expect_consistent("after a frame that moved without a server");
}

// A floor that looks like no other, in two robots' maps: 5 m by 4 m.
void explore_floor(Team& team, std::size_t robot) {
  const std::array walls = {CellRect{-40, -40, 100, 2}, CellRect{-40, 38, 100, 2},
                            CellRect{-40, -40, 2, 80},  CellRect{58, -40, 2, 80},
                            CellRect{0, -40, 2, 30},    CellRect{30, 0, 30, 2},
                            CellRect{-20, 10, 20, 2},   CellRect{40, -20, 6, 6}};
  team.visit(robot, kWindow);
  for (const CellRect& wall : walls) team.set_obstacles(robot, wall, 1);
}

TEST(MapServer, ARobotThatDoesNotKnowWhereItIsStaysApartUntilItIsFound) {
  Team team(3, 5, {.drop = 0.2, .duplicate = 0.2, .reorder = 0.2}, 1);
  const Cell corner{19, -1};  // where half a turn leaves the window as it is
  explore_floor(team, 2);
  team.turn_half(2, corner);
  team.visit(1, {5, 5, 10, 10});
  ASSERT_TRUE(team.settle(60 * kSecond));
  const auto expect_apart = [&](const std::string& note) {
    const MapServer& server = team.server();
    ASSERT_EQ(server.apart_maps().count(3), 1u) << note;
    for_each_cell(kWindow, [&](Cell c) {
      for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
        ASSERT_EQ(server.apart_maps().at(3).robot_value(3, layer, c), team.map_of(2).own(layer, c))
            << note;
        ASSERT_EQ(team.map_of(0).peers(layer, c), team.map_of(1).own(layer, c)) << note;
        ASSERT_EQ(team.map_of(2).peers(layer, c), 0) << note;
      }
    });
    EXPECT_EQ(server.map().robot_tiles(3), nullptr) << note;
    EXPECT_TRUE(server.robots().back().apart) << note;
    EXPECT_FALSE(server.robots().back().pose.has_value()) << note;
    EXPECT_FALSE(server.robots().front().apart) << note;
  };
  expect_apart("at first");
  team.stop_server();
  team.start_server();
  ASSERT_TRUE(team.settle(60 * kSecond));
  expect_apart("after a restart of the server");
  EXPECT_FALSE(team.link(2).take_frame().has_value());

  explore_floor(team, 0);
  std::optional<Pose> frame;
  for (int i = 0; i < 80 && !frame; ++i) {
    team.run(kSecond);
    frame = team.link(2).take_frame();
  }
  ASSERT_TRUE(frame.has_value());
  EXPECT_NEAR(std::abs(frame->heading.degrees()), 180, 0.3);
  EXPECT_NEAR(frame->position.x_um, (corner.x + 1) * 50'000, 20'000);
  EXPECT_NEAR(frame->position.y_um, (corner.y + 1) * 50'000, 20'000);
  team.turn_half(2, corner);
  team.link(2).move_frame();
  for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
    team.link(2).mark_dirty(layer, kWindow);
  }
  ASSERT_TRUE(team.settle(60 * kSecond));
  team.expect_consistent("joined");
  EXPECT_TRUE(team.server().apart_maps().empty());
  EXPECT_TRUE(team.server().robots().back().pose.has_value());
  team.stop_server();
  team.start_server();
  ASSERT_TRUE(team.settle(60 * kSecond));
  team.expect_consistent("after another restart");
  EXPECT_TRUE(team.server().apart_maps().empty());
}

TEST(MapServer, CommandsAreRepeatedUntilAcknowledged) {
  Team team(2);
  ASSERT_TRUE(team.settle(5 * kSecond));
  team.radio(0).set_partitioned(true);
  team.server().send_command_to_all(CommandCode::kReturn);
  team.run(2 * kSecond);
  team.radio(0).set_partitioned(false);
  team.run(2 * kSecond);
  EXPECT_EQ(team.link(0).take_command(), CommandCode::kReturn);
  EXPECT_EQ(team.link(1).take_command(), CommandCode::kReturn);
  team.server().send_command(2, CommandCode::kStop);
  team.run(2 * kSecond);
  EXPECT_FALSE(team.link(0).take_command().has_value());
  EXPECT_EQ(team.link(1).take_command(), CommandCode::kStop);
}

TEST(MapServer, CellsOfAnotherSizeAreRefused) {
  Team team(1);
  ASSERT_TRUE(team.settle(5 * kSecond));
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  MapUpdateWriter writer(body_of(out), 15625, {});
  ASSERT_EQ(writer.add(Layer::kVisits, {0, 0, 1, 1}, std::vector<std::uint8_t>{1}), Status::kOk);
  const auto size = seal_datagram({1, 10, 1000, 1, MessageKind::kMapUpdate}, writer.size(), out,
                                  kPlainSeal, team.server().boot());
  team.server().receive(address_of(1), std::span(out).first(*size), team.now_us());
  EXPECT_EQ(team.server().counters().dropped_cell_size, 1u);
  EXPECT_EQ(team.server().map().explored_cells(), 0u);
}

TEST(MapServer, ADelayedDatagramFromBeforeTheRobotsRestartIsDropped) {
  Team team(1);
  ASSERT_TRUE(team.settle(5 * kSecond));
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  MapUpdateWriter writer(body_of(out), 50000, {});
  ASSERT_EQ(writer.add(Layer::kVisits, {0, 0, 1, 1}, std::vector<std::uint8_t>{1}), Status::kOk);
  const auto size = seal_datagram({1, 9, 1000, 1, MessageKind::kMapUpdate}, writer.size(), out,
                                  kPlainSeal, team.server().boot());
  team.server().receive(address_of(1), std::span(out).first(*size), team.now_us());
  EXPECT_EQ(team.server().counters().dropped_stale, 1u);
}

TEST(MapServer, LimitsAreKeptWhateverComes) {
  Team team(1);
  MapServerConfig config;
  config.max_robots = 2;
  config.max_tiles = 4;
  ScratchFolder folder;
  RunDatabase database(folder / "run.db");
  MapServer server(database, team, 1, config);
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  for (std::uint16_t robot = 1; robot <= 3; ++robot) {
    for (std::int32_t i = 0; i < 5; ++i) {
      MapUpdateWriter writer(body_of(out), 50000, {});
      ASSERT_EQ(writer.add(Layer::kVisits, {i * 1000, 0, 1, 1}, std::vector<std::uint8_t>{1}),
                Status::kOk);
      const auto size =
          seal_datagram({robot, 1, static_cast<std::uint32_t>(i + 1), 1, MessageKind::kMapUpdate},
                        writer.size(), out, kPlainSeal, server.boot());
      server.receive(address_of(1), std::span(out).first(*size), kSecond);
    }
  }
  EXPECT_EQ(server.robot_count(), 2u);
  EXPECT_EQ(server.map().tile_count(), 4u);
  EXPECT_EQ(server.counters().dropped_full, 11u);
}

TEST(MapServer, GarbageIsCountedAndDropped) {
  Team team(1);
  std::mt19937 random(1);
  for (int i = 0; i < 20000; ++i) {
    std::vector<std::uint8_t> bytes(random() % 60);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() & 0xffu);
    team.server().receive(address_of(1), bytes, kSecond);
  }
  EXPECT_EQ(team.server().counters().dropped(), 20000u);
  EXPECT_EQ(team.server().robot_count(), 0u);
}

// Right envelopes around wrong bodies: what a hostile robot could send.
TEST(MapServer, RandomBodiesInRightEnvelopesNeverHarm) {
  Team team(1);
  ASSERT_TRUE(team.settle(5 * kSecond));
  std::mt19937 random(2);
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  for (std::uint32_t i = 0; i < 20000; ++i) {
    const std::size_t size = random() % 60;
    for (std::size_t k = 0; k < size; ++k) {
      body_of(out)[k] = static_cast<std::uint8_t>(random() & 0xffu);
    }
    const auto kind = static_cast<MessageKind>(1 + random() % 6);
    const auto sealed = seal_datagram({2, 1, i + 1, 2, kind}, size, out, kPlainSeal,
                                      random() % 4 == 0 ? 0 : team.server().boot());
    team.server().receive(address_of(1), std::span(out).first(*sealed), team.now_us());
  }
  team.run(kSecond);
  EXPECT_LE(team.server().robot_count(), 2u);
}

}  // namespace
}  // namespace ivfm::host
