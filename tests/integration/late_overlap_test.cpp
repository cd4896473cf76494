// A robot whose start is known only roughly explores alone, in a wrong map frame; then another one
// comes, and the first finds out where it is by what that one maps. In simulated time, with the
// real map server.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
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

// Two rooms, 2.8 m by 3 m and 2.2 m by 3 m, in cells of 25 mm; a gap of 0.9 m in the wall between
// them, and a corner cut off each.
std::shared_ptr<const host::World> two_rooms() {
  auto world = std::make_shared<host::World>();
  world->name = "two rooms";
  world->cell_um = 25'000;
  world->width = 208;
  world->height = 128;
  world->origin = {-100'000, -100'000};
  world->occupied.assign(208 * 128, 1);
  for (int y = 4; y < 124; ++y) {
    for (int x = 4; x < 204; ++x) {
      const bool wall = x >= 114 && x < 118 && (y < 44 || y >= 80);
      const bool cut = x + y < 40 || x - y > 184;
      world->occupied[static_cast<std::size_t>(y * 208 + x)] = wall || cut ? 1 : 0;
    }
  }
  return world;
}

Pose to_pose(const host::TruePose& pose) {
  const auto um = [](double m) { return static_cast<std::int32_t>(std::lround(m * 1e6)); };
  return {{um(pose.x_m), um(pose.y_m)}, BinaryAngle::from_radians(pose.heading_rad)};
}

class LateOverlap : public testing::Test {
 protected:
  void add_robot(const Pose& start, const Pose& told_start, bool rough) {
    AgentOptions options;
    options.robot_id = static_cast<int>(robots_.size()) + 1;
    options.visit_range_m = 1;
    AgentConfig config = make_agent_config(options, McuProfile::kCellUm, 1);
    config.start = told_start;
    config.rough_start = rough;
    robots_.push_back(std::make_unique<SimulatedRobot>(config, start, world_,
                                                       host::OdometryNoise::preset("mild"), 1));
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
  double error_m(std::size_t robot) const {
    const Point believed = robots_[robot]->agent().pose().position;
    const host::TruePose& truth = robots_[robot]->body().pose();
    return std::hypot(believed.x_um * 1e-6 - truth.x_m, believed.y_um * 1e-6 - truth.y_m);
  }
  // Obstacle cells that a robot has told and that lie more than 0.15 m from everything.
  int ghosts(std::uint16_t robot) const {
    int count = 0;
    for (std::int32_t y = 0; y < 60; ++y) {
      for (std::int32_t x = 0; x < 100; ++x) {
        if (team_.server().map().robot_value(robot, Layer::kObstacles, {x, y}) == 0) continue;
        const double x_m = (x + 0.5) * 0.05, y_m = (y + 0.5) * 0.05;
        count += host::disc_touches_obstacle(*world_, x_m, y_m, 0.15) ? 0 : 1;
      }
    }
    return count;
  }
  // Cells of which the server holds something else than the robot itself.
  int differences(std::uint16_t robot) const {
    const ExplorationMap& map = robots_[robot - 1u]->agent().explorer().map();
    int count = 0;
    for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
      for (std::int32_t y = -20; y < 80; ++y) {
        for (std::int32_t x = -13; x < 113; ++x) {
          std::uint8_t own = 0;
          if (!ok(map.read_own(layer, {x, y, 1, 1}, {&own, 1}))) continue;
          count += own != team_.server().map().robot_value(robot, layer, {x, y}) ? 1 : 0;
        }
      }
    }
    return count;
  }

  // Soon; robots that stand go on to map.
  bool server_has_the_same() {
    for (const TimeUs end_us = now_us_ + 20 * kSecondUs; now_us_ < end_us;) {
      for (const auto& robot : robots_) robot->agent().flush_map();
      run_for(kExchangeUs);
      if (differences(1) + differences(2) == 0) return true;
    }
    return false;
  }

