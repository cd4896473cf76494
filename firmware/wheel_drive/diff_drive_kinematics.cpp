#include "firmware/wheel_drive/diff_drive_kinematics.h"

#include <algorithm>
#include <limits>

namespace ivfm {
namespace {

constexpr std::int32_t kMaxOmegaMradS = 1 << 23;  // keeps every product below 2^63

// a / b rounded to nearest, halves away from zero; b > 0.
constexpr std::int64_t divide_rounded(std::int64_t a, std::int64_t b) {
  return a >= 0 ? (a + b / 2) / b : -((-a + b / 2) / b);
}

constexpr std::int32_t saturate(std::int64_t value) {
  return static_cast<std::int32_t>(std::clamp<std::int64_t>(
      value, std::numeric_limits<std::int32_t>::min(), std::numeric_limits<std::int32_t>::max()));
}

}  // namespace

WheelSpeeds DiffDriveKinematics::wheel_speeds(const Velocity& velocity) const {
  // Each wheel's share of the turn: omega * track / 2.
  const std::int64_t omega = std::clamp(velocity.omega_mrad_s, -kMaxOmegaMradS, kMaxOmegaMradS);
  const std::int64_t turn_um_s = divide_rounded(omega * geometry_.track_um, 2000);
  std::int64_t left = velocity.v_um_s - turn_um_s;
  std::int64_t right = velocity.v_um_s + turn_um_s;
  const std::int64_t fastest = std::max(left < 0 ? -left : left, right < 0 ? -right : right);
  if (fastest > max_wheel_um_s_) {
    left = left * max_wheel_um_s_ / fastest;
    right = right * max_wheel_um_s_ / fastest;
  }
  const std::int64_t turn_um = geometry_.wheel_circumference_um;
  return {saturate(divide_rounded(left * geometry_.counts_per_turn, turn_um)),
          saturate(divide_rounded(right * geometry_.counts_per_turn, turn_um))};
}

Velocity DiffDriveKinematics::body_velocity(const WheelSpeeds& speeds) const {
  const std::int64_t turn_um = geometry_.wheel_circumference_um;
  const std::int64_t left = divide_rounded(speeds.left * turn_um, geometry_.counts_per_turn);
  const std::int64_t right = divide_rounded(speeds.right * turn_um, geometry_.counts_per_turn);
  const std::int64_t omega = divide_rounded((right - left) * 1000, geometry_.track_um);
  return {saturate((left + right) / 2), saturate(omega)};
}

}  // namespace ivfm
