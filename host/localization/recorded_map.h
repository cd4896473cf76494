// Maps of a recorded drive without truth: how thin are the walls that each way of localization
// paints?
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "host/localization/drive_log.h"
#include "host/log_analysis/map_picture.h"
#include "host/simulator/recording.h"

namespace ivfm::host {

// A recording as a drive of wheels that rolled as its odometry says; truth stays empty.
DriveLog to_drive_log(const Recording& recording);

// What the robot's own fusion paints at the poses that an estimator told.
struct RecordedMap {
  std::string estimator;
  std::size_t obstacle_cells = 0, known_cells = 0;
  double cpu_s = 0;
  PictureLayers layers;  // no visits; obstacles and the frame
  Trajectory way;
};

// `estimator`: as make_estimator(). Throws as that.
RecordedMap map_of(const DriveLog& log, const std::string& estimator);

// The maps side by side.
void write_maps(const std::filesystem::path& path, const std::vector<RecordedMap>& maps);

}  // namespace ivfm::host
