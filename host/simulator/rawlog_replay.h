// Reads laser scans and odometry from an MRPT rawlog.
#pragma once

#include <cstdint>
#include <filesystem>

#include "host/simulator/recording.h"

namespace ivfm::host {

// Every 2D range scan of the rawlog with the odometry up to it. Both of MRPT's layouts are read:
// actions and sensory frames, and lists of observations with odometry. The pose is the lidar's (the
// robot's, by odometry alone, and the sensor's place on it), beginning at the first scan's.
// `max_range_mm`: farther readings become no measurement, as an RPLIDAR A1 would say it.
// A file that breaks off gives the scans before, and a warning in the recording.
// Throws std::runtime_error that names the file: missing, not a rawlog, damaged, or
// without range scans.
Recording load_rawlog(const std::filesystem::path& path, std::uint16_t max_range_mm = 12000);

}  // namespace ivfm::host
