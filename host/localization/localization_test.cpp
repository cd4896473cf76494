// The robot's localization on a short recorded drive, with sensors from exact to bad.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "host/localization/drive_recorder.h"
#include "host/localization/estimators.h"
#include "host/localization/recorded_map.h"
#include "host/simulator/rawlog_replay.h"

namespace ivfm::host {
namespace {

class ShortDrive : public testing::Test {
 protected:
  static const DriveLog& drive() {
    static const DriveLog log = record_drive({.world = "corridor", .seed = 3, .metres = 15});
    return log;
  }
  static Assessment assess_with(const SensorNoise& noise, const std::string& estimator) {
    const DriveLog log = with_noise(drive(), noise, 5);
    return assess(log, *make_estimator(estimator, log));
  }
  static Assessment assess_with(const std::string& preset, const std::string& estimator) {
    return assess_with(SensorNoise::preset(preset), estimator);
  }
};

TEST_F(ShortDrive, ExactOdometryIsExact) {
  EXPECT_GT(drive().driven_m, 14.9);
  EXPECT_LT(assess_with("none", "odometry").max_m, 0.005);
}

TEST_F(ShortDrive, MatchingCostsLittleWhereOdometryIsExact) {
  const Assessment found = assess_with("none", "matching");
  EXPECT_LT(found.rms_m, 0.03);
  EXPECT_LT(found.rms_deg, 0.5);
}

TEST_F(ShortDrive, MatchingHoldsTheAimUnderNoise) {
  const Assessment turtlebot = assess_with("turtlebot", "matching");
  EXPECT_LT(turtlebot.rms_m, 0.08);
  EXPECT_LT(turtlebot.rms_deg, 1);
  EXPECT_LT(turtlebot.max_m, 0.30);
  EXPECT_LT(turtlebot.rms_m, assess_with("turtlebot", "odometry").rms_m / 2);
  const Assessment harsh = assess_with("harsh", "matching");
  EXPECT_LT(harsh.rms_m, 0.15);
  EXPECT_LT(harsh.rms_deg, 2);
}

TEST_F(ShortDrive, AThirdOfWrongPointsDoesNotMislead) {
  SensorNoise noise = SensorNoise::preset("turtlebot");
  noise.wrong_points = 0.33;
  EXPECT_LT(assess_with(noise, "matching").rms_m, 0.10);
}

TEST_F(ShortDrive, TheTruthHasNoErrorAndSharpWalls) {
  const DriveLog log = with_noise(drive(), SensorNoise::preset("turtlebot"), 5);
  const auto obstacles = [&](const std::string& name) {
    const auto robot = make_estimator(name, log);
    const double largest_m = assess(log, *robot).max_m;
    if (name == "truth") {
      EXPECT_LT(largest_m, 1e-9);
    }
    return static_cast<double>(std::ranges::count_if(
        robot->map()->layers().flags,
        [](std::uint8_t flags) { return (flags & cell_flag::kOwnObstacle) != 0; }));
  };
  EXPECT_GT(obstacles("truth"), 200);
  EXPECT_LT(obstacles("matching"), 1.15 * obstacles("truth"));
}

TEST_F(ShortDrive, ComesBackFromAFileAsItWas) {
  const auto path = std::filesystem::path(testing::TempDir()) / "localization_test.drive";
  save_drive_log(path, drive());
  const DriveLog log = load_drive_log(path);
  std::filesystem::remove(path);
  ASSERT_EQ(log.revolutions.size(), drive().revolutions.size());
  EXPECT_EQ(assess(log, *make_estimator("matching", log)).rms_m,
            assess_with("none", "matching").rms_m);
  EXPECT_THROW((void)load_drive_log(path), std::runtime_error);
}

// A wheelchair with its scanner 0.78 m before the axle, whose odometry and scans are not measured
// at the same instants.
class RealRecording : public testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(kRawlog)) GTEST_SKIP() << "package mrpt-common is not installed";
    recording_ = load_rawlog(kRawlog);
  }
  const std::filesystem::path kRawlog =
      "/usr/share/mrpt/datasets/2006-01ENE-21-SENA_Telecom Faculty_one_loop_only.rawlog";
  Recording recording_;
};

TEST_F(RealRecording, ItsWheelsBringTheLidarWhereItWas) {
  const DriveLog log = to_drive_log(recording_);
  EXPECT_NEAR(log.lidar_in_robot.position.x_um, 780'000, 1000);
  const auto odometry = make_estimator("odometry", log);
  for (const WheelSample& sample : log.wheel_samples) odometry->add_wheels(sample);
  const Pose found = compose(to_pose(odometry->pose()), log.lidar_in_robot);
  const Pose told = recording_.scans.back().lidar_pose;
  EXPECT_EQ(log.revolutions.size(), recording_.scans.size());
  EXPECT_LT(std::sqrt(squared_distance_um2(found.position, told.position)), 300'000);  // of 76 m
  EXPECT_NEAR((found.heading - told.heading).degrees(), 0, 0.5);
}

TEST_F(RealRecording, ItsWallsAreAsThinAsThoseOfIcpSlam) {
  const DriveLog log = to_drive_log(recording_);
  const RecordedMap ours = map_of(log, "matching"), theirs = map_of(log, "icp-slam");
  EXPECT_LT(static_cast<double>(ours.obstacle_cells),
            1.10 * static_cast<double>(theirs.obstacle_cells));
  EXPECT_NEAR(static_cast<double>(ours.known_cells) / static_cast<double>(theirs.known_cells), 1,
              0.05);
  EXPECT_LT(ours.obstacle_cells, map_of(log, "odometry").obstacle_cells * 2 / 3);
}

TEST(DriveRecorder, RefusesWhatItDoesNotKnow) {
  EXPECT_THROW((void)record_drive({.world = "moon"}), std::invalid_argument);
  EXPECT_THROW((void)make_estimator("guess", {}), std::invalid_argument);
  EXPECT_THROW((void)SensorNoise::preset("awful"), std::invalid_argument);
}

}  // namespace
}  // namespace ivfm::host
