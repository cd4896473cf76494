#include "firmware/link/map_link.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <tuple>
#include <utility>
#include <vector>

#include "firmware/hal/fake/fake_datagram.h"
#include "tests/support/fake_map.h"

namespace ivfm {
namespace {

using fake::for_each_cell;
using fake::SmallMap;

constexpr TimeUs kSecond = 1000000;
constexpr TimeUs kTick = 50000;

// What the real server does, in its simplest form: welcome, merge, acknowledge, hand cells back.
class ServerModel {
 public:
  ServerModel(DatagramSocket& socket, std::uint32_t epoch) : socket_(socket), epoch_(epoch) {}

  void step() {
    std::array<std::uint8_t, kMaxDatagramBytes> buffer;
    while (true) {
      const auto size = socket_.receive(buffer);
      if (!size.ok()) break;
      const auto opened =
          open_datagram(std::span(buffer).first(*size), kPlainSeal, {false, epoch_});
      if (!opened.ok()) continue;
      robot_boot = opened->header.boot;
      if (opened->bound) {
        take(opened->header, opened->body);
      } else {
        last_hello = *decode_hello(opened->body);
        send(MessageKind::kWelcome, *encode(welcome, body_of(out_)));
      }
    }
  }
  void send_command(CommandCode code, std::uint32_t revision) {
    send(MessageKind::kCommand, *encode(Command{code, revision}, body_of(out_)));
  }
  void send_places(const RobotPlaces& places) {
    send(MessageKind::kPlaces, *encode(places, body_of(out_)));
  }
  void send_frame(const MapFrame& frame) {
    send(MessageKind::kMapFrame, *encode(frame, body_of(out_)));
  }
  std::uint32_t send_region(Layer layer, const CellRect& rect, std::vector<std::uint8_t> cells,
                            std::int32_t cell_um = 50000) {
    MapUpdateWriter writer(body_of(out_), cell_um, {});
    EXPECT_EQ(writer.add(layer, rect, cells), Status::kOk);
    return send(MessageKind::kServerMapUpdate, writer.size());
  }
  // Hands back a region of the robot's own, as the answer to a request from `from`.
  void send_own(const RestoreCursor& from, const RestoreCursor& next, const CellRect& rect,
                std::vector<std::uint8_t> cells) {
    static_cast<void>(encode(RestoreHeader{from, next}, body_of(out_)));
    MapUpdateWriter writer(body_of(out_).subspan(kRestoreHeaderBytes), 50000, {});
    EXPECT_EQ(writer.add(Layer::kVisits, rect, cells), Status::kOk);
    send(MessageKind::kRestore, kRestoreHeaderBytes + writer.size());
  }
  std::uint8_t value(Layer layer, Cell c) const {
    const auto it = cells_.find({layer, c.x, c.y});
    return it == cells_.end() ? std::uint8_t{0} : it->second.second;
  }
  void start_again(std::uint32_t epoch) {
    epoch_ = epoch;
    sequence = 0;
  }

  std::map<MessageKind, int> received;
  Acknowledgement last_acknowledgement;
  FoundReport found;
  RobotStatus status;
  Hello last_hello;
  std::vector<RestoreRequest> restore_requests;
  Welcome welcome{9, true, false};
  std::uint64_t robot_boot = 1;
  std::uint32_t sequence = 0;

 private:
  void take(const DatagramHeader& header, std::span<const std::uint8_t> body) {
    ++received[header.kind];
    switch (header.kind) {
      case MessageKind::kAcknowledgement:
        last_acknowledgement = *decode_acknowledgement(body);
        return;
      case MessageKind::kStatus: status = *decode_robot_status(body); return;
      case MessageKind::kRestoreRequest:
        restore_requests.push_back(*decode_restore_request(body));
        return;
      case MessageKind::kHello: last_hello = *decode_hello(body); break;
      case MessageKind::kFound: found = *decode_found_report(body); break;
      default: merge(header.sequence, body); break;
    }
    send(MessageKind::kServerAcknowledgement,
         *encode(Acknowledgement{header.sequence, 0}, body_of(out_)));
  }
  void merge(std::uint32_t update, std::span<const std::uint8_t> body) {
    std::array<std::uint8_t, kMaxBlockCells> buffer;
    MapUpdateReader reader(body);
    while (true) {
      const auto region = reader.next(buffer);
      if (!region.ok()) {
        EXPECT_EQ(region.status(), Status::kEmpty);
        return;
      }
      std::size_t i = 0;
      for_each_cell(region->rect, [&](Cell c) {
        auto& [newest, value] = cells_[{region->layer, c.x, c.y}];
        const std::uint8_t sent = region->cells[i++];
        if (region->layer == Layer::kVisits) {
          value = std::max(value, sent);
        } else if (update > newest) {
          newest = update;
          value = sent;
        }
      });
    }
  }
  std::uint32_t send(MessageKind kind, std::size_t size) {
    const DatagramHeader header{1, epoch_, ++sequence, epoch_, kind};
    static_cast<void>(socket_.send(
        std::span(out_).first(*seal_datagram(header, size, out_, kPlainSeal, robot_boot))));
    return sequence;
  }

