// Odometry: the robot's pose from the absolute encoder positions of its wheels, in integers.
#pragma once

#include <cstdint>

#include "firmware/hal/clock.h"
#include "firmware/wheel_drive/diff_drive_kinematics.h"
#include "shared/geometry/pose.h"
#include "shared/status/status.h"

namespace ivfm {

// The heading comes straight from the wheels' difference since reset(), so no rounding piles up in
// it; the position follows the mid-point heading of each step.
class Odometry {
 public:
  Odometry() = default;
  // `max_wheel_um_s`: no wheel can roll faster (> 0, up to 4 m/s); what would need more is refused.
  Odometry(const WheelGeometry& geometry, std::int32_t max_wheel_um_s);

  // Puts the robot at `pose`; the next update() only notes the encoders.
  void reset(const Pose& pose);

  // Takes encoder positions (counts that grow forward and wrap at 32 bits) measured at
  // `measured_us`. kOk: the pose is new (or the first positions were noted); kRefused: a wheel
  // cannot have turned so far since the last good positions: the pose stays and the jump is
  // counted. After a jump the next two positions that agree with each other are the new start
  // (a drive that lost its count); what was driven in between is lost. kEmpty: older than the last.
  Status update(std::int32_t left_counts, std::int32_t right_counts, TimeUs measured_us);

  const Pose& pose() const { return pose_; }
  // Sum of the moves of the middle of the axle, forward or backward, in micrometres.
  std::uint64_t travelled_um() const { return travelled_q12_ >> 12; }
  std::uint32_t jumps() const { return jumps_; }

 private:
  struct Sample {
    std::int32_t left = 0;
    std::int32_t right = 0;
    TimeUs measured_us = 0;
  };
  bool possible(const Sample& from, const Sample& to) const;
  void move(const Sample& to);

  std::uint64_t heading_per_count_q44_ = 0;   // binary angle units of right - left
  std::uint64_t distance_per_count_q24_ = 0;  // micrometres of (left + right)
  std::int64_t max_wheel_counts_s_ = 0;

  Pose pose_;
  BinaryAngle start_heading_;
  std::int64_t difference_counts_ = 0;  // right - left since reset
  std::int64_t sum_counts_ = 0;         // left + right since reset
  std::int64_t x_q12_ = 0;              // micrometres
  std::int64_t y_q12_ = 0;
  std::uint64_t travelled_q12_ = 0;
  bool has_last_ = false;
  bool has_candidate_ = false;
  Sample last_;
  Sample candidate_;  // the positions of a jump, not yet believed
  std::uint32_t jumps_ = 0;
};

}  // namespace ivfm
