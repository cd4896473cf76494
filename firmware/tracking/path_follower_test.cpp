#include "firmware/tracking/path_follower.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace ivfm {
namespace {

constexpr TimeUs kPeriodUs = 20'000;

// A unicycle that does exactly what it is told.
struct Unicycle {
  double x_m = 0, y_m = 0, heading_rad = 0;

  void drive(const Velocity& command) {
    const double dt = kPeriodUs * 1e-6, v = command.v_um_s * 1e-6;
    const double half_turn = command.omega_mrad_s * 1e-3 * dt / 2;
    x_m += v * dt * std::cos(heading_rad + half_turn);
    y_m += v * dt * std::sin(heading_rad + half_turn);
    heading_rad += 2 * half_turn;
  }
  Pose pose() const {
    return {{static_cast<std::int32_t>(std::lround(x_m * 1e6)),
             static_cast<std::int32_t>(std::lround(y_m * 1e6))},
            BinaryAngle::from_radians(heading_rad)};
  }
};

struct Drive {
  Status status = Status::kOk;
  int steps = 0;
  std::vector<Point> track;
};

double distance_m(Point a, Point b) {
  return std::hypot(double(a.x_um) - b.x_um, double(a.y_um) - b.y_um) * 1e-6;
}

// Distance of `p` from the nearest segment of `path`.
double distance_to_path_m(Point p, const std::vector<Point>& path) {
  double nearest = 1e9;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    const double ax = path[i].x_um, ay = path[i].y_um;
    const double dx = path[i + 1].x_um - ax, dy = path[i + 1].y_um - ay;
    const double t =
        std::clamp(((p.x_um - ax) * dx + (p.y_um - ay) * dy) / (dx * dx + dy * dy), 0.0, 1.0);
    nearest = std::min(nearest, std::hypot(p.x_um - ax - t * dx, p.y_um - ay - t * dy) * 1e-6);
  }
  return nearest;
}

class PathFollowerTest : public ::testing::Test {
 protected:
  // Drives until the follower says that it is over; checks the limits at every step.
  Drive follow(const std::vector<Point>& path, int most_steps = 10'000) {
    Drive drive;
    EXPECT_EQ(follower_.start(path, now_us_), Status::kOk);
    Velocity last;
    while (drive.status == Status::kOk && drive.steps < most_steps) {
      now_us_ += kPeriodUs;
      const FollowStep step = follower_.step(robot_.pose(), last, now_us_);
      check_limits(last, step.velocity);
      if (!wheels_blocked_) robot_.drive(step.velocity);
      last = step.velocity;
      drive.status = step.status;
      drive.track.push_back(robot_.pose().position);
      ++drive.steps;
    }
    return drive;
  }
  void check_limits(const Velocity& last, const Velocity& next) const {
    ASSERT_LE(std::abs(next.v_um_s), config_.max_speed_um_s);
    ASSERT_LE(std::abs(next.omega_mrad_s), config_.max_turn_mrad_s);
    ASSERT_LE(std::abs(next.v_um_s - last.v_um_s), config_.acceleration_um_s2 / 50);
    ASSERT_LE(std::abs(next.omega_mrad_s - last.omega_mrad_s),
              config_.turn_acceleration_mrad_s2 / 50);
    ASSERT_GE(next.v_um_s, 0) << "it never backs up";
  }
  void expect_goal_reached(const std::vector<Point>& path, const Drive& drive) const {
    EXPECT_EQ(drive.status, Status::kEmpty);
    EXPECT_LE(distance_m(robot_.pose().position, path.back()), config_.goal_tolerance_um * 1e-6);
  }

  FollowerConfig config_;
  PathFollower follower_{config_};
  Unicycle robot_;
  bool wheels_blocked_ = false;
  TimeUs now_us_ = 5'000'000;
};

TEST_F(PathFollowerTest, WithoutAPathItStandsStill) {
  const FollowStep step = follower_.step({}, {}, now_us_);
  EXPECT_EQ(step.status, Status::kEmpty);
  EXPECT_TRUE(step.velocity.is_zero());
  EXPECT_EQ(follower_.start({}, now_us_), Status::kInvalidArgument);
}

