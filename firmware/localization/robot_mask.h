// Tells the beams that end on other robots of the team from those that end on the map's obstacles.
#pragma once

#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "firmware/link/peer_robot.h"
#include "shared/geometry/pose.h"

namespace ivfm {

struct RobotMaskConfig {
  std::int32_t robot_radius_um = 105'000;
  std::int32_t margin_um = 150'000;       // by which both robots' poses together may be wrong
  std::int32_t max_speed_um_s = 220'000;  // it may have driven so fast since it told its place
  std::int32_t max_driven_um = 440'000;   // a place that may be off farther says too little
};

// Makes Echo::kRobot of the hits of `scan`, taken at `pose` at `time_us`, where one of `peers` may
// be.
void mark_robots(const RobotMaskConfig& config, std::span<const PeerRobot> peers, const Pose& pose,
                 TimeUs time_us, Scan& scan);

}  // namespace ivfm
