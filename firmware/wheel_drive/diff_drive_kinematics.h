// Differential drive: body velocity <-> wheel speeds in encoder counts, in integers, with limits.
#pragma once

#include <cstdint>

#include "shared/geometry/velocity.h"

namespace ivfm {

// The base's dimensions. All > 0; wheel_circumference_um and track_um up to 10 m.
struct WheelGeometry {
  std::int32_t track_um = 160'000;                // between the wheels' contact points
  std::int32_t wheel_circumference_um = 207'345;  // radius 33 mm
  std::int32_t counts_per_turn = 4'096;           // encoder counts a turn of the wheel
  constexpr bool operator==(const WheelGeometry&) const = default;
};

// Speed of each wheel in encoder counts a second; positive rolls the robot forward.
struct WheelSpeeds {
  std::int32_t left = 0;
  std::int32_t right = 0;
  constexpr bool operator==(const WheelSpeeds&) const = default;
};

class DiffDriveKinematics {
 public:
  DiffDriveKinematics() = default;
  // `max_wheel_um_s`: the largest speed of a wheel over the ground, > 0 and at most 10 m/s.
  DiffDriveKinematics(const WheelGeometry& geometry, std::int32_t max_wheel_um_s)
      : geometry_(geometry), max_wheel_um_s_(max_wheel_um_s) {}

  // Wheel speeds of `velocity`. When a wheel would exceed its limit both are scaled down alike, so
  // that the path's curvature stays. |omega| beyond 2^23 mrad/s is cut.
  WheelSpeeds wheel_speeds(const Velocity& velocity) const;
  // The inverse, from measured wheel speeds.
  Velocity body_velocity(const WheelSpeeds& speeds) const;

  const WheelGeometry& geometry() const { return geometry_; }
  std::int32_t max_wheel_um_s() const { return max_wheel_um_s_; }

 private:
  WheelGeometry geometry_;
  std::int32_t max_wheel_um_s_ = 500'000;
};

}  // namespace ivfm
