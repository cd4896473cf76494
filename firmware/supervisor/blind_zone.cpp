#include "firmware/supervisor/blind_zone.h"

#include <cstdlib>

#include "shared/geometry/integer_sqrt.h"

namespace ivfm {
namespace {

// New hits within this much beyond the blind zone are kept: the robot may close in on them before
// the next revolution ends.
constexpr std::int32_t kShellUm = 120'000;
// Points nearer together than this are one.
constexpr std::int64_t kSpacingUm = 15'000;
// A beam that passes a remembered point by this much says that it is gone.
constexpr std::int32_t kPassedMm = 100;
constexpr std::int32_t kSameBearingRaw = 182;  // 1 degree

std::int32_t distance_mm(Point a, Point b) {
  const auto square = static_cast<std::uint64_t>(squared_distance_um2(a, b));
  return static_cast<std::int32_t>(integer_sqrt(square) / 1000);
}

}  // namespace

void BlindZone::update(const Scan& scan, const Pose& pose) {
  std::size_t kept = 0;
  for (const Point point : points()) {
    if (still_hidden(point, scan, pose)) points_[kept++] = point;
  }
  size_ = kept;
  const std::int32_t farthest_mm = (blind_um_ + kShellUm) / 1000;
  for (const ScanPoint& beam : scan.points()) {
    if (!beam.is_in_the_way() || beam.range_mm > farthest_mm) continue;
    const std::int32_t range_um = beam.range_mm * 1000;
    add(transform(pose, scale_q30(range_um, cos_q30(beam.bearing)),
                  scale_q30(range_um, sin_q30(beam.bearing))));
  }
}

bool BlindZone::still_hidden(Point point, const Scan& scan, const Pose& pose) const {
  const std::int32_t range_mm = distance_mm(pose.position, point);
  if (range_mm > blind_um_ / 1000) return false;
  const BinaryAngle bearing = atan2_binary(std::int64_t{point.y_um} - pose.position.y_um,
                                           std::int64_t{point.x_um} - pose.position.x_um) -
                              pose.heading;
  for (const ScanPoint& beam : scan.points()) {
    const bool passes = beam.is_in_the_way() && beam.range_mm > range_mm + kPassedMm;
    if (passes && std::abs((beam.bearing - bearing).signed_raw()) < kSameBearingRaw) return false;
  }
  return true;
}

void BlindZone::add(Point point) {
  for (const Point known : points()) {
    if (squared_distance_um2(known, point) < kSpacingUm * kSpacingUm) return;
  }
  if (size_ < kCapacity) points_[size_++] = point;
}

}  // namespace ivfm
