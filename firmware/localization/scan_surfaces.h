// The surfaces that a scan saw: points at even distances along them, with their normals.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "shared/geometry/pose.h"

namespace ivfm {

// In the robot's frame.
struct SurfaceSample {
  std::int32_t x_um = 0;
  std::int32_t y_um = 0;
  std::int16_t normal_x = 0;  // towards the robot, Q14; both 0 where the surface is not flat
  std::int16_t normal_y = 0;
  std::uint16_t weight_q8 = 0;  // 256 at the robot, less the farther away: lidar noise grows
  std::uint16_t beam = 0;       // index in the scan

  bool is_flat() const { return normal_x != 0 || normal_y != 0; }
};

// Of a beam that hit something, in the robot's frame.
Point end_of(const ScanPoint& beam);

class ScanSurfaces {
 public:
  static constexpr std::size_t kMaxSamples = 192;

  // Takes the hits of a scan (corrected for motion) within `range_um`. Samples lie `spacing_um`
  // apart, so that near walls do not outvote far ones; wider when there would be too many. Where a
  // surface begins there is always one, where it ends rarely: so every other scan is gone through
  // backwards, or the heading would slowly turn with the lidar.
  void take(const Scan& scan, std::int32_t range_um, std::int32_t spacing_um);
  std::span<const SurfaceSample> samples() const { return {samples_.data(), size_}; }

 private:
  bool pick(const Scan& scan, std::int32_t range_um, std::int32_t spacing_um);

  std::array<SurfaceSample, kMaxSamples> samples_{};
  std::size_t size_ = 0;
  bool backwards_ = false;
};

}  // namespace ivfm
