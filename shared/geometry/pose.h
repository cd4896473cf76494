// Positions and poses in the map frame (REP 105), in integers.
#pragma once

#include <cstdint>

#include "shared/geometry/binary_angle.h"

namespace ivfm {

// A point in micrometres. int32 reaches 2.1 km from the map's origin.
struct Point {
  std::int32_t x_um = 0;
  std::int32_t y_um = 0;
  constexpr bool operator==(const Point&) const = default;
};

// Where a robot is: position of the middle of its axle and heading (0 = +x, counter-clockwise).
struct Pose {
  Point position;
  BinaryAngle heading;
  constexpr bool operator==(const Pose&) const = default;
};

// The point `forward_um` ahead and `left_um` to the left of `pose` (T_map_robot applied).
constexpr Point transform(const Pose& pose, std::int32_t forward_um, std::int32_t left_um) {
  const std::int32_t c = cos_q30(pose.heading), s = sin_q30(pose.heading);
  return {pose.position.x_um + scale_q30(forward_um, c) - scale_q30(left_um, s),
          pose.position.y_um + scale_q30(forward_um, s) + scale_q30(left_um, c)};
}

// T_a_b * T_b_c.
constexpr Pose compose(const Pose& ab, const Pose& bc) {
  return {transform(ab, bc.position.x_um, bc.position.y_um), ab.heading + bc.heading};
}

// T_a_b out of T_m_a and T_m_b: the pose `of` as seen from `from`.
constexpr Pose relative_pose(const Pose& from, const Pose& of) {
  const std::int32_t dx = of.position.x_um - from.position.x_um;
  const std::int32_t dy = of.position.y_um - from.position.y_um;
  return {transform(Pose{{0, 0}, -from.heading}, dx, dy), of.heading - from.heading};
}

constexpr std::int64_t squared_distance_um2(Point a, Point b) {
  const std::int64_t dx = std::int64_t{a.x_um} - b.x_um, dy = std::int64_t{a.y_um} - b.y_um;
  return dx * dx + dy * dy;
}

// Nearer together than `um`, and turned by less than `turn` (binary angle units).
constexpr bool is_near(const Pose& a, const Pose& b, std::int64_t um, std::int32_t turn) {
  const std::int32_t apart = (a.heading - b.heading).signed_raw();
  return squared_distance_um2(a.position, b.position) < um * um && apart < turn && -apart < turn;
}

}  // namespace ivfm