  std::shared_ptr<const host::World> world_ = two_rooms();
  std::vector<std::unique_ptr<SimulatedRobot>> robots_;
  host::TeamRadio team_;
  TimeUs now_us_ = 5 * kSecondUs;
};

TEST_F(LateOverlap, CorrectsTheMapFrameAndWhatWasToldInIt) {
  const Pose start{{2'000'000, 1'600'000}, BinaryAngle::from_degrees(90)};
  add_robot(start, {{2'300'000, 1'350'000}, BinaryAngle::from_degrees(100)}, true);
  run_for(30 * kSecondUs);
  const Agent& rough = robots_[0]->agent();
  ASSERT_EQ(rough.start_pose(), StartPose::kNotFound);
  ASSERT_GT(rough.progress().scans_fused, 50u);
  ASSERT_GT(error_m(0), 0.2);
  const int ghosts_before = ghosts(1);
  ASSERT_GT(ghosts_before, 50);
  const Pose other{{4'000'000, 1'000'000}, BinaryAngle::from_degrees(180)};
  add_robot(other, other, false);
  const TimeUs joined_us = now_us_;
  while (rough.start_pose() == StartPose::kNotFound && now_us_ < joined_us + 120 * kSecondUs) {
    tick();
  }
  ASSERT_EQ(rough.start_pose(), StartPose::kCorrected);
  const double after_s = static_cast<double>(now_us_ - joined_us) * 1e-6;
  std::printf("corrected after %.1f s, %.3f m off\n", after_s, error_m(0));
  EXPECT_LT(error_m(0), 0.08);
  for (const auto& robot : robots_) robot->agent().request_stop();
  run_for(5 * kSecondUs);
  EXPECT_TRUE(server_has_the_same());
  std::printf("ghost cells: %d before, %d after\n", ghosts_before, ghosts(1));
  EXPECT_LT(ghosts(1), ghosts_before / 10);
  EXPECT_EQ(rough.localization().counters().lost, 0u);
  EXPECT_EQ(robots_[0]->body().collisions() + robots_[1]->body().collisions(), 0);
}

// Both in wrong frames from the beginning: the first keeps its own, the other takes it over.
TEST_F(LateOverlap, OfTwoRoughRobotsOnlyOneCorrectsItself) {
  add_robot({{2'000'000, 1'600'000}, BinaryAngle::from_degrees(90)},
            {{2'300'000, 1'350'000}, BinaryAngle::from_degrees(100)}, true);
  add_robot({{4'000'000, 1'000'000}, BinaryAngle::from_degrees(180)},
            {{4'000'000, 1'000'000}, BinaryAngle::from_degrees(180)}, true);
  // T_believed_true of the robots' map frames, while they stand.
  const auto frame_of = [this](std::size_t robot) {
    const Pose truth = to_pose(robots_[robot]->body().pose());
    return compose(robots_[robot]->agent().pose(), relative_pose(truth, {}));
  };
  run_for(10 * kSecondUs);
  const Pose first = frame_of(0);
  EXPECT_FALSE(is_near(first, frame_of(1), 200'000, 728));
  const TimeUs limit_us = now_us_ + 180 * kSecondUs;
  while (robots_[1]->agent().start_pose() != StartPose::kCorrected && now_us_ < limit_us) tick();
  ASSERT_EQ(robots_[1]->agent().start_pose(), StartPose::kCorrected);
  run_for(30 * kSecondUs);
  EXPECT_EQ(robots_[0]->agent().start_pose(), StartPose::kGiven);
  for (const auto& robot : robots_) robot->agent().request_stop();
  run_for(3 * kSecondUs);
  for (std::size_t robot = 0; robot < 2; ++robot) {
    const Pose frame = frame_of(robot);
    std::printf("frame of robot %zu: %+.3f %+.3f m, %+.2f degrees\n", robot + 1,
                frame.position.x_um * 1e-6, frame.position.y_um * 1e-6, frame.heading.degrees());
    EXPECT_TRUE(is_near(frame, first, 120'000, 364));
  }
}

}  // namespace
}  // namespace ivfm
