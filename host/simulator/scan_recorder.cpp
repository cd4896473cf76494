#include "host/simulator/scan_recorder.h"

#include <cmath>
#include <utility>

namespace ivfm::host {
namespace {

constexpr std::uint32_t kTurn = 65'536;
constexpr std::uint16_t kStep = kTurn / ScanRecorder::kRays;
constexpr std::size_t kMostScans = 200'000;  // ten hours

// The recorded ray nearest to a bearing.
std::size_t ray_of(BinaryAngle bearing) {
  return (std::uint32_t{bearing.raw()} + kStep / 2) / kStep % ScanRecorder::kRays;
}

Pose to_pose(const TruePose& pose) {
  return {{static_cast<std::int32_t>(std::lround(pose.x_m * 1e6)),
           static_cast<std::int32_t>(std::lround(pose.y_m * 1e6))},
          BinaryAngle::from_radians(std::remainder(pose.heading_rad, 2 * M_PI))};
}

}  // namespace

void ScanRecorder::take(TimeUs now_us, const TruePose& lidar_pose,
                        std::span<const ScanPoint> beams) {
  for (const ScanPoint& beam : beams) {
    if (beam.bearing.raw() > last_.raw() || scan_.ranges_mm.empty()) {  // past zero: a new turn
      if (whole_ && recording_.scans.size() < kMostScans) {
        if (recording_.scans.empty()) begin_us_ = scan_.time_us;
        scan_.time_us -= begin_us_;
        recording_.scans.push_back(std::move(scan_));
      }
      whole_ = !scan_.ranges_mm.empty() || !recording_.scans.empty();
      scan_ = {};
      scan_.aperture = static_cast<std::uint16_t>(kStep * (kRays - 1));
      scan_.ranges_mm.assign(kRays, 0);
    }
    last_ = beam.bearing;
    scan_.time_us = now_us;
    scan_.lidar_pose = to_pose(lidar_pose);
    if (beam.echo == Echo::kHit) scan_.ranges_mm[ray_of(beam.bearing)] = beam.range_mm;
  }
}

}  // namespace ivfm::host