TEST_F(PathFollowerTest, DrivesStraightToAGoalAheadWithoutOvershoot) {
  const std::vector<Point> path{{2'000'000, 0}};
  const Drive drive = follow(path);
  expect_goal_reached(path, drive);
  for (const Point& p : drive.track) {
    EXPECT_LE(p.x_um, 2'000'000 + config_.goal_tolerance_um);
    EXPECT_NEAR(p.y_um, 0, 2'000);
  }
  // 2 m at 0.3 m/s is 6.7 s; ramps up and down cost less than two more.
  EXPECT_LT(drive.steps * 0.02, 8.7);
}

TEST_F(PathFollowerTest, TurnsOnTheSpotTowardsAGoalBehind) {
  const std::vector<Point> path{{-1'000'000, 100'000}};
  const Drive drive = follow(path);
  expect_goal_reached(path, drive);
  for (const Point& p : drive.track) EXPECT_LE(p.x_um, 10'000) << "no excursion forward";
}

TEST_F(PathFollowerTest, StaysNearAPathWithRightAngles) {
  const std::vector<Point> path{
      {1'000'000, 0}, {1'000'000, 1'000'000}, {0, 1'000'000}, {0, 200'000}};
  const Drive drive = follow(path);
  expect_goal_reached(path, drive);
  std::vector<Point> whole = path;
  whole.insert(whole.begin(), Point{});
  for (const Point& p : drive.track) EXPECT_LE(distance_to_path_m(p, whole), 0.025);
}

TEST_F(PathFollowerTest, FollowsADensePathOfCellSteps) {
  std::vector<Point> path{{0, 0}};
  for (int i = 1; i <= 40; ++i) path.push_back({i * 50'000, (i / 2) * 50'000});
  const Drive drive = follow(path);
  expect_goal_reached(path, drive);
  for (const Point& p : drive.track) EXPECT_LE(distance_to_path_m(p, path), 0.04);
}

TEST_F(PathFollowerTest, APathThatBeginsBehindTheRobotIsJoinedWhereTheRobotIs) {
  const std::vector<Point> path{{-200'000, 0}, {1'000'000, 0}};
  const Drive drive = follow(path);
  expect_goal_reached(path, drive);
  for (const Point& p : drive.track) EXPECT_GE(p.x_um, -10'000);
}

TEST_F(PathFollowerTest, ReachesGoalsAllAround) {
  for (int degrees = 0; degrees < 360; degrees += 15) {
    robot_ = {};
    const double angle = degrees * 3.14159265358979 / 180;
    const std::vector<Point> path{{static_cast<std::int32_t>(700'000 * std::cos(angle)),
                                   static_cast<std::int32_t>(700'000 * std::sin(angle))}};
    expect_goal_reached(path, follow(path));
  }
}

TEST_F(PathFollowerTest, BlockedWheelsAreReportedAsATimeout) {
  wheels_blocked_ = true;
  const Drive drive = follow({{2'000'000, 0}});
  EXPECT_EQ(drive.status, Status::kTimeout);
  EXPECT_NEAR(drive.steps * 0.02, 5.0, 0.2);
  EXPECT_FALSE(follower_.active());
}

TEST_F(PathFollowerTest, CancellingBrakesWithinTheLimits) {
  const std::vector<Point> path{{2'000'000, 0}};
  ASSERT_EQ(follower_.start(path, now_us_), Status::kOk);
  follower_.cancel();
  Velocity last{300'000, 0};
  int steps = 0;
  for (Status status = Status::kOk; status == Status::kOk; ++steps) {
    now_us_ += kPeriodUs;
    const FollowStep step = follower_.step({}, last, now_us_);
    check_limits(last, step.velocity);
    last = step.velocity;
    status = step.status;
  }
  // 0.3 m/s at 0.5 m/s^2: 0.6 s, that is 30 steps; the first one may see no time pass.
  EXPECT_NEAR(steps, 30, 2);
}

TEST_F(PathFollowerTest, RampsFromWhatReallyWentToTheWheels) {
  const std::vector<Point> path{{2'000'000, 0}};
  ASSERT_EQ(follower_.start(path, now_us_), Status::kOk);
  for (int i = 0; i < 50; ++i) {
    now_us_ += kPeriodUs;
    const FollowStep step = follower_.step({}, {}, now_us_);
    EXPECT_LE(step.velocity.v_um_s, config_.acceleration_um_s2 / 50);
  }
}

}  // namespace
}  // namespace ivfm
