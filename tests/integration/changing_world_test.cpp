// A robot stands before a door that closes and opens, in simulated time: how soon its own map and
// the map server's have it.
#include <gtest/gtest.h>

#include <cstdio>
#include <memory>

#include "host/simulator/doors.h"
#include "tests/integration/simulated_team.h"

namespace ivfm {
namespace {

// Revolutions of the lidar, 5.5 a second: a cell closes with the second in a row that hits it, and
// opens with the 24th beam through it; the one in which the door moves and beams that get lost are
// more.
constexpr std::uint32_t kToClose = 5, kToOpen = 28;
// The map leaves the robot every 2 s, in batches at least 1 s apart, and is durable 0.1 s later.
constexpr std::uint32_t kToServer = 18;

// Two rooms of 2 m by 2 m in cells of 25 mm; the wall between them, at x = 2 m, has a gap of 0.8 m.
host::World two_rooms() {
  host::World world{"two rooms", 25'000, 168, 88, {-100'000, -100'000}, {}};
  world.occupied.assign(168 * 88, 1);
  for (std::size_t y = 4; y < 84; ++y) {
    for (std::size_t x = 4; x < 164; ++x) {
      const bool wall = x >= 84 && x < 86 && (y < 28 || y >= 60);
      world.occupied[y * 168 + x] = wall ? 1 : 0;
    }
  }
  return world;
}

class StandingRobot : public SimulatedTeam {
 protected:
  StandingRobot() {
    world_ = std::make_shared<host::World>(changing_);
    AgentConfig config = make_agent_config({}, McuProfile::kCellUm, 1);
    config.start = {{600'000, 1'000'000}, {}};
    add_robot(config, config.start, "none");
    robots_[0]->agent().request_stop();
  }
  // Revolutions fused until `condition` holds; more than 100 when it never does.
  template <typename Condition>
  std::uint32_t revolutions_until(Condition condition) {
    const AgentProgress& progress = robots_[0]->agent().progress();
    const std::uint32_t before = progress.scans_fused;
    while (!condition() && progress.scans_fused <= before + 100) tick();
    return progress.scans_fused - before;
  }
  void tick() {
    if (doors_.step(now_us_ + kTickUs, changing_, {}, 0)) {
      robots_[0]->enter(std::make_shared<host::World>(changing_));
    }
    SimulatedTeam::tick();
  }
  void run_until(TimeUs time_us) {
    while (now_us_ < time_us) tick();
  }
  // Cells of the doorway that `is_obstacle`, of its 14 rows without the posts.
  template <typename Query>
  static int rows_closed(Query is_obstacle) {
    int rows = 0;
    for (std::int32_t y = 13; y < 27; ++y) {
      bool closed = false;
      for (std::int32_t x = 39; x <= 41; ++x) closed = closed || is_obstacle(Cell{x, y});
      rows += closed ? 1 : 0;
    }
    return rows;
  }
  int rows_on_board() const {
    const ExplorationMap& map = robots_[0]->agent().explorer().map();
    return rows_closed([&](Cell c) { return map.is_obstacle(c); });
  }
  int rows_on_server() const {
    return rows_closed(
        [&](Cell c) { return team_.server().map().merged_value(Layer::kObstacles, c) != 0; });
  }

  host::World changing_ = two_rooms();
  host::Doors doors_{changing_, {host::parse_door("2,0.6,2.05,1.4@20s+20s")}};
};

TEST_F(StandingRobot, SeesADoorCloseAndOpen) {
  run_until(20 * kSecondUs);
  ASSERT_EQ(rows_on_board(), 0);
  ASSERT_EQ(rows_on_server(), 0);
  const auto closed = revolutions_until([&] { return rows_on_board() == 14; });
  EXPECT_LE(closed, kToClose);
  const auto told = revolutions_until([&] { return rows_on_server() == 14; });
  EXPECT_LE(told, kToServer);
  run_until(40 * kSecondUs);
  ASSERT_EQ(rows_on_board(), 14);
  const auto open = revolutions_until([&] { return rows_on_board() == 0; });
  EXPECT_LE(open, kToOpen);
  const auto told_open = revolutions_until([&] { return rows_on_server() == 0; });
  EXPECT_LE(told_open, kToServer);
  std::printf("closed after %u revolutions, on the server after %u more; open after %u and %u\n",
              closed, told, open, told_open);
}

}  // namespace
}  // namespace ivfm
