#include "host/dashboard/live_state.h"

#include <gtest/gtest.h>

#include <array>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/map_server/scratch_folder.h"
#include "shared/wire/datagram.h"
#include "shared/wire/map_update.h"

namespace ivfm::host {
namespace {

using nlohmann::json;

constexpr std::size_t kTileBytes = 8 + 1024 + 128;

struct NoSender final : DatagramSender {
  void send(const PeerAddress&, std::span<const std::uint8_t>) override {}
};

// A server with robots that say what a test wants.
class LiveStateTest : public testing::Test {
 protected:
  void say(std::uint16_t robot, Layer layer, const CellRect& rect, std::uint8_t value,
           const Pose& pose = {}) {
    std::array<std::uint8_t, kMaxDatagramBytes> out;
    MapUpdateWriter writer(body_of(out), 50000, pack_pose(pose));
    const std::vector<std::uint8_t> cells(static_cast<std::size_t>(rect.area()), value);
    ASSERT_EQ(writer.add(layer, rect, cells), Status::kOk);
    const DatagramHeader header{robot, 1, ++sequence_, robot, MessageKind::kMapUpdate};
    const std::size_t size = *seal_datagram(header, writer.size(), out, kPlainSeal, server_.boot());
    now_us_ += 100000;
    server_.receive({}, std::span(out).first(size), now_us_);
    server_.step(now_us_);
  }
  // The head of an answer; its tiles go to tiles_.
  json ask(const std::string& run, std::uint64_t since) {
    state_.update(server_, now_us_);
    const std::string answer = state_.changes(run, since);
    std::size_t size = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      size |= static_cast<std::size_t>(static_cast<std::uint8_t>(answer[i])) << 8 * i;
    }
    tiles_ = answer.substr(4 + size);
    EXPECT_EQ(tiles_.size() % kTileBytes, 0u);
    return json::parse(answer.substr(4, size));
  }
  std::size_t tile_count() const { return tiles_.size() / kTileBytes; }
  unsigned byte(std::size_t at) const { return static_cast<std::uint8_t>(tiles_.at(at)); }

