#include "firmware/tracking/path_follower.h"

#include <algorithm>
#include <cstdlib>
#include <limits>

#include "shared/geometry/integer_sqrt.h"

namespace ivfm {
namespace {

// A longer gap between steps counts as this much: the ramp must not jump after a pause.
constexpr TimeUs kLongestStepUs = 100'000;
// What counts as progress: this much nearer to the waypoint, or this much better aligned.
constexpr std::int64_t kProgressUm = 20'000;
constexpr std::int32_t kProgressRaw = 546;  // 3 degrees
// The share of the acceleration that an approach plans with; the rest corrects.
constexpr std::int64_t kPlannedPercent = 80;
// The path's beginning need not lie exactly under the robot: it is planned between cells.
constexpr std::int64_t kJoinToleranceUm = 60'000;

std::int64_t root(std::int64_t square) {
  return integer_sqrt(static_cast<std::uint64_t>(std::max<std::int64_t>(0, square)));
}

std::int64_t distance_um(Point a, Point b) { return root(squared_distance_um2(a, b)); }

BinaryAngle direction(Point from, Point to) {
  return atan2_binary(std::int64_t{to.y_um} - from.y_um, std::int64_t{to.x_um} - from.x_um);
}

std::int32_t magnitude(BinaryAngle angle) { return std::abs(std::int32_t{angle.signed_raw()}); }

std::int32_t step_towards(std::int32_t from, std::int32_t to, std::int64_t largest_change) {
  const std::int64_t change = std::clamp(std::int64_t{to} - from, -largest_change, largest_change);
  return static_cast<std::int32_t>(from + change);
}

}  // namespace

Status PathFollower::start(std::span<const Point> waypoints, TimeUs now_us) {
  if (waypoints.empty()) return Status::kInvalidArgument;
  waypoints_ = waypoints;
  next_ = 0;
  turning_ = false;
  best_distance_um_ = std::numeric_limits<std::int64_t>::max();
  best_error_raw_ = std::numeric_limits<std::int32_t>::max();
  progress_us_ = now_us;
  last_step_us_ = now_us;
  return Status::kOk;
}

void PathFollower::cancel() { waypoints_ = {}; }

FollowStep PathFollower::step(const Pose& pose, const Velocity& commanded, TimeUs now_us) {
  const auto elapsed_us = static_cast<std::uint32_t>(
      std::min(now_us - std::min(now_us, last_step_us_), kLongestStepUs));
  last_step_us_ = now_us;
  Velocity target;
  bool stuck = false;
  if (active()) {
    skip_reached_waypoints(pose.position, now_us);
    target = at_goal(pose.position) ? Velocity{} : wish(pose, now_us);
    stuck = now_us - progress_us_ > config_.stuck_after_us;
    if (stuck || at_goal(pose.position)) cancel();
  }
  const Velocity next = ramp(commanded, stuck ? Velocity{} : target, elapsed_us);
  if (stuck) return {next, Status::kTimeout};
  return {next, active() || !next.is_zero() ? Status::kOk : Status::kEmpty};
}

void PathFollower::skip_reached_waypoints(Point position, TimeUs now_us) {
  const auto reached = [&] {
    return distance_um(position, waypoints_[next_]) <= config_.waypoint_tolerance_um ||
           passed_next_waypoint(position);
  };
  while (next_ + 1 < waypoints_.size() && reached()) {
    ++next_;
    best_distance_um_ = std::numeric_limits<std::int64_t>::max();
    best_error_raw_ = std::numeric_limits<std::int32_t>::max();
    progress_us_ = now_us;
  }
}

// The robot is on the strip of the segment that begins at the next waypoint.
bool PathFollower::passed_next_waypoint(Point position) const {
  const Point begin = waypoints_[next_], end = waypoints_[next_ + 1];
  const std::int64_t along_x = std::int64_t{end.x_um} - begin.x_um;
  const std::int64_t along_y = std::int64_t{end.y_um} - begin.y_um;
  const std::int64_t x = std::int64_t{position.x_um} - begin.x_um;
  const std::int64_t y = std::int64_t{position.y_um} - begin.y_um;
  const std::int64_t length = distance_um(begin, end);
  const std::int64_t aside = std::abs(x * along_y - y * along_x);
  const std::int64_t tolerance =
      next_ == 0 ? kJoinToleranceUm : std::int64_t{config_.waypoint_tolerance_um};
  return x * along_x + y * along_y > 0 && aside <= tolerance * length;
}

bool PathFollower::at_goal(Point position) const {
  return next_ + 1 == waypoints_.size() &&
         distance_um(position, waypoints_[next_]) <= config_.goal_tolerance_um;
}

Velocity PathFollower::wish(const Pose& pose, TimeUs now_us) {
  const Point target = waypoints_[next_];
  const std::int64_t distance = distance_um(pose.position, target);
  const BinaryAngle error = direction(pose.position, target) - pose.heading;
  const std::int32_t error_raw = magnitude(error);
  note_progress(distance, error_raw, now_us);
  turning_ = error_raw >
             (turning_ ? magnitude(config_.drive_below) : magnitude(config_.turn_on_spot_above));
  const std::int32_t turn = turn_rate_mrad_s(error.signed_raw());
  if (turning_) return {0, turn};
  // The further off the heading, the slower: zero where turning on the spot begins.
  const std::int64_t threshold = magnitude(config_.turn_on_spot_above);
  const std::int64_t speed = approach_speed_um_s(pose.position, distance);
  return {static_cast<std::int32_t>(speed * (threshold - error_raw) / threshold), turn};
}

void PathFollower::note_progress(std::int64_t distance, std::int32_t error_raw, TimeUs now_us) {
  if (distance <= best_distance_um_ - kProgressUm) {
    best_distance_um_ = distance;
    progress_us_ = now_us;
  }
  if (error_raw <= best_error_raw_ - kProgressRaw) {
    best_error_raw_ = error_raw;
    progress_us_ = now_us;
  }
}

// The speed from which it can still stop at the end of the path, or where the path bends so sharply
// that it has to turn on the spot. `distance`: to the next waypoint, um.
std::int32_t PathFollower::approach_speed_um_s(Point position, std::int64_t distance) const {
  const std::int64_t planned = config_.acceleration_um_s2 * kPlannedPercent / 100;
  const std::int64_t fastest = config_.max_speed_um_s;
  const std::int64_t braking_distance = fastest * fastest / (2 * planned);
  std::int64_t free = distance;
  BinaryAngle along = direction(position, waypoints_[next_]);
  for (std::size_t i = next_; i + 1 < waypoints_.size() && free < braking_distance; ++i) {
    const BinaryAngle onward = direction(waypoints_[i], waypoints_[i + 1]);
    if (magnitude(onward - along) > magnitude(config_.turn_on_spot_above)) break;
    free += distance_um(waypoints_[i], waypoints_[i + 1]);
    along = onward;
  }
  return static_cast<std::int32_t>(std::min(fastest, root(2 * planned * free)));
}

// Proportional near the wanted heading; further away such that it can still brake in time.
std::int32_t PathFollower::turn_rate_mrad_s(std::int32_t error_raw) const {
  const std::int64_t error_mrad = std::abs(std::int64_t{error_raw}) * 6283 / 65536;
  const std::int64_t planned = config_.turn_acceleration_mrad_s2 * kPlannedPercent / 100;
  const std::int64_t rate =
      std::min({std::int64_t{config_.max_turn_mrad_s}, config_.steering_gain * error_mrad,
                root(2 * planned * error_mrad)});
  return static_cast<std::int32_t>(error_raw < 0 ? -rate : rate);
}

Velocity PathFollower::ramp(const Velocity& from, const Velocity& to,
                            std::uint32_t elapsed_us) const {
  const auto change = [&](std::int32_t rate) {
    return std::int64_t{rate} * elapsed_us / 1'000'000;
  };
  return {
      step_towards(from.v_um_s, to.v_um_s, change(config_.acceleration_um_s2)),
      step_towards(from.omega_mrad_s, to.omega_mrad_s, change(config_.turn_acceleration_mrad_s2))};
}

}  // namespace ivfm
