// A recorded drive (MRPT rawlog, or a recording of ours) as data for the report: fused by the
// robot's own code along its odometry.
#pragma once

#include <filesystem>
#include <vector>

#include "host/log_analysis/run_data.h"

namespace ivfm::host {

// Whether `file` is to be read as a recorded drive: by its first line, or by its name.
bool is_recorded_drive(const std::filesystem::path& file);

// The drive as a run of one robot with `recorded` set: its path, map, what it did when, and the
// goals that it would have chosen without a policy. A file that breaks off gives what was before,
// and a warning. Throws std::runtime_error that names the file: missing, damaged, without scans.
RunData load_drive(const std::filesystem::path& file, const LoadProgress& progress = {});

// When it stood, turned on the spot and measured nothing, in the order of time.
std::vector<TimelineEntry> drive_timeline(const RunData& run);

}  // namespace ivfm::host