  DatagramSocket& socket_;
  std::uint32_t epoch_;  // its boot, too
  std::array<std::uint8_t, kMaxDatagramBytes> out_{};
  std::map<std::tuple<Layer, int, int>, std::pair<std::uint32_t, std::uint8_t>> cells_;
};

class MapLinkTest : public testing::Test {
 protected:
  static MapLinkConfig config() {
    MapLinkConfig config;
    config.epoch = 9;
    config.name = "r1";
    return config;
  }
  explicit MapLinkTest(const MapLinkConfig& config = MapLinkTest::config())
      : link_(map_, radio_.robot(), config) {}
  // Lets both sides work for `duration_us`.
  void run(TimeUs duration_us) {
    for (const TimeUs end = now_ + duration_us; now_ < end; now_ += kTick) {
      radio_.set_now(now_);
      link_.step(now_, {});
      server_.step();
    }
  }
  void visit(const CellRect& rect) {
    map_.visit(rect);
    link_.mark_dirty(Layer::kVisits, rect);
  }
  void expect_server_has_everything() {
    for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
      for_each_cell(map_.window(), [&](Cell c) {
        ASSERT_EQ(server_.value(layer, c), map_.own(layer, c)) << c.x << ' ' << c.y;
      });
    }
  }

  TimeUs now_ = 5 * kSecond;
  FakeRadio radio_{1};
  SmallMap map_{{-50, -40, 300, 90}};
  MapLink link_;
  ServerModel server_{radio_.server(), 100};
};

TEST_F(MapLinkTest, IntroducesItselfUntilAcknowledged) {
  radio_.set_partitioned(true);
  run(3 * kSecond);
  EXPECT_FALSE(link_.all_acknowledged());
  radio_.set_partitioned(false);
  run(5 * kSecond);
  EXPECT_EQ(server_.received[MessageKind::kHello], 1);
  EXPECT_TRUE(link_.all_acknowledged());
}

TEST_F(MapLinkTest, MarkedCellsArriveAndAreAcknowledged) {
  visit({-10, -5, 20, 10});
  EXPECT_FALSE(link_.is_acknowledged(Layer::kVisits, {0, 0, 1, 1}));
  run(kSecond);
  expect_server_has_everything();
  EXPECT_TRUE(link_.all_acknowledged());
  EXPECT_TRUE(link_.is_acknowledged(Layer::kVisits, {0, 0, 1, 1}));
  EXPECT_EQ(link_.counters().retransmissions, 0u);
}

TEST_F(MapLinkTest, UpdatesAreBatchedAndFlushSendsAtOnce) {
  run(2 * kSecond);
  visit({0, 0, 5, 5});
  run(kTick);
  visit({1, 0, 5, 5});
  run(kSecond - 2 * kTick);
  EXPECT_EQ(server_.received[MessageKind::kMapUpdate], 1);
  link_.flush();
  run(2 * kTick);
  EXPECT_EQ(server_.received[MessageKind::kMapUpdate], 2);
  expect_server_has_everything();
}

TEST_F(MapLinkTest, ACellThatChangesWhileOnItsWayIsSentAgain) {
  run(kSecond);
  visit({0, 0, 5, 5});
  link_.flush();
  radio_.set_now(now_);
  link_.step(now_, {});  // on its way
  visit({2, 2, 1, 1});
  run(3 * kSecond);
  EXPECT_EQ(server_.value(Layer::kVisits, {2, 2}), 2);
  expect_server_has_everything();
}

TEST_F(MapLinkTest, ASilentServerIsAskedEverMoreSeldomAndNothingIsLost) {
  run(kSecond);
  radio_.set_partitioned(true);
  const auto before = radio_.sent();
  for (int i = 0; i < 100; ++i) {
    visit({-50 + 2 * i, -40 + (i * 37) % 80, 9, 7});
    run(kSecond);
  }
  // 100 status messages and a handful of attempts.
  EXPECT_LT(radio_.sent() - before, 130u);
  radio_.set_partitioned(false);
  run(40 * kSecond);
  EXPECT_TRUE(link_.all_acknowledged());
  expect_server_has_everything();
}

TEST_F(MapLinkTest, AHugeRectangleOfNoiseIsSplitBelow1200Bytes) {
  std::mt19937 random(3);
  for_each_cell(map_.window(), [&](Cell c) {
    map_.set_own(Layer::kVisits, c, static_cast<std::uint8_t>(random() & 0xffu));
    map_.set_own(Layer::kObstacles, c, static_cast<std::uint8_t>(random() & 1u));
  });
  link_.mark_dirty(Layer::kVisits, map_.window());
  link_.mark_dirty(Layer::kObstacles, map_.window());
  run(10 * kSecond);
  EXPECT_LT(radio_.largest_datagram(), 1200u);
  expect_server_has_everything();
  EXPECT_EQ(link_.counters().retransmissions, 0u);
}

TEST_F(MapLinkTest, WhatTheOthersSawIsWrittenAndAcknowledged) {
  run(kSecond);
  const auto sequence = server_.send_region(Layer::kVisits, {-50, -40, 2, 1}, {3, 4});
  run(kSecond);
  EXPECT_EQ(map_.peers(Layer::kVisits, {-50, -40}), 3);
  EXPECT_EQ(map_.peers(Layer::kVisits, {-49, -40}), 4);
  EXPECT_TRUE(server_.last_acknowledgement.covers(sequence));
}

TEST_F(MapLinkTest, AnOlderUpdateNeverReplacesANewerOne) {
  radio_.set_partitioned(true);
  const auto old_sequence = server_.send_region(Layer::kObstacles, {0, 0, 1, 1}, {0});
  radio_.set_partitioned(false);
  const auto sequence = server_.send_region(Layer::kObstacles, {0, 0, 1, 1}, {1});
  run(kSecond);
  server_.sequence = old_sequence - 1;  // what a delayed datagram looks like
  server_.send_region(Layer::kObstacles, {0, 0, 1, 1}, {0});
  run(kSecond);
  EXPECT_EQ(map_.peers(Layer::kObstacles, {0, 0}), 1);
  EXPECT_TRUE(server_.last_acknowledgement.covers(sequence));
  EXPECT_FALSE(server_.last_acknowledgement.covers(old_sequence));
  EXPECT_EQ(link_.counters().dropped_stale, 1u);
}

TEST_F(MapLinkTest, TheNewestPlacesOfOtherRobotsAreKnown) {
  RobotPlaces two;
  two.size = 2;
  two.storage[0] = {float16_from_um(1'500'000), float16_from_um(-2'000'000), 30};
  two.storage[1] = {float16_from_um(-1'000'000), 0, 0};
  run(kSecond);
  EXPECT_TRUE(link_.peers().empty());
  const TimeUs before = now_;
  const std::uint32_t old_sequence = server_.sequence;
  server_.send_places({});
  server_.send_places(two);
  run(kSecond);
  ASSERT_EQ(link_.peers().size(), 2u);
  EXPECT_EQ(link_.peers()[0].position, (Point{1'500'000, -2'000'000}));
  EXPECT_EQ(link_.peers()[0].told_us + 300'000, link_.peers()[1].told_us);
  EXPECT_GE(link_.peers()[1].told_us, before);
  server_.sequence = old_sequence;  // what a delayed datagram looks like
  server_.send_places({});
  run(kSecond);
  EXPECT_EQ(link_.peers().size(), 2u);
  server_.sequence += 10;
  server_.send_places({});
  run(kSecond);
  EXPECT_TRUE(link_.peers().empty());
}

TEST_F(MapLinkTest, ARestartedServerIsUnderstoodAndItsFormerSelfIgnored) {
  server_.send_region(Layer::kVisits, {0, 0, 1, 1}, {1});
  run(kSecond);
  server_.start_again(101);
  server_.send_region(Layer::kVisits, {0, 0, 1, 1}, {2});
  run(kSecond);
  EXPECT_EQ(map_.peers(Layer::kVisits, {0, 0}), 2);
  server_.start_again(100);
  server_.send_region(Layer::kVisits, {0, 0, 1, 1}, {9});
  run(kSecond);
  EXPECT_EQ(map_.peers(Layer::kVisits, {0, 0}), 2);
}

TEST_F(MapLinkTest, ARestartedServerIsNoticedAndGetsTheRestAndNothingTwice) {
  visit({0, 0, 10, 10});
  run(3 * kSecond);
  server_.start_again(101);
  const int updates = server_.received[MessageKind::kMapUpdate];
  visit({20, 0, 10, 10});
  run(10 * kSecond);
  EXPECT_TRUE(server_.last_hello.resuming);
  EXPECT_TRUE(link_.all_acknowledged());
  expect_server_has_everything();
  EXPECT_EQ(server_.received[MessageKind::kMapUpdate], updates + 1);
}

TEST_F(MapLinkTest, AnIdleLinkFindsARestartedServerToo) {
  run(3 * kSecond);
  server_.start_again(101);
  run(8 * kSecond);
  EXPECT_EQ(server_.received[MessageKind::kHello], 2);
}

TEST_F(MapLinkTest, AServerThatHasLostEverythingGetsEverythingAgain) {
  visit({0, 0, 10, 10});
  run(3 * kSecond);
  ServerModel other(radio_.server(), 101);
  other.welcome = {10, false, false};
  for (const TimeUs end = now_ + 20 * kSecond; now_ < end; now_ += kTick) {
    radio_.set_now(now_);
    link_.step(now_, {});
    other.step();
  }
  EXPECT_EQ(other.value(Layer::kVisits, {5, 5}), 1);
  EXPECT_EQ(link_.epoch(), 10u);
}

TEST_F(MapLinkTest, InANewFrameNothingButHellosLeavesUntilTheServerKnows) {
  visit({0, 0, 5, 5});
  run(3 * kSecond);
  const std::uint32_t epoch = link_.epoch();
  server_.send_region(Layer::kVisits, {-50, -40, 2, 1}, {3, 4});  // to be acknowledged
  link_.move_frame();
  visit({10, 0, 5, 5});
  link_.flush();
  const auto before = server_.received;
  for (const TimeUs end = now_ + 3 * kSecond; now_ < end; now_ += kTick) {  // a silent server
    radio_.set_now(now_);
    link_.step(now_, {});
  }
  server_.step();
  for (const auto& [kind, count] : server_.received) {
    if (kind == MessageKind::kHello) continue;
    EXPECT_EQ(count, before.at(kind)) << static_cast<int>(kind);
  }
  EXPECT_TRUE(server_.last_hello.moved_frame);
  EXPECT_EQ(link_.epoch(), epoch + 1);
  run(5 * kSecond);
  EXPECT_EQ(server_.value(Layer::kVisits, {12, 2}), 1);
  EXPECT_TRUE(link_.all_acknowledged());
}

// The robot says `kWhat` of its start.
template <bool MapLinkConfig::*kWhat>
class UnsureLinkTest : public MapLinkTest {
 protected:
  UnsureLinkTest() : MapLinkTest(unsure()) {}
  static MapLinkConfig unsure() {
    MapLinkConfig unsure = config();
    unsure.*kWhat = true;
    return unsure;
  }
};
using ApartLinkTest = UnsureLinkTest<&MapLinkConfig::apart>;
using RoughLinkTest = UnsureLinkTest<&MapLinkConfig::rough>;

TEST_F(ApartLinkTest, ARobotThatDoesNotKnowWhereItIsSaysSoBeforeAllElseAndMovesOnceItIsTold) {
  visit({0, 0, 5, 5});
  run(kTick);
  run(kTick);  // welcomed; the hello that tells the present server has not been answered yet
  EXPECT_EQ(server_.received[MessageKind::kMapUpdate] + server_.received[MessageKind::kStatus], 0);
  EXPECT_TRUE(server_.last_hello.apart);
  run(3 * kSecond);
  EXPECT_EQ(server_.value(Layer::kVisits, {2, 2}), 1);
  EXPECT_FALSE(link_.take_frame().has_value());
  const Pose frame{{1'000'000, 2'000'000}, BinaryAngle::from_degrees(137)};
  server_.send_frame({link_.epoch() - 1, frame});
  run(kSecond);
  EXPECT_FALSE(link_.take_frame().has_value()) << "of another epoch";
  server_.send_frame({link_.epoch(), frame});
  run(kSecond);
  EXPECT_EQ(link_.take_frame(), frame);
  link_.move_frame();
  run(3 * kSecond);
  EXPECT_FALSE(server_.last_hello.apart);
  EXPECT_TRUE(server_.last_hello.moved_frame);
  EXPECT_FALSE(server_.restore_requests.empty());
  server_.send_frame({link_.epoch(), frame});
  run(kSecond);
  EXPECT_FALSE(link_.take_frame().has_value()) << "it is part of the team";
}

TEST_F(RoughLinkTest, ARobotWithARoughStartSaysSoUntilItIsToldThatItsFrameHolds) {
  run(2 * kSecond);
  EXPECT_TRUE(server_.last_hello.rough);
  EXPECT_GT(server_.received[MessageKind::kStatus], 0) << "it is part of the team all the same";
  server_.send_frame({link_.epoch(), {}});
  run(2 * kSecond);
  EXPECT_EQ(link_.take_frame(), Pose{});
  const std::uint32_t epoch = link_.epoch();
  link_.end_rough();
  run(2 * kSecond);
  EXPECT_FALSE(server_.last_hello.rough);
  EXPECT_EQ(link_.epoch(), epoch);
}

TEST_F(MapLinkTest, NothingButAHelloLeavesBeforeTheWelcome) {
  visit({0, 0, 10, 10});
  radio_.set_now(now_);
  link_.step(now_, {});
  link_.report_found({1, 2});
  link_.step(now_ + kTick, {});
  EXPECT_EQ(link_.counters().datagrams_sent, 1u);
  EXPECT_FALSE(link_.all_acknowledged());
}

TEST_F(MapLinkTest, OwnCellsOfBeforeTheRestartAreAddedOnceAndOnlyThenIsTheMapSent) {
  server_.welcome = {12, false, true};
  visit({0, 0, 2, 1});
  run(2 * kSecond);
  EXPECT_EQ(link_.epoch(), 12u);
  EXPECT_EQ(server_.received[MessageKind::kMapUpdate], 0);
  ASSERT_FALSE(server_.restore_requests.empty());
  EXPECT_EQ(server_.restore_requests.back().from, RestoreCursor{});
  const RestoreCursor second{0, 3, 0};
  for (int i = 0; i < 3; ++i) server_.send_own({}, second, {1, 0, 2, 1}, {5, 6});
  run(kSecond);
  EXPECT_EQ(server_.restore_requests.back().from, second);
  EXPECT_EQ(map_.own(Layer::kVisits, {0, 0}), 1);
  EXPECT_EQ(map_.own(Layer::kVisits, {1, 0}), 6);
  EXPECT_EQ(map_.own(Layer::kVisits, {2, 0}), 6);
  EXPECT_FALSE(link_.all_acknowledged());
  server_.send_own(second, {.layer = RestoreCursor::kEnd}, {96, 0, 1, 1}, {7});
  run(2 * kSecond);
  EXPECT_EQ(map_.own(Layer::kVisits, {96, 0}), 7);
  EXPECT_EQ(server_.value(Layer::kVisits, {1, 0}), 6);
  EXPECT_EQ(link_.counters().cells_restored, 3u);
  EXPECT_TRUE(link_.all_acknowledged());
}

TEST_F(MapLinkTest, TheServerHearsOfAWindowThatMoves) {
  link_.clip({0, 0, 100, 100});
  run(kSecond);
  link_.clip({50, 0, 100, 100});
  run(kSecond);
  EXPECT_EQ(server_.received[MessageKind::kHello], 2);
  EXPECT_EQ(server_.last_hello.window, (CellRect{50, 0, 100, 100}));
}

TEST_F(MapLinkTest, ADatagramIsTakenOnce) {
  run(kSecond);
  RadioFaults faults;
  faults.duplicate = 1;
  radio_.set_faults(faults);
  server_.send_command(CommandCode::kStop, 1);
  run(kSecond);
  EXPECT_EQ(link_.take_command(), CommandCode::kStop);
  EXPECT_GT(link_.counters().dropped_replayed, 0u);
}

TEST_F(MapLinkTest, CellsOfAnotherSizeAreNotTaken) {
  server_.send_region(Layer::kVisits, {0, 0, 1, 1}, {1}, 15625);
  run(kSecond);
  EXPECT_EQ(map_.peers(Layer::kVisits, {0, 0}), 0);
  EXPECT_EQ(link_.counters().dropped_cell_size, 1u);
}

TEST_F(MapLinkTest, TheNewestCommandIsDeliveredOnce) {
  EXPECT_FALSE(link_.take_command().has_value());
  server_.send_command(CommandCode::kReturn, 2);
  server_.send_command(CommandCode::kStart, 1);
  server_.send_command(CommandCode::kReturn, 2);
  run(kSecond);
  EXPECT_EQ(link_.take_command(), CommandCode::kReturn);
  EXPECT_FALSE(link_.take_command().has_value());
  server_.send_command(CommandCode::kStop, 3);
  run(kSecond);
  EXPECT_EQ(link_.take_command(), CommandCode::kStop);
}

TEST_F(MapLinkTest, FoundIsReportedUntilAcknowledged) {
  run(kSecond);
  radio_.set_partitioned(true);
  link_.report_found({1000, -2000});
  run(kSecond);
  radio_.set_partitioned(false);
  run(5 * kSecond);
  EXPECT_EQ(server_.received[MessageKind::kFound], 1);
  EXPECT_EQ(server_.found.target, (Point{1000, -2000}));
  EXPECT_TRUE(link_.all_acknowledged());
}

TEST_F(MapLinkTest, StatusCarriesWhatTheAgentSays) {
  RobotStatus status;
  status.state = 3;
  status.goal = {5, -6};
  link_.set_status(status);
  run(3 * kSecond);
  EXPECT_EQ(server_.received[MessageKind::kStatus], 3);
  EXPECT_EQ(server_.status.state, 3);
  EXPECT_EQ(server_.status.goal, (Cell{5, -6}));
  EXPECT_GT(server_.status.datagrams_sent, 1u);
}

TEST_F(MapLinkTest, GarbageIsCountedAndChangesNothing) {
  std::mt19937 random(4);
  for (int i = 0; i < 2000; ++i) {
    std::vector<std::uint8_t> bytes(random() % (kMaxDatagramBytes + 10));
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() & 0xffu);
    static_cast<void>(radio_.server().send(bytes));
    run(kTick);
  }
  const MapLinkCounters& counters = link_.counters();
  EXPECT_EQ(counters.dropped_malformed + counters.dropped_misdirected + counters.dropped_refused,
            2000u);
}

TEST_F(MapLinkTest, DatagramsForOthersAndReflectedOnesAreDropped) {
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto send = [&](const DatagramHeader& header, std::uint64_t receiver) {
    const auto size = encode(Command{CommandCode::kStop, 1}, body_of(out));
    static_cast<void>(radio_.server().send(
        std::span(out).first(*seal_datagram(header, *size, out, kPlainSeal, receiver))));
  };
  run(kSecond);
  send({2, 100, 1001, 100, MessageKind::kCommand}, 1);  // another robot
  send({1, 100, 1002, 100, MessageKind::kStatus}, 1);   // a robot's kind
  send({1, 100, 1003, 100, MessageKind::kCommand}, 2);  // an earlier start
  send({1, 100, 1004, 100, MessageKind::kCommand}, 0);
  run(kSecond);
  EXPECT_FALSE(link_.take_command().has_value());
  EXPECT_EQ(link_.counters().dropped_misdirected, 1u);
  EXPECT_EQ(link_.counters().dropped_refused, 3u);
}

TEST_F(MapLinkTest, AFullSocketKeepsTheCellsDirty) {
  run(kSecond);
  radio_.set_send_status(Status::kFull);
  visit({0, 0, 20, 20});
  run(5 * kSecond);
  EXPECT_FALSE(link_.all_acknowledged());
  EXPECT_GT(link_.counters().send_failures, 0u);
  radio_.set_send_status(Status::kOk);
  run(kSecond);
  EXPECT_TRUE(link_.all_acknowledged());
  expect_server_has_everything();
}

TEST_F(MapLinkTest, AMissingRouteIsLikeASilentServer) {
  radio_.set_send_status(Status::kUnavailable);
  visit({0, 0, 20, 20});
  run(5 * kSecond);
  radio_.set_send_status(Status::kOk);
  run(20 * kSecond);
  EXPECT_TRUE(link_.all_acknowledged());
  expect_server_has_everything();
}

TEST_F(MapLinkTest, WhatLeavesTheWindowIsGivenUpAndCounted) {
  run(kSecond);
  radio_.set_partitioned(true);
  visit({-50, 0, 10, 1});
  visit({100, 0, 10, 1});
  run(kTick);  // on its way, to be lost
  visit({-50, 10, 5, 1});
  link_.clip({0, -40, 250, 90});
  EXPECT_EQ(link_.counters().cells_lost, 5u);
  run(3 * kSecond);
  EXPECT_EQ(link_.counters().cells_lost, 15u);
  radio_.set_partitioned(false);
  run(20 * kSecond);
  EXPECT_TRUE(link_.all_acknowledged());
  EXPECT_EQ(server_.value(Layer::kVisits, {105, 0}), 1);
}

TEST(MapLinkRate, StaysBelowTheConfiguredRate) {
  FakeRadio radio(1);
  SmallMap map({0, 0, 250, 250});
  MapLinkConfig config;
  config.bytes_per_second = 1000;
  MapLink link(map, radio.robot(), config);
  ServerModel server(radio.server(), 1);
  std::mt19937 random(5);
  for_each_cell(map.window(), [&](Cell c) {
    map.set_own(Layer::kVisits, c, static_cast<std::uint8_t>(random() & 0xffu));
  });
  link.mark_dirty(Layer::kVisits, map.window());
  for (TimeUs now = 0; now < 60 * kSecond; now += kTick) {
    radio.set_now(now);
    link.step(now, {});
    server.step();
  }
  EXPECT_LT(link.counters().bytes_sent, 64000u);
  EXPECT_GT(link.counters().bytes_sent, 52000u);
  EXPECT_GT(server.received[MessageKind::kStatus], 30) << "the map does not crowd it out";
  for (TimeUs now = 60 * kSecond; now < 120 * kSecond; now += kTick) {
    radio.set_now(now);
    link.step(now, {});
    server.step();
  }
  EXPECT_TRUE(link.all_acknowledged());
}

TEST(MapLinkProperty, AfterTheRadioIsBackTheServersMapIsTheRobots) {
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    std::mt19937 random(seed);
    FakeRadio radio(
        seed + 1000,
        {.drop = 0.3, .duplicate = 0.1, .corrupt = 0.05, .truncate = 0.05, .jitter_us = 400000});
    SmallMap map({-60, -60, 120, 120});
    MapLinkConfig config;
    config.batch_period_us = 200000 + random() % 1000000;
    MapLink link(map, radio.robot(), config);
    ServerModel server(radio.server(), 1);
    const TimeUs faulty_until = 40 * kSecond;
    TimeUs now = 1;
    for (; now < faulty_until || (!link.all_acknowledged() && now < 300 * kSecond); now += kTick) {
      radio.set_now(now);
      radio.set_partitioned(now < faulty_until && (now / (5 * kSecond)) % 3 == seed % 3);
      if (now >= faulty_until) radio.set_faults({});
      if (now < faulty_until && random() % 3 == 0) {
        const Layer layer = random() % 2 ? Layer::kVisits : Layer::kObstacles;
        const CellRect rect{static_cast<std::int32_t>(random() % 100) - 60,
                            static_cast<std::int32_t>(random() % 100) - 60,
                            static_cast<std::int32_t>(1 + random() % 20),
                            static_cast<std::int32_t>(1 + random() % 20)};
        if (layer == Layer::kVisits) {
          map.visit(rect);
        } else {
          for_each_cell(rect, [&](Cell c) {
            map.set_own(layer, c, static_cast<std::uint8_t>(random() & 1u));
          });
        }
        link.mark_dirty(layer, rect);
      }
      link.step(now, {});
      server.step();
    }
    ASSERT_TRUE(link.all_acknowledged()) << "seed " << seed;
    for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
      for_each_cell(map.window(), [&](Cell c) {
        ASSERT_EQ(server.value(layer, c), map.own(layer, c)) << "seed " << seed;
      });
    }
  }
}

TEST(MapLinkMemory, FitsTheMicrocontroller) { EXPECT_LE(sizeof(MapLink), 12u * 1024u); }

}  // namespace
}  // namespace ivfm
