// Robots that know nothing of where they start explore apart from the team until the map server has
// found out where their maps lie. In simulated time, with real agents and the real map server.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "firmware/agent/linux/agent_setup.h"
#include "host/simulator/robot_body.h"
#include "tests/replay/simulated_robot.h"

namespace ivfm {
namespace {

using replay::SimulatedRobot;

constexpr TimeUs kTickUs = 2'000;
constexpr TimeUs kExchangeUs = 20'000;
constexpr TimeUs kSecondUs = 1'000'000;
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

class UnknownStart : public testing::Test {
 protected:
  // Robot 1 knows where it starts, the others do not.
  void add_robot(const Pose& start) {
    AgentOptions options;
    options.robot_id = static_cast<int>(robots_.size()) + 1;
    options.visit_range_m = 2;
    options.unknown_start = !robots_.empty();
    AgentConfig config = make_agent_config(options, RobotProfile::kCellUm, 1);
    if (robots_.empty()) config.start = start;
    robots_.push_back(std::make_unique<SimulatedRobot>(
        config, start, world_, host::OdometryNoise::preset("mild"), 1, replay::ProfileId::kRobot));
    team_.add(robots_.back()->radio());
  }
  void run_for(TimeUs duration_us) {
    for (const TimeUs end_us = now_us_ + duration_us; now_us_ < end_us;) tick();
  }
  void tick() {
    now_us_ += kTickUs;
    for (const auto& robot : robots_) {
      std::vector<host::TruePose> others;
      for (const auto& other : robots_) {
        if (other != robot) others.push_back(other->body().pose());
      }
      robot->meet(std::move(others));
      robot->tick(now_us_);
    }
    if (now_us_ % kExchangeUs == 0) team_.exchange(now_us_);
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
  double error_m(std::size_t robot) const {
    const Point believed = robots_[robot]->agent().pose().position;
    const host::TruePose& truth = robots_[robot]->body().pose();
    return std::hypot(believed.x_um * 1e-6 - truth.x_m, believed.y_um * 1e-6 - truth.y_m);
  }
  double error_deg(std::size_t robot) const {
    const double believed = robots_[robot]->agent().pose().heading.radians();
    return std::abs(
               std::remainder(believed - robots_[robot]->body().pose().heading_rad, 2 * M_PI)) *
           180 / M_PI;
  }
  // Obstacle cells of the team's map that lie more than 0.25 m from everything.
  int ghosts() const {
    int count = 0;
    const auto cells = [](std::int32_t side) { return side * kWorldCellM / 0.05; };
    for (std::int32_t y = 0; y < cells(world_->height); ++y) {
      for (std::int32_t x = 0; x < cells(world_->width); ++x) {
        if (team_.server().map().merged_value(Layer::kObstacles, {x, y}) == 0) continue;
        const double x_m = (x + 0.5) * 0.05, y_m = (y + 0.5) * 0.05;
        count += host::disc_touches_obstacle(*world_, x_m, y_m, 0.25) ? 0 : 1;
      }
    }
    return count;
  }
  // Cells of the robot's window of which the server holds something else than the robot itself.
  int differences(std::size_t robot) const {
    const ExplorationMap& map = robots_[robot]->agent().explorer().map();
    const CellRect& window = map.frame().window();
    int count = 0;
    for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
      for (std::int32_t y = window.y; y < window.top(); ++y) {
        for (std::int32_t x = window.x; x < window.right(); ++x) {
          std::uint8_t own = 0;
          if (!ok(map.read_own(layer, {x, y, 1, 1}, {&own, 1}))) continue;
          const auto id = static_cast<std::uint16_t>(robot + 1);
          count += own != team_.server().map().robot_value(id, layer, {x, y}) ? 1 : 0;
        }
      }
    }
    return count;
  }
  bool server_has_the_same(std::size_t robot) {
    for (const TimeUs end_us = now_us_ + 20 * kSecondUs; now_us_ < end_us;) {
      for (const auto& each : robots_) each->agent().flush_map();
      run_for(kExchangeUs);
      if (differences(robot) == 0) return true;
    }
    return false;
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
    EXPECT_LT(error_m(robot), 0.05);
    EXPECT_LT(error_deg(robot), 1);
    for (const auto& each : robots_) each->agent().request_stop();
    run_for(5 * kSecondUs);
    EXPECT_FALSE(is_said_to_be_apart(robot));
    EXPECT_TRUE(team_.server().apart_maps().empty());
    EXPECT_TRUE(server_has_the_same(robot));
    // Of a map in a wrong frame nearly all cells would be.
    EXPECT_LT(ghosts(), static_cast<int>(team_.server().map().obstacle_cells() / 25));
    EXPECT_GT(robots_[robot]->agent().link().counters().regions_received, 0u);
    for (const auto& each : robots_) {
      EXPECT_EQ(each->body().collisions(), 0);
      EXPECT_EQ(each->agent().localization().counters().lost, 0u);
    }
  }

  std::shared_ptr<const host::World> world_;
  std::vector<std::unique_ptr<SimulatedRobot>> robots_;
  host::TeamRadio team_;
  TimeUs now_us_ = 5 * kSecondUs;
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
  run_for(20 * kSecondUs);
  expect_apart(1);
  ASSERT_TRUE(joins(1, 200 * kSecondUs));
  expect_joined(1);
}

TEST_F(UnknownStart, InABuildingARobotJoinsOnceBothHaveSeenTheSamePart) {
  // Rooms on both sides of a corridor; doorways of 0.9 m.
  world_ = hall(11, 7.5,
                {{0, 2.5, 1.2, 2.6},
                 {2.1, 2.5, 4.4, 2.6},
                 {5.3, 2.5, 8.9, 2.6},
                 {9.8, 2.5, 11, 2.6},
                 {0, 4.4, 2.8, 4.5},
                 {3.7, 4.4, 7.0, 4.5},
                 {7.9, 4.4, 11, 4.5},
                 {3.5, 0, 3.6, 2.5},
                 {7.2, 0, 7.3, 2.5},
                 {5.2, 4.5, 5.3, 7.5},
                 {0.6, 0.3, 1.4, 0.7},
                 {9.0, 6.4, 10.2, 7},
                 {6.1, 1.0, 6.5, 1.4},
                 {1.2, 6.6, 2.4, 7.0}});
  add_robot({{1'600'000, 1'600'000}, BinaryAngle::from_degrees(45)});
  add_robot({{9'300'000, 5'400'000}, BinaryAngle::from_degrees(137)});
  run_for(20 * kSecondUs);
  expect_apart(1);
  ASSERT_TRUE(joins(1, 300 * kSecondUs));
  expect_joined(1);
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
