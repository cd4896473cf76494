// A robot whose start is known only roughly explores alone, in a wrong map frame; then another one
// comes, and the first finds out where it is by what that one maps. In simulated time, with the
// real map server.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>

#include "tests/integration/simulated_team.h"

namespace ivfm {
namespace {

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

class LateOverlap : public SimulatedTeam {
 protected:
  LateOverlap() { world_ = two_rooms(); }
  void add(const Pose& start, const Pose& told_start, bool rough) {
    AgentOptions options;
    options.robot_id = static_cast<int>(robots_.size()) + 1;
    options.visit_range_m = 1;
    AgentConfig config = make_agent_config(options, McuProfile::kCellUm, 1);
    config.start = told_start;
    config.rough_start = rough;
    add_robot(config, start, "mild");
  }
  // Obstacle cells that a robot has told and that lie more than 0.15 m from everything.
  int ghosts_of(std::uint16_t robot) const {
    return ghosts(0.15, [&](Cell c) {
      return team_.server().map().robot_value(robot, Layer::kObstacles, c) != 0;
    });
  }
};

TEST_F(LateOverlap, CorrectsTheMapFrameAndWhatWasToldInIt) {
  const Pose start{{2'000'000, 1'600'000}, BinaryAngle::from_degrees(90)};
  add(start, {{2'300'000, 1'350'000}, BinaryAngle::from_degrees(100)}, true);
  run_for(30 * kSecondUs);
  const Agent& rough = robots_[0]->agent();
  ASSERT_EQ(rough.start_pose(), StartPose::kNotFound);
  ASSERT_GT(rough.progress().scans_fused, 50u);
  ASSERT_GT(error_m(0), 0.2);
  const int ghosts_before = ghosts_of(1);
  ASSERT_GT(ghosts_before, 50);
  const Pose other{{4'000'000, 1'000'000}, BinaryAngle::from_degrees(180)};
  add(other, other, false);
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
  std::printf("ghost cells: %d before, %d after\n", ghosts_before, ghosts_of(1));
  EXPECT_LT(ghosts_of(1), ghosts_before / 10);
  EXPECT_EQ(rough.localization().counters().lost, 0u);
  EXPECT_EQ(robots_[0]->body().collisions() + robots_[1]->body().collisions(), 0);
}

// Both in wrong frames from the beginning: the first keeps its own, the other takes it over.
class TwoRoughRobots : public LateOverlap {
 protected:
  void add_two(const Pose& first_told, const Pose& second_told) {
    add({{2'000'000, 1'600'000}, BinaryAngle::from_degrees(90)}, first_told, true);
    add({{4'000'000, 1'000'000}, BinaryAngle::from_degrees(180)}, second_told, true);
  }
  // T_believed_true of the robot's map frame, while it stands.
  Pose frame_of(std::size_t robot) const {
    const Pose truth = to_pose(robots_[robot]->body().pose());
    return compose(robots_[robot]->agent().pose(), relative_pose(truth, {}));
  }
  void expect_one_frame() {
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
};

TEST_F(TwoRoughRobots, OnlyOneCorrectsItself) {
  add_two({{2'300'000, 1'350'000}, BinaryAngle::from_degrees(100)},
          {{4'000'000, 1'000'000}, BinaryAngle::from_degrees(180)});
  expect_one_frame();
}

// One's frame is then twice as wrong in the other's as a start may be.
TEST_F(TwoRoughRobots, MayBeWrongInOppositeWays) {
  add_two({{2'300'000, 1'350'000}, BinaryAngle::from_degrees(103)},
          {{3'700'000, 1'300'000}, BinaryAngle::from_degrees(168)});
  expect_one_frame();
}

}  // namespace
}  // namespace ivfm
