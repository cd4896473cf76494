#include "firmware/supervisor/supervisor.h"

#include <gtest/gtest.h>

namespace ivfm {
namespace {

constexpr TimeUs kPeriodUs = 20'000;
constexpr Velocity kDrive{200'000, 100};
constexpr Velocity kStill{};

// A robot with nothing around it, stepped every 20 ms with everything well unless a test says so.
class SupervisorTest : public ::testing::Test {
 protected:
  SupervisorTest() {
    inputs_.lidar_age_us = 100'000;
    inputs_.odometry_age_us = 10'000;
    inputs_.drives_operational = true;
    inputs_.scan = &scan_;
  }

  Velocity step(const Velocity& setpoint = kDrive) {
    now_us_ += kPeriodUs;
    return supervisor_.gate(setpoint, inputs_, now_us_);
  }
  void run_ms(int ms) {
    for (int t = 0; t < ms; t += 20) step();
  }
  void start_exploring() {
    supervisor_.request(RobotEvent::kExplore);
    run_ms(600);
    ASSERT_EQ(supervisor_.state(), RobotState::kExploring);
    ASSERT_EQ(step(), kDrive);
  }
  void put_wall_ahead_mm(std::uint16_t range_mm) {
    scan_.clear();
    scan_.push({BinaryAngle(), range_mm, Echo::kHit, 20});
  }
  // The cause of `break_it` stops the wheels at once and names `reason`; without it they turn
  // again.
  template <typename Break, typename Mend>
  void expect_stop_and_recovery(StopReason reason, Break break_it, Mend mend_it) {
    start_exploring();
    break_it();
    EXPECT_EQ(step(), kStill);
    EXPECT_EQ(supervisor_.state(), RobotState::kFault);
    EXPECT_TRUE(supervisor_.reasons().has(reason));
    EXPECT_EQ(supervisor_.fault_count(), 1u);
    mend_it();
    run_ms(480);
    EXPECT_EQ(step(), kStill) << "not before the cause has been gone for 500 ms";
    run_ms(60);
    EXPECT_EQ(step(), kDrive);
    EXPECT_EQ(supervisor_.state(), RobotState::kExploring);
    EXPECT_TRUE(supervisor_.reasons().none());
  }

  SupervisorConfig config_{.robot_radius_um = 170'000};
  Supervisor supervisor_{config_};
  SupervisorInputs inputs_;
  Scan scan_;
  TimeUs now_us_ = 1'000'000;
};

TEST_F(SupervisorTest, NothingMovesBeforeTheDevicesAreThere) {
  inputs_.lidar_age_us = kNeverUs;
  inputs_.scan = nullptr;
  EXPECT_EQ(supervisor_.request(RobotEvent::kExplore), Status::kOk);
  for (int i = 0; i < 200; ++i) EXPECT_EQ(step(), kStill);
  EXPECT_EQ(supervisor_.state(), RobotState::kBoot);
  EXPECT_TRUE(supervisor_.reasons().has(StopReason::kLidarStale));
  EXPECT_EQ(supervisor_.fault_count(), 0u) << "starting up is no fault";
}

TEST_F(SupervisorTest, ReadyStandsStillUntilThereIsAMission) {
  run_ms(600);
  EXPECT_EQ(supervisor_.state(), RobotState::kReady);
  EXPECT_EQ(step(), kStill);
  EXPECT_EQ(supervisor_.request(RobotEvent::kExplore), Status::kOk);
  EXPECT_EQ(step(), kDrive);
}

TEST_F(SupervisorTest, StaleLidarStopsAtItsDeadlineAndRecovers) {
  expect_stop_and_recovery(
      StopReason::kLidarStale, [&] { inputs_.lidar_age_us = config_.lidar_max_age_us + 1; },
      [&] { inputs_.lidar_age_us = 0; });
}

TEST_F(SupervisorTest, ALidarJustWithinItsDeadlineDrives) {
  start_exploring();
  inputs_.lidar_age_us = config_.lidar_max_age_us;
  EXPECT_EQ(step(), kDrive);
}

TEST_F(SupervisorTest, StaleOdometryStopsAndRecovers) {
  expect_stop_and_recovery(
      StopReason::kOdometryStale, [&] { inputs_.odometry_age_us = 100'001; },
      [&] { inputs_.odometry_age_us = 0; });
}

TEST_F(SupervisorTest, ALostDriveStopsAndRecovers) {
  expect_stop_and_recovery(
      StopReason::kDriveLost, [&] { inputs_.drives_operational = false; },
      [&] { inputs_.drives_operational = true; });
}

TEST_F(SupervisorTest, AnInternalErrorStopsAndRecovers) {
  expect_stop_and_recovery(
      StopReason::kInternalError, [&] { inputs_.internal_error = true; },
      [&] { inputs_.internal_error = false; });
}

TEST_F(SupervisorTest, TimeGoingBackIsAnInternalError) {
  expect_stop_and_recovery(
      StopReason::kInternalError, [&] { now_us_ -= 100'000; }, [] {});
}

TEST_F(SupervisorTest, AFlickeringCauseKeepsTheRobotStanding) {
  start_exploring();
  for (int i = 0; i < 100; ++i) {
    inputs_.drives_operational = i % 10 != 0;
    EXPECT_EQ(step(), kStill);
  }
  EXPECT_EQ(supervisor_.fault_count(), 1u);
}

TEST_F(SupervisorTest, AStopCommandHoldsUntilItIsTakenBackByAStart) {
  start_exploring();
  inputs_.stop_requested = true;
  EXPECT_EQ(step(), kStill);
  EXPECT_TRUE(supervisor_.reasons().has(StopReason::kStopCommand));
  inputs_.stop_requested = false;
  run_ms(2'000);
  EXPECT_EQ(step(), kStill);
  EXPECT_EQ(supervisor_.state(), RobotState::kStopped);
  EXPECT_EQ(supervisor_.request(RobotEvent::kExplore), Status::kRefused);
  EXPECT_EQ(supervisor_.request(RobotEvent::kStart), Status::kOk);
  EXPECT_EQ(supervisor_.request(RobotEvent::kExplore), Status::kOk);
  run_ms(600);
  EXPECT_EQ(step(), kDrive);
}

TEST_F(SupervisorTest, AFaultDuringAStopCommandDoesNotEndIt) {
  start_exploring();
  EXPECT_EQ(supervisor_.request(RobotEvent::kStop), Status::kOk);
  inputs_.drives_operational = false;
  step();
  inputs_.drives_operational = true;
  run_ms(1'000);
  EXPECT_EQ(supervisor_.state(), RobotState::kStopped);
}

TEST_F(SupervisorTest, AMissionGivenDuringAFaultStartsAfterIt) {
  start_exploring();
  inputs_.drives_operational = false;
  step();
  EXPECT_EQ(supervisor_.request(RobotEvent::kReturn), Status::kOk);
  EXPECT_EQ(step(), kStill);
  inputs_.drives_operational = true;
  run_ms(600);
  EXPECT_EQ(supervisor_.state(), RobotState::kReturning);
}

TEST_F(SupervisorTest, ExploredAndFoundStandStillAndSurviveAFault) {
  start_exploring();
  EXPECT_EQ(supervisor_.request(RobotEvent::kMapExplored), Status::kOk);
  EXPECT_EQ(step(), kStill);
  inputs_.lidar_age_us = 1'000'000;
  step();
  EXPECT_EQ(supervisor_.state(), RobotState::kFault);
  inputs_.lidar_age_us = 0;
  run_ms(600);
  EXPECT_EQ(supervisor_.state(), RobotState::kExplored);
}

TEST_F(SupervisorTest, EventsOfItsOwnAreNotForOthers) {
  EXPECT_EQ(supervisor_.request(RobotEvent::kFaultCleared), Status::kInvalidArgument);
  EXPECT_EQ(supervisor_.request(RobotEvent::kDevicesReady), Status::kInvalidArgument);
}

TEST_F(SupervisorTest, AnObstacleInsideTheStoppingDistanceStopsBothWheels) {
  start_exploring();
  // 0.2 m/s: 40 mm of reaction and 6.7 mm of braking, a robot of 170 mm and half of 30 mm.
  inputs_.measured = {200'000, 0};
  put_wall_ahead_mm(230);
  EXPECT_EQ(step({200'000, 500}), kStill);
  EXPECT_TRUE(supervisor_.reasons().has(StopReason::kObstacle));
  EXPECT_EQ(supervisor_.state(), RobotState::kExploring) << "no fault: the way may be elsewhere";
  inputs_.measured = {};
  EXPECT_EQ(step({0, 500}), (Velocity{0, 500})) << "turning away is allowed";
  put_wall_ahead_mm(200);
  EXPECT_EQ(step(kDrive), kStill);
  put_wall_ahead_mm(3'000);
  EXPECT_EQ(step(kDrive), kDrive);
}

TEST_F(SupervisorTest, AnObstacleAheadSlowsDownOnTheSameArc) {
  start_exploring();
  put_wall_ahead_mm(300);
  // 100 mm free: v * 0.2 s + v^2 / (2 * 0.5 m/s^2) = 0.1 m has the root v = 0.2317 m/s.
  const Velocity slowed = step({400'000, 0});
  EXPECT_NEAR(slowed.v_um_s, 231'700, 1'000);
  EXPECT_TRUE(supervisor_.reasons().has(StopReason::kSlowedByObstacle));
  scan_.clear();
  EXPECT_EQ(step({400'000, 0}), (Velocity{400'000, 0}));
}

TEST_F(SupervisorTest, ApproachingAWallItSlowsDownWithoutBrakingHard) {
  start_exploring();
  double wall_mm = 1'500, v = 0;
  for (int i = 0; i < 1'000; ++i) {
    put_wall_ahead_mm(static_cast<std::uint16_t>(wall_mm));
    inputs_.measured = {static_cast<std::int32_t>(v), 0};
    const Velocity out = step({400'000, 0});
    if (v > 10'000) {
      EXPECT_NE(out.v_um_s, 0) << "stopped hard at " << wall_mm;
    }
    v = out.v_um_s;
    wall_mm -= v * 0.02 / 1000;
  }
  EXPECT_EQ(v, 0);
  EXPECT_NEAR(wall_mm, 200, 5);
}

TEST_F(SupervisorTest, SetpointsBeyondTheLimitsAreCut) {
  start_exploring();
  EXPECT_EQ(step({2'000'000, -9'000}), (Velocity{500'000, -3'000}));
  EXPECT_TRUE(supervisor_.reasons().has(StopReason::kLimited));
}

TEST(SupervisorTable, NamesEveryState) {
  EXPECT_STREQ(to_string(RobotState::kBoot), "boot");
  EXPECT_STREQ(to_string(RobotState::kStopped), "stopped");
}

}  // namespace
}  // namespace ivfm
