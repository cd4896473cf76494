// Writes down what a simulated lidar measured, revolution by revolution, as a recording.
#pragma once

#include <filesystem>
#include <span>

#include "firmware/lidar/scan.h"
#include "host/simulator/recording.h"
#include "host/simulator/robot_body.h"

namespace ivfm::host {

class ScanRecorder {
 public:
  static constexpr std::size_t kRays = 360;  // a recorded ray a degree

  explicit ScanRecorder(std::string source) { recording_.source = std::move(source); }

  // Some beams in the order they were measured (clockwise, so that bearings fall), from where the
  // lidar is now. `now_us` is the time of the last one.
  void take(TimeUs now_us, const TruePose& lidar_pose, std::span<const ScanPoint> beams);

  // The revolutions that are complete; at most as many as a recording may have.
  const Recording& recording() const { return recording_; }

 private:
  Recording recording_;
  RecordedScan scan_;
  TimeUs begin_us_ = 0;  // of the first scan
  bool whole_ = false;   // scan_ began with its first beam
  BinaryAngle last_;
};

}  // namespace ivfm::host
