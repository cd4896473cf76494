#include "host/localization/estimators.h"

#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <stdexcept>

#include "firmware/agent/agent.h"
#include "host/localization/icp_slam.h"

namespace ivfm::host {
namespace {

constexpr TimeUs kErrorPeriodUs = 100'000;

class OdometryEstimator final : public PoseEstimator {
 public:
  explicit OdometryEstimator(const DriveLog& log) : odometry_(log.wheels, kMaxWheelUmS) {
    odometry_.reset(log.start);
  }
  void add_wheels(const WheelSample& s) override {
    (void)odometry_.update(s.left, s.right, s.measured_us);
  }
  void add_revolution(const Revolution&) override {}
  TruePose pose() const override { return to_true_pose(odometry_.pose()); }

 private:
  Odometry odometry_;
};

// The agent's way from a revolution to a corrected pose and a map, without the rest of the agent.
template <typename Profile>
class MatchingEstimator final : public PoseEstimator {
 public:
  explicit MatchingEstimator(const DriveLog& log)
      : map_(cells_.layers(), Profile::kCellUm, Profile::kWindowCells, 105'000),
        localization_(config(log), surfaces_.surface_entries, log.wheels, kMaxWheelUmS),
        lidar_in_robot_(log.lidar_in_robot) {
    fusion_config_.mapping_range_um = kLidarMappingRangeUm;
    fusion_config_.doubt_changes = true;
    localization_.reset(log.start);
    map_.clear(map_.frame().cell_at(log.start.position));
  }
  void add_wheels(const WheelSample& s) override {
    (void)localization_.add_wheels(s.left, s.right, s.measured_us);
  }
  void add_revolution(const Revolution& revolution) override {
    if (!localization_.ready()) return;
    raw_.clear();
    for (const ScanPoint& point : seen_from_axle(revolution.points, lidar_in_robot_)) {
      (void)raw_.push(point);
    }
    const TimeUs delay_us = LocalizationConfig{}.scan_delay_us;
    const TimeUs measured_us = revolution.end_us - delay_us;
    localization_.deskew(raw_, revolution.start_us - delay_us, measured_us, scan_);
    (void)localization_.correct(map_, scan_, measured_us);
    if (!localization_.trusted()) return;
    const Pose pose = localization_.pose_at(measured_us);
    (void)map_.roll_to(map_.frame().cell_at(pose.position));
    ScanFusion(fusion_config_).fuse(map_, pose, scan_, false);
    localization_.learn(map_, scan_, measured_us);
  }
  TruePose pose() const override { return to_true_pose(localization_.pose()); }
  const ExplorationMap* map() const override { return &map_; }
  std::string remark() const override {
    const LocalizationCounters& n = localization_.counters();
    const auto occupied = std::ranges::count_if(
        map_.layers().flags, [](std::uint8_t f) { return (f & cell_flag::kOwnObstacle) != 0; });
    char text[120];
    std::snprintf(text, sizeof text, "matched %u undecided %u poor %u, %ld obstacle cells",
                  unsigned(n.matched), unsigned(n.undecided), unsigned(n.poor),
                  static_cast<long>(occupied));
    return text;
  }

 private:
  static LocalizationConfig config(const DriveLog& log) {
    LocalizationConfig config;
    config.matching = true;
    config.matcher.range_um = log.matching_range_um;
    config.sees_all_around = log.sees_all_around;
    return config;
  }

  MapStorage<Profile::kWindowCells> cells_{};
  SurfaceStorage<Profile::kSurfaceCells> surfaces_{};
  ExplorationMap map_;
  FusionConfig fusion_config_;
  Localization localization_;
  Pose lidar_in_robot_;
  Scan raw_{}, scan_{};
};

// Paints the map that a robot would which always knows where it is.
class TruthEstimator final : public PoseEstimator {
 public:
  explicit TruthEstimator(const DriveLog& log)
      : log_(log),
        map_(cells_.layers(), RobotProfile::kCellUm, RobotProfile::kWindowCells, 105'000) {
    fusion_config_.mapping_range_um = kLidarMappingRangeUm;
    fusion_config_.doubt_changes = true;
    map_.clear(map_.frame().cell_at(log.start.position));
  }
  void add_wheels(const WheelSample& s) override {
    history_.add(s.measured_us, to_pose(log_.truth.at(next_++).pose));
  }
  void add_revolution(const Revolution& revolution) override {
    if (history_.empty()) return;
    raw_.clear();
    for (const ScanPoint& point : revolution.points) (void)raw_.push(point);
    const TimeUs delay_us = LocalizationConfig{}.scan_delay_us;
    const TimeUs measured_us = revolution.end_us - delay_us;
    deskew(raw_, revolution.start_us - delay_us, measured_us, history_, scan_);
    const Pose pose = history_.at(measured_us);
    (void)map_.roll_to(map_.frame().cell_at(pose.position));
    ScanFusion(fusion_config_).fuse(map_, pose, scan_, false);
  }
  TruePose pose() const override { return log_.truth.at(next_ - 1).pose; }
  const ExplorationMap* map() const override { return &map_; }

