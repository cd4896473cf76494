#include "host/localization/recorded_map.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <opencv2/core.hpp>

#include "firmware/agent/profile.h"
#include "firmware/localization/localization.h"
#include "firmware/mapping/scan_fusion.h"
#include "host/localization/estimators.h"

namespace ivfm::host {
namespace {

constexpr TimeUs kStartUs = 1'000'000;
constexpr TimeUs kWheelPeriodUs = 50'000;
// As far as recordings are read: their scanners are more exact than an RPLIDAR.
constexpr std::int32_t kMatchingRangeUm = 12'000'000;

Pose inverse(const Pose& ab) {
  const Pose back{{}, -ab.heading};
  return {transform(back, -ab.position.x_um, -ab.position.y_um), -ab.heading};
}

}  // namespace

DriveLog to_drive_log(const Recording& recording) {
  DriveLog log;
  const double counts_per_m =
      log.wheels.counts_per_turn / (log.wheels.wheel_circumference_um * 1e-6);
  const double half_track_m = log.wheels.track_um * 1e-6 / 2;
  double left = 0, right = 0;
  const auto roll = [&](double forward_m, double turn_rad, TimeUs time_us) {
    left += (forward_m - turn_rad * half_track_m) * counts_per_m;
    right += (forward_m + turn_rad * half_track_m) * counts_per_m;
    log.wheel_samples.push_back({time_us, time_us, static_cast<std::int32_t>(std::llround(left)),
                                 static_cast<std::int32_t>(std::llround(right))});
  };
  const RecordedScan* before = nullptr;
  log.lidar_in_robot = recording.lidar_in_robot;
  log.matching_range_um = kMatchingRangeUm;
  log.sees_all_around = false;
  const Pose robot_in_lidar = inverse(recording.lidar_in_robot);
  for (const RecordedScan& scan : recording.scans) {
    const TimeUs now_us = kStartUs + scan.time_us;
    if (before == nullptr) {
      log.start = compose(scan.lidar_pose, robot_in_lidar);
      roll(0, 0, now_us);
    } else {
      const TruePose from = to_true_pose(compose(before->lidar_pose, robot_in_lidar));
      const TruePose to = to_true_pose(compose(scan.lidar_pose, robot_in_lidar));
      const double turn = std::remainder(to.heading_rad - from.heading_rad, 2 * std::numbers::pi);
      const double dx = to.x_m - from.x_m, dy = to.y_m - from.y_m;
      const double middle = from.heading_rad + turn / 2;
      const double forward = dx * std::cos(middle) + dy * std::sin(middle);
      const TimeUs start_us = kStartUs + before->time_us;
      const auto steps =
          static_cast<int>(std::max<TimeUs>(1, (now_us - start_us) / kWheelPeriodUs));
      for (int i = 1; i <= steps; ++i) {
        roll(forward / steps, turn / steps, start_us + (now_us - start_us) * i / steps);
      }
    }
    // The estimators take a revolution for older than its arrival: here it is not.
    const TimeUs arrived_us = now_us + LocalizationConfig{}.scan_delay_us;
    log.revolutions.push_back({arrived_us, arrived_us, arrived_us, full_turn(scan)});
    before = &scan;
  }
  return log;
}

RecordedMap map_of(const DriveLog& log, const std::string& name) {
  const auto cells = std::make_unique<MapStorage<RobotProfile::kWindowCells>>();
  ExplorationMap map(cells->layers(), RobotProfile::kCellUm, RobotProfile::kWindowCells, 105'000);
  FusionConfig fusion_config;
  fusion_config.doubt_changes = true;
  ScanFusion fusion(fusion_config);
  const auto estimator = make_estimator(name, log);
  RecordedMap result;
  result.estimator = name;
  result.way.label = name;
  const auto scan = std::make_unique<Scan>();
  std::size_t sample = 0;
  for (const Revolution& revolution : log.revolutions) {
    for (; sample < log.wheel_samples.size() &&
           log.wheel_samples[sample].arrived_us <= revolution.arrived_us;
         ++sample) {
      estimator->add_wheels(log.wheel_samples[sample]);
    }
    const double before_s = thread_cpu_s();
    estimator->add_revolution(revolution);
    result.cpu_s += thread_cpu_s() - before_s;
    const Pose pose = compose(to_pose(estimator->pose()), log.lidar_in_robot);
    scan->clear();
    for (const ScanPoint& point : revolution.points) (void)scan->push(point);
    fusion.fuse(map, pose, *scan, false);
    result.way.points.push_back(pose.position);
  }
  const std::size_t size = map.frame().size();
  result.layers = {map.frame(), std::vector<std::uint16_t>(size), std::vector<std::uint8_t>(size)};
  for (std::size_t i = 0; i < size; ++i) {
    const bool obstacle = (map.layers().flags[i] & cell_flag::kObstacle) != 0;
    const bool known = map.layers().occupancy[i] != occupancy::kUnknown;
    result.layers.obstacles[i] = obstacle ? 1 : 0;
    result.layers.visits[i] = known && !obstacle ? 1 : 0;
    result.obstacle_cells += obstacle ? 1 : 0;
    result.known_cells += known ? 1 : 0;
  }
  return result;
}

void write_maps(const std::filesystem::path& path, const std::vector<RecordedMap>& maps) {
  std::vector<cv::Mat> pictures;
  int rows = 0;
  for (const RecordedMap& map : maps) {
    const Trajectory ways[] = {map.way};
    pictures.push_back(draw_map_picture(
        map.layers, ways,
        {map.estimator, std::to_string(map.obstacle_cells) + " obstacle cells", nullptr, 1200}));
    rows = std::max(rows, pictures.back().rows);
  }
  for (cv::Mat& picture : pictures) {
    cv::copyMakeBorder(picture, picture, 0, rows - picture.rows, 0, 0, cv::BORDER_CONSTANT,
                       cv::Scalar::all(255));
  }
  cv::Mat whole;
  cv::hconcat(pictures, whole);
  write_png(path, whole);
}

}  // namespace ivfm::host
