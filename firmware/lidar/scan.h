// One revolution of a planar lidar, as the core passes it on.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/geometry/binary_angle.h"

namespace ivfm {

// What a beam said.
enum class Echo : std::uint8_t {
  kHit,      // an obstacle at `range_mm`
  kClear,    // certainly nothing up to `range_mm` (simulated sensors of limited range, cameras)
  kNothing,  // no measurement; says nothing about the world
  kRobot,    // another robot of the team at `range_mm`: in the way now, but no part of the map
};

// A beam in the robot's frame: bearing counter-clockwise from straight ahead.
struct ScanPoint {
  BinaryAngle bearing;
  std::uint16_t range_mm = 0;
  Echo echo = Echo::kNothing;
  std::uint8_t quality = 0;  // as the sensor reports it, 0 .. 63
  // Something is there now.
  constexpr bool is_in_the_way() const { return echo == Echo::kHit || echo == Echo::kRobot; }
  constexpr bool operator==(const ScanPoint&) const = default;
};

// A full revolution (or a camera's fan) in order of measurement. Fixed memory: 8,000 samples/s at
// 5.5 Hz is 1,455 points; what is beyond kMaxPoints is counted by the producer and dropped.
struct Scan {
  static constexpr std::size_t kMaxPoints = 1536;
  std::array<ScanPoint, kMaxPoints> storage;
  std::size_t size = 0;

  std::span<const ScanPoint> points() const { return {storage.data(), size}; }
  void clear() { size = 0; }
  // False, and nothing stored, when the scan is full.
  bool push(const ScanPoint& point) {
    if (size == kMaxPoints) return false;
    storage[size++] = point;
    return true;
  }
};

}  // namespace ivfm
