// Drives the whole agent through a world, in process and in simulated time, and records the drive.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "host/environment/world.h"
#include "host/localization/drive_log.h"

namespace ivfm::host {

struct DriveRequest {
  std::string world = "corridor";  // corridor or malaga
  std::uint64_t seed = 1;          // the map frame: walls lie at other angles in each
  double metres = 100;             // until so far was driven, or nothing is left to explore
  bool second_robot = false;       // of a team in the same map frame: starts facing the other way
};

// An exact drive: odometry and lidar without noise, the agent explores by odometry. `seed` turns
// and shifts the map frame against the world. Throws std::invalid_argument for an unknown world.
DriveLog record_drive(const DriveRequest& request);

}  // namespace ivfm::host
