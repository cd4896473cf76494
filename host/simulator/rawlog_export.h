// MRPT rawlogs of what this project recorded, for RawLogViewer and the MRPT tools.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "host/simulator/recording.h"

namespace ivfm::host {

struct TimedPose {
  double unix_s = 0;
  std::string label;  // of the sensor: "robot 1"
  Pose pose;
};

// A gzip-compressed rawlog of CObservationOdometry entries, in the order given. Throws
// std::runtime_error when it cannot be written. `progress` is called with the number that is
// written.
void write_pose_rawlog(const std::filesystem::path& path, const std::vector<TimedPose>& poses,
                       const std::function<void(std::size_t)>& progress = {});

// A recorded drive as CObservationOdometry and CObservation2DRangeScan entries, beginning at
// `start_unix_s`. Throws as above.
void write_scan_rawlog(const std::filesystem::path& path, const Recording& recording,
                       double start_unix_s);

}  // namespace ivfm::host
