#include "firmware/supervisor/obstacle_guard.h"

#include <algorithm>
#include <cstdlib>

#include "shared/geometry/integer_sqrt.h"

namespace ivfm {
namespace {

// Wider arcs count as a straight line: after 1 m the two are 17 mm apart. The limit also keeps the
// squares in travel_on_arc below 2^63 (discs of up to 2 m).
constexpr std::int64_t kStraightRadiusMm = 30'000;
constexpr std::int64_t kNever = INT32_MAX;
// Angles of atan2_binary are up to 2 units off each.
constexpr std::int16_t kAngleErrorRaw = 8;

// A hit in millimetres in the robot's frame, mirrored so that x points where it drives to and the
// turning centre lies on the positive y axis.
struct Hit {
  std::int64_t x;
  std::int64_t y;
  std::int64_t squared_distance() const { return x * x + y * y; }
};

std::int64_t root(std::int64_t square) {
  return integer_sqrt(static_cast<std::uint64_t>(std::max<std::int64_t>(0, square)));
}

std::int64_t travel_on_line(Hit hit, std::int64_t radius) {
  if (std::abs(hit.y) >= radius) return kNever;
  return std::max<std::int64_t>(0, hit.x - root(radius * radius - hit.y * hit.y));
}

// The disc's centre runs on a circle of `turn_radius` around (0, turn_radius). With rho the
// distance of the hit from that centre, they touch where rho^2 + turn^2 - 2 rho turn cos(delta) =
// radius^2 (law of cosines), delta being the angle between disc and hit as seen from the turning
// centre.
std::int64_t travel_on_arc(Hit hit, std::int64_t radius, std::int64_t turn_radius) {
  const std::int64_t x = hit.x, y = turn_radius - hit.y;
  const std::int64_t rho = root(x * x + y * y);
  if (std::abs(rho - turn_radius) >= radius) return kNever;
  const std::int64_t scale = 2 * rho * turn_radius;
  const std::int64_t cosine = rho * rho + turn_radius * turn_radius - radius * radius;
  const BinaryAngle delta = atan2_binary(root(scale * scale - cosine * cosine), cosine);
  const BinaryAngle arc = atan2_binary(x, y) - delta;
  if (hit.x > 0 && arc.signed_raw() < 0 && arc.signed_raw() >= -kAngleErrorRaw) return 0;
  return arc.raw() * turn_radius * 6283 / (65536 * 1000);
}

std::int64_t travel_to(Hit hit, std::int64_t radius, std::int64_t turn_radius) {
  const std::int64_t squared_distance = hit.squared_distance();
  if (squared_distance <= radius * radius) {
    // Blocks within 60 degrees of straight ahead: leaving sideways or backwards stays possible.
    return hit.x > 0 && 4 * hit.x * hit.x >= squared_distance ? 0 : kNever;
  }
  if (turn_radius >= kStraightRadiusMm) {
    return hit.x > 0 ? travel_on_line(hit, radius) : kNever;
  }
  return travel_on_arc(hit, radius, turn_radius);
}

}  // namespace

std::int32_t free_travel_mm(const Obstacles& obstacles, const Pose& pose, const Velocity& motion,
                            std::int32_t radius_mm, std::int32_t horizon_mm) {
  if (motion.v_um_s == 0) return horizon_mm;
  const std::int64_t speed = std::abs(std::int64_t{motion.v_um_s});
  const std::int64_t turn_rate = std::abs(std::int64_t{motion.omega_mrad_s});
  // v / omega: um/s over mrad/s is mm.
  const std::int64_t turn_radius = turn_rate == 0 ? kStraightRadiusMm : speed / turn_rate;
  const int ahead = motion.v_um_s > 0 ? 1 : -1;
  const int turn_side = motion.omega_mrad_s > 0 ? ahead : -ahead;
  const std::int64_t reach = std::int64_t{horizon_mm} + radius_mm;
  std::int64_t nearest = horizon_mm;
  const auto consider = [&](std::int64_t x_mm, std::int64_t y_mm) {
    const Hit hit{x_mm * ahead, y_mm * turn_side};
    if (hit.squared_distance() > reach * reach) return;
    nearest = std::min(nearest, travel_to(hit, radius_mm, turn_radius));
  };

  // T_robot_scan: from the robot's frame at the time of the scan to the one now.
  const Pose scan_in_robot = relative_pose(pose, obstacles.pose_at_scan);
  for (const ScanPoint& point : obstacles.scan.points()) {
    if (!point.is_in_the_way()) continue;
    const BinaryAngle bearing = point.bearing + scan_in_robot.heading;
    consider(scale_q30(point.range_mm, cos_q30(bearing)) + scan_in_robot.position.x_um / 1000,
             scale_q30(point.range_mm, sin_q30(bearing)) + scan_in_robot.position.y_um / 1000);
  }
  for (const Point& point : obstacles.points) {
    const Point seen = relative_pose(pose, {point, BinaryAngle()}).position;
    consider(seen.x_um / 1000, seen.y_um / 1000);
  }
  return static_cast<std::int32_t>(nearest);
}

}  // namespace ivfm
