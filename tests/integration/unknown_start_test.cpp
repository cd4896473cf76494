// Robots that know nothing of where they start explore apart from the team until the map server has
// found out where their maps lie. In simulated time, with real agents and the real map server.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "tests/integration/simulated_team.h"

namespace ivfm {
namespace {

constexpr double kWorldCellM = 0.025;

// Rectangles of wall in a hall, all in metres.
struct Block {
  double x0, y0, x1, y1;
};
std::shared_ptr<const host::World> hall(double width_m, double height_m,
                                        const std::vector<Block>& blocks) {
  const auto cells = [](double m) { return static_cast<int>(std::lround(m / kWorldCellM)); };
  auto world = std::make_shared<host::World>();
  world->name = "hall";
  world->cell_um = 25'000;
  world->width = cells(width_m) + 8;
  world->height = cells(height_m) + 8;
  world->origin = {-100'000, -100'000};
  world->occupied.assign(static_cast<std::size_t>(world->width * world->height), 1);
  for (int y = 0; y < cells(height_m); ++y) {
    for (int x = 0; x < cells(width_m); ++x) {
      const double x_m = (x + 0.5) * kWorldCellM, y_m = (y + 0.5) * kWorldCellM;
      bool wall = false;
      for (const Block& b : blocks) {
        wall = wall || (x_m > b.x0 && x_m < b.x1 && y_m > b.y0 && y_m < b.y1);
      }
      world->occupied[static_cast<std::size_t>((y + 4) * world->width + x + 4)] = wall ? 1 : 0;
    }
  }
  return world;
}

class UnknownStart : public SimulatedTeam {
 protected:
  // Robot 1 knows where it starts, the others do not.
  void add_robot(const Pose& start) { add_robot(start, robots_.empty()); }
  void add_robot(const Pose& start, bool knows_start) {
    AgentOptions options;
    options.robot_id = static_cast<int>(robots_.size()) + 1;
    options.visit_range_m = 2;
    options.unknown_start = !knows_start;
    AgentConfig config = make_agent_config(options, RobotProfile::kCellUm, 1);
    if (knows_start) config.start = start;
    SimulatedTeam::add_robot(config, start, "mild", replay::ProfileId::kRobot);
  }
  bool is_apart(std::size_t robot) const {
    return robots_[robot]->agent().start_pose() == StartPose::kApart;
  }
  bool is_said_to_be_apart(std::size_t robot) const {
    return team_.server().robots().at(robot).apart;
  }
  // Soon after this nothing of the robot is in the team's map, and nothing of the team's in its.
  void expect_apart(std::size_t robot) const {
    const auto id = static_cast<std::uint16_t>(robot + 1);
    EXPECT_TRUE(is_apart(robot));
    EXPECT_TRUE(is_said_to_be_apart(robot));
    EXPECT_EQ(team_.server().map().robot_tiles(id), nullptr);
    EXPECT_GT(team_.server().apart_maps().at(id).obstacle_cells(), 50u);
    const MapLinkCounters& link = robots_[robot]->agent().link().counters();
    EXPECT_EQ(link.regions_received, 0u);
    EXPECT_TRUE(robots_[robot]->agent().link().peers().empty());
  }
  // Runs until the robot has joined; false when it has not.
  bool joins(std::size_t robot, TimeUs limit_us) {
    const TimeUs begun_us = now_us_;
    while (is_apart(robot) && now_us_ < begun_us + limit_us) tick();
    std::printf("robot %zu: %s after %.0f s, %.3f m and %.2f degrees off\n", robot + 1,
                is_apart(robot) ? "apart" : "joined",
                static_cast<double>(now_us_ - begun_us) * 1e-6, error_m(robot), error_deg(robot));
    return !is_apart(robot);
  }
  void expect_joined(std::size_t robot) {
    EXPECT_LT(error_m(robot), 0.07);
    EXPECT_LT(error_deg(robot), 1);
    for (const auto& each : robots_) each->agent().request_stop();
    run_for(5 * kSecondUs);
    EXPECT_FALSE(is_said_to_be_apart(robot));
    EXPECT_TRUE(team_.server().apart_maps().empty());
    EXPECT_TRUE(server_has_the_same());
    const auto is_merged = [this](Cell c) {
      return team_.server().map().merged_value(Layer::kObstacles, c) != 0;
    };
    // Of a map in a wrong frame nearly all cells would be ghosts.
    EXPECT_LT(ghosts(0.25, is_merged),
              static_cast<int>(team_.server().map().obstacle_cells() / 25));
    EXPECT_GT(robots_[robot]->agent().link().counters().regions_received, 0u);
    for (const auto& each : robots_) {
      EXPECT_EQ(each->body().collisions(), 0);
      EXPECT_EQ(each->agent().localization().counters().lost, 0u);
    }
  }
  // Apart at first, then part of the team.
  void expect_to_join(std::size_t robot, TimeUs limit_us) {
    run_for(20 * kSecondUs);
    expect_apart(robot);
    ASSERT_TRUE(joins(robot, limit_us));
    expect_joined(robot);
  }
};

// A corridor of 14 m with pillars of different widths at different distances.
std::vector<Block> pillars() {
  return {{1.5, 0, 1.8, 0.3},   {3.9, 0, 4.1, 0.5},   {6.2, 0, 6.9, 0.3},  {9.4, 0, 9.6, 0.4},
          {12.0, 0, 12.5, 0.3}, {2.6, 1.7, 3.2, 2},   {5.2, 1.5, 5.4, 2},  {8.0, 1.7, 8.3, 2},
          {8.7, 1.7, 9.0, 2},   {11.1, 1.6, 11.3, 2}, {13.2, 1.7, 13.5, 2}};
}

TEST_F(UnknownStart, InACorridorARobotJoinsOnceBothHaveSeenTheSamePart) {
  world_ = hall(14, 2, pillars());
  add_robot({{1'000'000, 1'000'000}, BinaryAngle::from_degrees(0)});
  add_robot({{12'800'000, 1'000'000}, BinaryAngle::from_degrees(137)});
  expect_to_join(1, 200 * kSecondUs);
}

// 11 m by 7.5 m: rooms on both sides of a corridor; doorways of 0.9 m.
std::vector<Block> rooms() {
  return {{0, 2.5, 1.2, 2.6},   {2.1, 2.5, 4.4, 2.6}, {5.3, 2.5, 8.9, 2.6}, {9.8, 2.5, 11, 2.6},
          {0, 4.4, 2.8, 4.5},   {3.7, 4.4, 7.0, 4.5}, {7.9, 4.4, 11, 4.5},  {3.5, 0, 3.6, 2.5},
          {7.2, 0, 7.3, 2.5},   {5.2, 4.5, 5.3, 7.5}, {0.6, 0.3, 1.4, 0.7}, {9.0, 6.4, 10.2, 7},
          {6.1, 1.0, 6.5, 1.4}, {1.2, 6.6, 2.4, 7.0}};
}

TEST_F(UnknownStart, InABuildingARobotJoinsOnceBothHaveSeenTheSamePart) {
  world_ = hall(11, 7.5, rooms());
  add_robot({{1'600'000, 1'600'000}, BinaryAngle::from_degrees(45)});
  add_robot({{9'300'000, 5'400'000}, BinaryAngle::from_degrees(137)});
  expect_to_join(1, 300 * kSecondUs);
}

// The robot that does not know where it started maps the rooms; then it is locked into a closet
// that it does not know, and the other one comes and maps them, too.
TEST_F(UnknownStart, ARobotThatIsLostJoinsOnceItHasFoundItsPlaceAgain) {
  std::vector<Block> blocks = rooms();
  blocks.insert(blocks.end(), {{11, 0, 11.1, 7.5}, {11.1, 1.8, 13, 7.5}, {12.2, 1.2, 13, 1.8}});
  world_ = hall(13, 7.5, blocks);
  add_robot({{9'300'000, 5'400'000}, BinaryAngle::from_degrees(137)}, false);
  const Agent& agent = robots_[0]->agent();
  run_for(200 * kSecondUs);
  ASSERT_GT(team_.server().apart_maps().at(1).obstacle_cells(), 1000u);
  const host::TruePose place = robots_[0]->body().pose();
  robots_[0]->carry_to({11.7, 0.9, 1});
  run_for(5 * kSecondUs);
  ASSERT_TRUE(agent.localization().lost());
  add_robot({{1'600'000, 1'600'000}, BinaryAngle::from_degrees(45)}, true);
  EXPECT_FALSE(joins(0, 300 * kSecondUs)) << "while it is lost";
  EXPECT_TRUE(agent.localization().lost());
  robots_[0]->carry_to(place);
  ASSERT_TRUE(joins(0, 60 * kSecondUs));
  run_for(5 * kSecondUs);
  EXPECT_TRUE(agent.localization().trusted());
  EXPECT_LT(error_m(0), 0.07);
  EXPECT_LT(error_deg(0), 1);
}

TEST_F(UnknownStart, InASymmetricCorridorTheyStayApart) {
  world_ = hall(8, 2, {{2, 0, 2.3, 0.4}, {5.7, 1.6, 6, 2}});  // half a turn leaves it as it is
  add_robot({{1'000'000, 1'000'000}, BinaryAngle::from_degrees(0)});
  add_robot({{7'000'000, 1'000'000}, BinaryAngle::from_degrees(137)});
  EXPECT_FALSE(joins(1, 120 * kSecondUs));
  expect_apart(1);
}

}  // namespace
}  // namespace ivfm
