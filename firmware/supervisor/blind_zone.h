// Remembers the obstacles that have come too near for the lidar to see them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "shared/geometry/pose.h"

namespace ivfm {

// An RPLIDAR A1 measures nothing nearer than 0.15 m, which is further than the rim of a small
// robot: without a memory it would forget a wall just before it touches it.
class BlindZone {
 public:
  static constexpr std::size_t kCapacity = 128;

  // `blind_um`: the lidar's shortest range with a margin for its noise; at most 1 m.
  explicit BlindZone(std::int32_t blind_um) : blind_um_(blind_um) {}

  // Takes over what `scan`, taken at `pose`, saw near the robot; keeps what is too near to be seen,
  // unless a beam now passes well through it. When full, further points are dropped.
  void update(const Scan& scan, const Pose& pose);
  void clear() { size_ = 0; }
  // The frame of the poses has moved by `moved` (T_new_old).
  void re_express(const Pose& moved) {
    for (Point& point : std::span(points_).first(size_)) {
      point = transform(moved, point.x_um, point.y_um);
    }
  }

  // In the frame of the poses.
  std::span<const Point> points() const { return {points_.data(), size_}; }

 private:
  bool still_hidden(Point point, const Scan& scan, const Pose& pose) const;
  void add(Point point);

  std::int32_t blind_um_;
  std::array<Point, kCapacity> points_{};
  std::size_t size_ = 0;
};

}  // namespace ivfm