  ScratchFolder folder_;
  RunDatabase database_{folder_ / "run.db"};
  NoSender sender_;
  MapServer server_{database_, sender_, database_.begin_session(0, 1)};
  LiveState state_{"run"};
  std::uint32_t sequence_ = 0;
  TimeUs now_us_ = 0;
  std::string tiles_;
};

TEST_F(LiveStateTest, SendsATileAsPlaceVisitsAndObstacleBits) {
  say(1, Layer::kVisits, {-32, 64, 2, 1}, 7);
  say(2, Layer::kVisits, {-32, 64, 1, 1}, 2);
  say(1, Layer::kObstacles, {-29, 65, 1, 1}, 1);
  const json head = ask("", 0);
  ASSERT_EQ(tile_count(), 1u);
  EXPECT_EQ(tiles_.substr(0, 8), std::string("\xff\xff\xff\xff\x02\0\0\0", 8));
  EXPECT_EQ(byte(8), 9u);
  EXPECT_EQ(byte(9), 7u);
  EXPECT_EQ(byte(10), 0u);
  EXPECT_EQ(byte(8 + 1024 + 4), 1u << 3);  // column 3 of row 1
  EXPECT_EQ(head["explored_cells"], 2);
  EXPECT_EQ(head["obstacle_cells"], 1);
  EXPECT_DOUBLE_EQ(head["cell_m"].get<double>(), 0.05);
}

TEST_F(LiveStateTest, SendsOnlyWhatChanged) {
  say(1, Layer::kVisits, {0, 0, 64, 1}, 1);
  json head = ask("run", 0);
  EXPECT_EQ(tile_count(), 2u);
  EXPECT_EQ(head["robots"].size(), 1u);
  head = ask("run", head["revision"]);
  EXPECT_EQ(tile_count(), 0u);
  EXPECT_TRUE(head["robots"].empty() && head["trails"].empty() && head["samples"].empty());
  say(1, Layer::kVisits, {40, 0, 1, 1}, 2, {{1000000, 0}, {}});
  head = ask("run", head["revision"]);
  EXPECT_EQ(tile_count(), 1u);
  EXPECT_EQ(head["trails"][0]["points"], json::array({json::array({1.0, 0.0})}));
}

TEST_F(LiveStateTest, SendsAllToAPageOfAnotherRun) {
  say(1, Layer::kVisits, {0, 0, 1, 1}, 1);
  const json head = ask("run", 0);
  EXPECT_EQ(ask("earlier", head["revision"])["after"], 0);
  EXPECT_EQ(tile_count(), 1u);
  EXPECT_EQ(ask("run", 1u << 30)["after"], 0);
  EXPECT_EQ(tile_count(), 1u);
}

TEST_F(LiveStateTest, SendsALargeMapInPartsWithoutLossOrRepetition) {
  for (std::int32_t i = 0; i < 1100; ++i) say(1, Layer::kVisits, {i * 32, 0, 1, 1}, 1);
  std::size_t tiles = 0, samples = 0;
  json head{{"revision", 0}, {"more", true}};
  int parts = 0;
  for (; head["more"]; ++parts) {
    head = ask("run", head["revision"]);
    tiles += tile_count();
    samples += head["samples"].size();
  }
  EXPECT_EQ(parts, 2);
  EXPECT_EQ(tiles, 1100u);
  EXPECT_EQ(samples, 1u);
}

TEST_F(LiveStateTest, TellsWhereARobotIsAndWhereItWent) {
  say(4, Layer::kVisits, {0, 0, 1, 1}, 1, {{1000000, -500000}, BinaryAngle::from_radians(1.5)});
  ask("run", 0);
  say(4, Layer::kVisits, {0, 0, 1, 1}, 1, {{1010000, -500000}, {}});  // too near for a point
  ask("run", 0);
  say(4, Layer::kVisits, {0, 0, 1, 1}, 1, {{2000000, -500000}, {}});
  const json head = ask("run", 0);
  const json robot = head["robots"][0];
  EXPECT_EQ(robot["id"], 4);
  EXPECT_EQ(robot["x"], 2.0);
  EXPECT_EQ(robot["y"], -0.5);
  EXPECT_EQ(head["trails"][0]["points"].size(), 2u);
}

TEST_F(LiveStateTest, KnowsTheWayOfARunThatGoesOn) {
  say(1, Layer::kVisits, {0, 0, 1, 1}, 1, {{1000000, 0}, {}});
  say(1, Layer::kVisits, {0, 0, 1, 1}, 1, {{3000000, 0}, {}});
  server_.finish(now_us_);
  state_.restore(folder_ / "run.db");
  EXPECT_EQ(ask("run", 0)["trails"][0]["points"].size(), 2u);
}

TEST_F(LiveStateTest, TellsTheExplorableAreaOnlyIfItIsKnown) {
  EXPECT_EQ(ask("", 0)["explorable_m2"], 0);
  state_.set_explorable(232.5);
  EXPECT_EQ(ask("", 0)["explorable_m2"], 232.5);
}

TEST(LinkHealth, TellsTheShareThatIsLostStretchByStretch) {
  LinkHealth link;
  link.take(100, 90);  // what was before is not known
  EXPECT_EQ(link.lost(), 0);
  link.take(139, 91);  // too few to tell
  EXPECT_EQ(link.lost(), 0);
  link.take(140, 120);
  EXPECT_EQ(link.lost(), 0.25);
  link.take(180, 160);
  EXPECT_EQ(link.lost(), 0);
  link.take(3, 163);  // started again
  EXPECT_EQ(link.lost(), 0);
  link.take(43, 183);
  EXPECT_EQ(link.lost(), 0.5);
}

}  // namespace
}  // namespace ivfm::host
