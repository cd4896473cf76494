// Where the robot is: odometry, corrected by matching scans against the robot's own map.
#pragma once

#include <cstdint>

#include "firmware/localization/odometry.h"
#include "firmware/localization/pose_history.h"
#include "firmware/localization/scan_matcher.h"

namespace ivfm {

struct LocalizationConfig {
  bool matching = false;  // false: odometry alone
  // From a beam to its arrival, for which odometry alone does not allow: an RPLIDAR sends 32 beams
  // (8 ms) at once, and the agent looks every 10 ms. Found best in simulation.
  TimeUs scan_delay_us = 11'000;
  MatcherConfig matcher;
};

// Counters for people.
struct LocalizationCounters {
  std::uint32_t matched = 0;
  std::uint32_t undecided = 0;  // too little seen or known: odometry alone
  std::uint32_t poor = 0;       // the scan contradicts the map
};

class Localization {
 public:
  // `surfaces`: see SurfaceMap. `max_wheel_um_s`: as in Odometry.
  Localization(const LocalizationConfig& config, std::span<SurfaceMap::Entry> surfaces,
               const WheelGeometry& geometry, std::int32_t max_wheel_um_s)
      : config_(config),
        odometry_(geometry, max_wheel_um_s),
        surfaces_(surfaces),
        matcher_(config.matcher) {}

  // Puts the robot at `pose` in the map.
  void reset(const Pose& pose);
  // Encoder positions; arguments and codes as Odometry::update().
  Status add_wheels(std::int32_t left_counts, std::int32_t right_counts, TimeUs measured_us);
  // A pose is known.
  bool ready() const { return !history_.empty(); }

  // In the map frame: now, and within the last second. pose_at() requires ready().
  Pose pose() const { return to_map(odometry_.pose()); }
  Pose pose_at(TimeUs time_us) const { return to_map(history_.at(time_us)); }
  // As ivfm::deskew() by the odometry, which no correction makes jump. Requires ready().
  void deskew(const Scan& scan, TimeUs start_us, TimeUs end_us, Scan& out) const {
    ivfm::deskew(scan, start_us, end_us, history_, out);
  }
  // Corrects the pose by a revolution that was measured (after deskew()) at `measured_us`. Call it
  // before the revolution is fused into `map`. Requires ready().
  MatchOutcome correct(const ExplorationMap& map, const Scan& scan, TimeUs measured_us);

  // After that: remembers where the surfaces are. Requires ready().
  void learn(const ExplorationMap& map, const Scan& scan, TimeUs measured_us) {
    surfaces_.learn(map, pose_at(measured_us), scan, config_.matcher.range_um);
  }

  const Odometry& odometry() const { return odometry_; }
  const ScanMatch& last_match() const { return match_; }
  const LocalizationCounters& counters() const { return counters_; }

 private:
  // T_map_odom applied.
  Pose to_map(const Pose& in_odometry) const;

  LocalizationConfig config_;
  Odometry odometry_;
  PoseHistory history_;  // in the odometry's frame
  SurfaceMap surfaces_;
  ScanMatcher matcher_;
  ScanMatch match_;
  Pose correction_;  // T_map_odom
  LocalizationCounters counters_;
};

}  // namespace ivfm