 private:
  const DriveLog& log_;
  MapStorage<RobotProfile::kWindowCells> cells_{};
  ExplorationMap map_;
  FusionConfig fusion_config_;
  PoseHistory history_;
  std::size_t next_ = 0;
  Scan raw_{}, scan_{};
};

void summarize(Assessment& result) {
  double squares = 0, turn_squares = 0;
  for (const PoseError& e : result.errors) {
    squares += e.position_m * e.position_m;
    turn_squares += e.heading_deg * e.heading_deg;
    result.max_m = std::max(result.max_m, e.position_m);
    result.max_deg = std::max(result.max_deg, std::abs(e.heading_deg));
  }
  const auto count = static_cast<double>(std::max<std::size_t>(result.errors.size(), 1));
  result.rms_m = std::sqrt(squares / count);
  result.rms_deg = std::sqrt(turn_squares / count);
}

}  // namespace

std::unique_ptr<PoseEstimator> make_estimator(const std::string& name, const DriveLog& log) {
  if (name == "odometry") return std::make_unique<OdometryEstimator>(log);
  if (name == "matching") return std::make_unique<MatchingEstimator<RobotProfile>>(log);
  if (name == "matching-mcu") return std::make_unique<MatchingEstimator<McuProfile>>(log);
  if (name == "truth") return std::make_unique<TruthEstimator>(log);
  if (name == "icp-slam") return make_icp_slam(log);
  throw std::invalid_argument(
      "estimator '" + name +
      "' is unknown: use odometry, matching, matching-mcu, truth or icp-slam");
}

double thread_cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

Assessment assess(const DriveLog& log, PoseEstimator& estimator) {
  Assessment result;
  std::size_t revolution = 0;
  TimeUs next_us = 0;
  const double before_s = thread_cpu_s();
  for (std::size_t i = 0; i < log.wheel_samples.size(); ++i) {
    const WheelSample& sample = log.wheel_samples[i];
    for (; revolution < log.revolutions.size() &&
           log.revolutions[revolution].arrived_us < sample.arrived_us;
         ++revolution) {
      estimator.add_revolution(log.revolutions[revolution]);
    }
    estimator.add_wheels(sample);
    const TimedTruth& truth = log.truth[i];
    if (truth.time_us < next_us) continue;
    next_us = truth.time_us + kErrorPeriodUs;
    const TruePose guess = estimator.pose();
    const double turn =
        std::remainder(guess.heading_rad - truth.pose.heading_rad, 2 * std::numbers::pi);
    result.errors.push_back({static_cast<double>(truth.time_us) * 1e-6,
                             std::hypot(guess.x_m - truth.pose.x_m, guess.y_m - truth.pose.y_m),
                             turn * 180 / std::numbers::pi});
  }
  result.cpu_s = thread_cpu_s() - before_s;
  result.remark = estimator.remark();
  summarize(result);
  return result;
}

}  // namespace ivfm::host
