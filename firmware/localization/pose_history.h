// The last second of poses, and scans corrected for the robot's motion during their sweep.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "firmware/hal/clock.h"
#include "firmware/lidar/scan.h"
#include "shared/geometry/pose.h"

namespace ivfm {

class PoseHistory {
 public:
  static constexpr std::size_t kMaxPoses = 64;

  void clear() { size_ = 0; }
  // Times must not go back; an older one is ignored.
  void add(TimeUs time_us, const Pose& pose);
  bool empty() const { return size_ == 0; }
  // The pose at `time_us`, interpolated; the oldest or newest known one beyond the ends. Requires
  // !empty().
  Pose at(TimeUs time_us) const;

 private:
  struct Entry {
    TimeUs time_us = 0;
    Pose pose;
  };
  const Entry& entry(std::size_t age) const {  // 0 is the newest
    return entries_[(next_ + kMaxPoses - 1 - age) % kMaxPoses];
  }

  std::array<Entry, kMaxPoses> entries_{};
  std::size_t next_ = 0;
  std::size_t size_ = 0;
};

// `scan` as if all its beams had been measured at once from the robot's pose at `end_us`. Its
// points are taken to be spread evenly over [start_us, end_us]. Bearings and ranges change with the
// motion in between; a beam that leaves the range of uint16 millimetres becomes Echo::kNothing.
void deskew(const Scan& scan, TimeUs start_us, TimeUs end_us, const PoseHistory& history,
            Scan& out);

}  // namespace ivfm
