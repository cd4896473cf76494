// How far the robot can go on along its present motion before it touches what the lidar saw.
#pragma once

#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "shared/geometry/pose.h"
#include "shared/geometry/velocity.h"

namespace ivfm {

// What has to be kept clear of, both in the frame of the poses.
struct Obstacles {
  const Scan& scan;
  Pose pose_at_scan;
  std::span<const Point> points;  // further ones
};

// Free travel, in millimetres along the arc or line that `motion` drives from `pose`, of a disc of
// `radius_mm` (1 .. 2000) until it touches an obstacle. Bounded by `horizon_mm`; 0 when one already
// lies inside the disc, within 60 degrees of where it drives to. Turning on the spot touches
// nothing: `horizon_mm`.
std::int32_t free_travel_mm(const Obstacles& obstacles, const Pose& pose, const Velocity& motion,
                            std::int32_t radius_mm, std::int32_t horizon_mm);

}  // namespace ivfm
