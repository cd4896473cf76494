// How far the robot can go on along its present motion before it touches what the lidar saw.
#pragma once

#include <cstdint>

#include "firmware/lidar/scan.h"
#include "shared/geometry/pose.h"
#include "shared/geometry/velocity.h"

namespace ivfm {

// Free travel, in millimetres along the arc or line that `motion` drives, of a disc of `radius_mm`
// (1 .. 2000) until it touches a hit of `scan`. Bounded by `horizon_mm`; 0 when a hit already lies
// inside the disc, within 60 degrees of where it drives to. `robot_in_scan`: the robot's pose now
// in the frame of the robot at the time of the scan. Turning on the spot touches nothing:
// `horizon_mm`.
std::int32_t free_travel_mm(const Scan& scan, const Pose& robot_in_scan, const Velocity& motion,
                            std::int32_t radius_mm, std::int32_t horizon_mm);

// The pose of `of` seen from `from`, both in the same frame (T_from_of).
Pose relative_pose(const Pose& from, const Pose& of);

}  // namespace ivfm
