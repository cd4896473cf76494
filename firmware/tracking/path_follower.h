// Drives along waypoints: turns on the spot towards them, then drives, within speed and
// acceleration limits.
#pragma once

#include <cstdint>
#include <span>

#include "firmware/hal/clock.h"
#include "shared/geometry/pose.h"
#include "shared/geometry/velocity.h"
#include "shared/status/status.h"

namespace ivfm {

struct FollowerConfig {
  std::int32_t max_speed_um_s = 300'000;
  std::int32_t max_turn_mrad_s = 1'500;
  std::int32_t acceleration_um_s2 = 500'000;  // also of braking
  std::int32_t turn_acceleration_mrad_s2 = 4'000;
  std::int32_t goal_tolerance_um = 40'000;      // the last waypoint counts as reached
  std::int32_t waypoint_tolerance_um = 20'000;  // the others: how far corners are cut
  // Beyond this heading error it stops and turns on the spot, until it is below the second one.
  BinaryAngle turn_on_spot_above = BinaryAngle::from_degrees(40);
  BinaryAngle drive_below = BinaryAngle::from_degrees(8);
  std::int32_t steering_gain = 3;            // mrad/s of turn rate for each mrad of heading error
  std::uint32_t stuck_after_us = 5'000'000;  // without progress
};

// A setpoint and how the drive along the path stands.
struct FollowStep {
  Velocity velocity;
  // kOk: under way; kEmpty: no path, or its end is reached and the robot stands; kTimeout: no
  // progress for `stuck_after_us` (velocity is zero, the path is given up).
  Status status = Status::kEmpty;
};

class PathFollower {
 public:
  explicit PathFollower(const FollowerConfig& config) : config_(config) {}

  // Follows `waypoints` (map frame, in driving order, nearest to the robot first) from now on. The
  // caller keeps them in memory until the next start() or cancel(). kInvalidArgument: none given.
  Status start(std::span<const Point> waypoints, TimeUs now_us);
  // Gives the path up; the next steps brake to a standstill.
  void cancel();

  // The next setpoint. `commanded`: what really went to the wheels last (after the supervisor); the
  // acceleration limits hold with respect to it.
  FollowStep step(const Pose& pose, const Velocity& commanded, TimeUs now_us);

  bool active() const { return !waypoints_.empty(); }
  // Index of the waypoint it drives to. Requires active().
  std::size_t next_waypoint() const { return next_; }

 private:
  void skip_reached_waypoints(Point position, TimeUs now_us);
  bool passed_next_waypoint(Point position) const;
  bool at_goal(Point position) const;
  void note_progress(std::int64_t distance, std::int32_t error_raw, TimeUs now_us);
  Velocity wish(const Pose& pose, TimeUs now_us);
  std::int32_t approach_speed_um_s(Point position, std::int64_t distance) const;
  std::int32_t turn_rate_mrad_s(std::int32_t error_raw) const;
  Velocity ramp(const Velocity& from, const Velocity& to, std::uint32_t elapsed_us) const;

  FollowerConfig config_;
  std::span<const Point> waypoints_;
  std::size_t next_ = 0;               // the waypoint it drives to
  bool turning_ = false;               // on the spot
  std::int64_t best_distance_um_ = 0;  // to the next waypoint so far
  std::int32_t best_error_raw_ = 0;    // of the heading towards it so far
  TimeUs last_step_us_ = 0;
  TimeUs progress_us_ = 0;
};

}  // namespace ivfm
