// A simulated RPLIDAR A1: beams cast by MRPT in a world, with the sensor's noise and dropouts.
#pragma once

#include <cstdint>
#include <memory>
#include <random>
#include <span>
#include <string>

#include "firmware/lidar/scan.h"
#include "host/environment/world.h"
#include "host/simulator/robot_body.h"

namespace ivfm::host {

// The A1M8's figures (Slamtec LD108 datasheet, "Measurement performance").
struct LidarModel {
  double min_range_m = 0.15;
  double max_range_m = 12;
  double noise_m = 0.002;      // standard deviation at range 0
  double noise_share = 0.004;  // and per metre of range ("< 1 % of the distance")
  double dropout = 0.005;      // share of beams without a measurement

  // `none` (exact) or `mild` (the figures above). Throws std::invalid_argument for other names.
  static LidarModel preset(const std::string& name);
};

// One measurement. Without an echo the range is 0 and so is the quality, as the device says it.
struct LidarSample {
  std::uint16_t range_mm = 0;
  std::uint8_t quality = 0;  // 0 .. 63
};

// Casts beams by the routine under MRPT's COccupancyGridMap2D::laserScanSimulator, one at a time,
// so that the robot can move while the head turns. Robots are seen as discs.
class MrptLidar {
 public:
  MrptLidar(const World& world, const LidarModel& model, std::uint64_t seed);
  ~MrptLidar();

  // The world has changed; it has the same size.
  void take_world(const World& world);

  // A beam from the middle of `robot`, `bearing_rad` counter-clockwise from its front. `others`:
  // the middles of the other robots, discs of `other_radius_m`.
  LidarSample measure(const TruePose& robot, double bearing_rad, std::span<const TruePose> others,
                      double other_radius_m);

  // The same for each beam's bearing: fills in what the device tells of it.
  void measure(const TruePose& robot, std::span<ScanPoint> beams, std::span<const TruePose> others,
               double other_radius_m);

  // The true distance along that beam in metres; infinity beyond the largest range.
  double true_range_m(const TruePose& robot, double bearing_rad, std::span<const TruePose> others,
                      double other_radius_m) const;

 private:
  struct Grid;  // keeps MRPT's headers out of this one

  std::unique_ptr<Grid> grid_;
  LidarModel model_;
  std::mt19937_64 random_;
};

}  // namespace ivfm::host
