// Where the robot is: odometry, corrected by matching scans against the robot's own map.
#pragma once

#include <cstdint>

#include "firmware/localization/odometry.h"
#include "firmware/localization/pose_history.h"
#include "firmware/localization/relocation.h"
#include "firmware/localization/scan_matcher.h"

namespace ivfm {

struct LocalizationConfig {
  bool matching = false;  // false: odometry alone
  // How much later than the encoders' counts a revolution arrives: an RPLIDAR sends 32 beams (8 ms)
  // at once. Found best in simulation.
  TimeUs scan_delay_us = 4'000;
  // How wrong the odometry may be: standard deviations that grow with the root of the distance,
  // and the share of a turn (wheel base, and the lidar's time, which is known to some ms).
  double slip_m_per_sqrt_m = 0.003;
  double drift_rad_per_sqrt_m = 0.03;
  double turn_error = 0.03;
  // Revolutions during which the robot turned more than this teach nothing: a lidar whose time is
  // some milliseconds off sees them turned. Binary angle units.
  std::uint16_t learn_turn = 546;
  // Whether the lidar sees all around: then much that is new at once means another place.
  bool sees_all_around = true;
  MatcherConfig matcher;
};

// Counters for people.
struct LocalizationCounters {
  std::uint32_t matched = 0;
  std::uint32_t undecided = 0;  // too little seen or known: odometry alone
  std::uint32_t poor = 0;       // the scan contradicts the map
  std::uint32_t lost = 0;       // times the place was lost
  std::uint32_t searches = 0;   // of the whole map, in vain
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
  // The map frame has moved by `moved` (T_new_old), and so have all poses in it.
  void re_express(const Pose& moved);
  // Encoder positions; arguments and codes as Odometry::update().
  Status add_wheels(std::int32_t left_counts, std::int32_t right_counts, TimeUs measured_us);
  // A pose is known.
  bool ready() const { return !history_.empty(); }

  // In the map frame: now, and within the last second. pose_at() requires ready().
  Pose pose() const { return to_map(odometry_.pose()); }
  Pose pose_at(TimeUs time_us) const { return to_map(history_.at(time_us)); }
  // As ivfm::deskew() by the odometry, which no correction makes jump. Requires ready().
  void deskew(const Scan& scan, TimeUs start_us, TimeUs end_us, Scan& out);
  // The surfaces that a scan (after deskew()) saw, until the next correct().
  std::span<const SurfaceSample> surfaces_in(const Scan& scan, std::int32_t cell_um) {
    matcher_.look_at(scan, cell_um);
    return matcher_.surfaces().samples();
  }
  // Corrects the pose by a revolution that was measured (after deskew()) at `measured_us`. Call it
  // before the revolution is fused into `map`. Requires ready().
  MatchOutcome correct(const ExplorationMap& map, const Scan& scan, TimeUs measured_us);

  // The last revolution fitted the map, or the place is new: it may be painted. Not true from the
  // first revolution on that contradicts the map, or suddenly fits it less, until others have
  // fitted well.
  bool trusted() const { return doubt_ == 0; }
  // Too much contradicted the map: stand still, correct() searches it.
  bool lost() const { return lost_; }

  // After that: remembers where the surfaces are. Requires ready().
  void learn(const ExplorationMap& map, const Scan& scan, TimeUs measured_us) {
    if (turned_ > config_.learn_turn) return;
    surfaces_.learn(map, pose_at(measured_us), scan, matcher_.surfaces(), config_.matcher.range_um);
  }

  const Odometry& odometry() const { return odometry_; }
  const ScanMatch& last_match() const { return match_; }
  // Of the pose at the last revolution: metres and radians.
  const Symmetric3& covariance() const { return covariance_; }
  const LocalizationCounters& counters() const { return counters_; }

 private:
  void predict(const Pose& in_odometry);
  void judge_odometry(const Vector3& off);
  void judge(MatchOutcome outcome, const ExplorationMap& map);
  std::int32_t could_fit() const;
  std::int32_t share_that_fits() const;
  void weigh_doubt(MatchOutcome outcome);
  void relocate(const ExplorationMap& map, const Scan& scan);
  void put_at(const Pose& pose, const Pose& in_odometry);
  // T_map_odom applied.
  Pose to_map(const Pose& in_odometry) const;

  LocalizationConfig config_;
  Odometry odometry_;
  PoseHistory history_;  // in the odometry's frame
  SurfaceMap surfaces_;
  ScanMatcher matcher_;
  ScanMatch match_;
  Relocation relocation_;
  Pose correction_;             // T_map_odom
  std::uint16_t turned_ = 0;    // during the revolution
  Pose matched_;                // in the odometry's frame, at the last revolution
  Symmetric3 covariance_{};     // of the pose in the map then: metres and radians
  double mistrust_ = 1;         // factor of the odometry's variances
  std::int32_t usual_fit_ = 0;  // of the last revolutions, in 256ths of a percent
  std::uint8_t doubt_ = 0;      // so many 16ths of revolutions have to fit
  bool lost_ = false;
  bool has_matched_ = false;  // in this map frame
  LocalizationCounters counters_;
};

}  // namespace ivfm
