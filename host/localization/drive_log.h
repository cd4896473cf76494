// A drive as its sensors saw it, and where the robot really was: what localization is judged on.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "firmware/hal/clock.h"
#include "firmware/lidar/scan.h"
#include "firmware/localization/scan_matcher.h"
#include "firmware/wheel_drive/diff_drive_kinematics.h"
#include "host/simulator/mrpt_lidar.h"
#include "host/simulator/robot_body.h"

namespace ivfm::host {

// Rounded to micrometres and binary angles.
Pose to_pose(const TruePose& pose);

// No wheel of a drive log rolls faster: the times of recordings are rough.
inline constexpr std::int32_t kMaxWheelUmS = 4'000'000;

struct WheelSample {
  TimeUs arrived_us = 0, measured_us = 0;
  std::int32_t left = 0, right = 0;  // encoder counts
};

// A revolution as RplidarDriver::take_scan() passed it on.
struct Revolution {
  TimeUs arrived_us = 0, start_us = 0, end_us = 0;
  std::vector<ScanPoint> points;
};

struct TimedTruth {
  TimeUs time_us = 0;  // when the wheel sample of this moment arrived
  TruePose pose;       // in the robot's map frame, at the moment the drives sampled
};

struct DriveLog {
  WheelGeometry wheels;
  Pose start;  // in the robot's map frame
  // These three are other robots' in recordings; drive log files hold only drives of ours.
  Pose lidar_in_robot;
  std::int32_t matching_range_um = MatcherConfig{}.range_um;
  bool sees_all_around = true;  // its lidar
  std::vector<WheelSample> wheel_samples;
  std::vector<Revolution> revolutions;
  std::vector<TimedTruth> truth;  // one a wheel sample
  double driven_m = 0;
};

// How good the sensors are. The lidar's wrong points (glass, edges, people) end anywhere.
struct SensorNoise {
  OdometryNoise odometry;
  LidarModel lidar;
  double wrong_points = 0;  // share

  // `none`, `mild`, `turtlebot` or `harsh`; docs/localization.md lists their numbers. Throws
  // std::invalid_argument for other names.
  static SensorNoise preset(const std::string& name);
};

// `points` as if the lidar sat in the middle of the axle, where the localization expects it.
std::vector<ScanPoint> seen_from_axle(const std::vector<ScanPoint>& points,
                                      const Pose& lidar_in_robot);

// The same drive with worse sensors; `exact` is one with exact ones. One true motion then serves
// every preset. The wheels' errors are RobotBody's, seen from the other side: here the robot has
// moved as it did, and its encoders say something else.
DriveLog with_noise(const DriveLog& exact, const SensorNoise& noise, std::uint64_t seed);

// For later runs of the same program on the same machine; no format to rely on. Throw
// std::runtime_error when the file cannot be written or read.
void save_drive_log(const std::filesystem::path& path, const DriveLog& log);
DriveLog load_drive_log(const std::filesystem::path& path);

}  // namespace ivfm::host
