// A run as an MP4 film: the map grows, the robots drive.
#pragma once

#include <filesystem>

#include "host/log_analysis/run_data.h"

namespace ivfm::host {

struct VideoOptions {
  double length_s = 20;  // of the film, whatever the run's
  int frames_per_s = 25;
  int width_px = 1280;  // at most; the height follows from the map
};

// `progress` is called with the number of finished frames of length_s * frames_per_s. Throws
// std::runtime_error with one sentence when the run holds no map or the file cannot be written.
// Answers what of a damaged database could not be read.
Warnings write_run_video(const std::filesystem::path& database, const std::filesystem::path& mp4,
                         const VideoOptions& options, const LoadProgress& progress = {});

}  // namespace ivfm::host
