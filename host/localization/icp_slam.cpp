#include "host/localization/icp_slam.h"

#include <mrpt/maps/CSimplePointsMap.h>
#include <mrpt/obs/CObservation2DRangeScan.h>
#include <mrpt/obs/CObservationOdometry.h>
#include <mrpt/poses/CPose3DPDF.h>
#include <mrpt/slam/CMetricMapBuilderICP.h>

#include <chrono>
#include <cmath>
#include <numbers>

#include "firmware/localization/odometry.h"
#include "firmware/localization/pose_history.h"

namespace ivfm::host {
namespace {

constexpr std::size_t kRays = 720;

class IcpSlam final : public PoseEstimator {
 public:
  explicit IcpSlam(const DriveLog& log)
      : odometry_(log.wheels, kMaxWheelUmS),
        lidar_in_robot_(to_mrpt(to_true_pose(log.lidar_in_robot))) {
    odometry_.reset(log.start);
    builder_.setVerbosityLevel(mrpt::system::LVL_ERROR);
    configure();
    builder_.initialize();
    start_ = at_scan_ = pose_ = odometry_at_scan_ = to_true_pose(log.start);
  }

  void add_wheels(const WheelSample& s) override {
    if (!ok(odometry_.update(s.left, s.right, s.measured_us))) return;
    history_.add(s.measured_us, odometry_.pose());
    const mrpt::poses::CPose2D moved =
        to_mrpt(to_true_pose(odometry_.pose())) - to_mrpt(odometry_at_scan_);
    const mrpt::poses::CPose2D now = to_mrpt(at_scan_) + moved;
    pose_ = {now.x(), now.y(), now.phi()};
  }

  void add_revolution(const Revolution& revolution) override {
    if (history_.empty()) return;
    const TimeUs measured_us = revolution.end_us - kDelayUs;
    raw_.clear();
    for (const ScanPoint& point : revolution.points) (void)raw_.push(point);
    deskew(raw_, revolution.start_us - kDelayUs, measured_us, history_, scan_);
    odometry_at_scan_ = to_true_pose(history_.at(measured_us));
    const auto stamp = began_ + std::chrono::microseconds(measured_us);
    const auto odometry = mrpt::obs::CObservationOdometry::Create();
    odometry->timestamp = stamp;
    odometry->sensorLabel = "odometry";
    odometry->odometry = to_mrpt(odometry_at_scan_) - to_mrpt(start_);
    builder_.processObservation(odometry);
    builder_.processObservation(observation(stamp));
    const auto mean = builder_.getCurrentPoseEstimation()->getMeanVal();
    const mrpt::poses::CPose2D now = to_mrpt(start_) + mrpt::poses::CPose2D(mean);
    at_scan_ = pose_ = {now.x(), now.y(), now.phi()};
  }

  TruePose pose() const override { return pose_; }

 private:
  static constexpr TimeUs kDelayUs = 11'000;  // LocalizationConfig::scan_delay_us

  static mrpt::poses::CPose2D to_mrpt(const TruePose& p) { return {p.x_m, p.y_m, p.heading_rad}; }

  void configure() {
    mrpt::maps::CSimplePointsMap::TMapDefinition points;
    points.insertionOpts.minDistBetweenLaserPoints = 0.05f;
    points.insertionOpts.fuseWithExisting = false;
    points.insertionOpts.isPlanarMap = true;
    auto& options = builder_.ICP_options;
    options.mapInitializers.push_back(points);
    options.matchAgainstTheGrid = false;
    options.localizationLinDistance = 0.05;
    options.localizationAngDistance = 1 * std::numbers::pi / 180;
    options.insertionLinDistance = 0.5;
    options.insertionAngDistance = 20 * std::numbers::pi / 180;
    options.minICPgoodnessToAccept = 0.4;
    auto& icp = builder_.ICP_params;
    icp.ICP_algorithm = mrpt::slam::icpClassic;
    icp.maxIterations = 80;
    icp.minAbsStep_trans = icp.minAbsStep_rot = 1e-6;
    icp.thresholdDist = 0.3;
    icp.thresholdAng = 0.15 * std::numbers::pi / 180;
    icp.ALFA = 0.8;
    icp.smallestThresholdDist = 0.05;
    icp.corresponding_points_decimation = 1;
  }

  mrpt::obs::CObservation2DRangeScan::Ptr observation(mrpt::Clock::time_point stamp) const {
    const auto scan = mrpt::obs::CObservation2DRangeScan::Create();
    scan->timestamp = stamp;
    scan->sensorLabel = "lidar";
    scan->aperture = static_cast<float>(2 * std::numbers::pi * (kRays - 1) / kRays);
    scan->rightToLeft = true;
    scan->maxRange = 12;
    scan->sensorPose = mrpt::poses::CPose3D(lidar_in_robot_);
    scan->resizeScan(kRays);
    for (std::size_t i = 0; i < kRays; ++i) {
      scan->setScanRange(i, 0);
      scan->setScanRangeValidity(i, false);
    }
    for (const ScanPoint& point : scan_.points()) {
      if (point.echo != Echo::kHit) continue;
      // Ray i lies at -aperture/2 + i * 360 degrees / kRays.
      const double ray =
          (point.bearing.radians() + scan->aperture / 2) * kRays / 2 / std::numbers::pi;
      const auto i = static_cast<std::size_t>(std::lround(ray) + kRays) % kRays;
      scan->setScanRange(i, static_cast<float>(point.range_mm * 1e-3));
      scan->setScanRangeValidity(i, true);
    }
    return scan;
  }

  Odometry odometry_;
  PoseHistory history_;
  Scan raw_{}, scan_{};
  mrpt::poses::CPose2D lidar_in_robot_;
  mrpt::slam::CMetricMapBuilderICP builder_;
  // initialize() stamps the start pose with the wall clock; the drive comes after it.
  mrpt::Clock::time_point began_ = mrpt::Clock::now();
  TruePose start_;  // the builder begins at its own origin
  TruePose pose_, at_scan_, odometry_at_scan_;
};

}  // namespace

std::unique_ptr<PoseEstimator> make_icp_slam(const DriveLog& log) {
  return std::make_unique<IcpSlam>(log);
}

}  // namespace ivfm::host
