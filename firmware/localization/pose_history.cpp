#include "firmware/localization/pose_history.h"

#include "shared/geometry/integer_sqrt.h"

namespace ivfm {

namespace {

Pose interpolate(const Pose& a, const Pose& b, std::int64_t part_q16) {
  const auto between = [&](std::int32_t from, std::int32_t to) {
    return static_cast<std::int32_t>(from + (((std::int64_t{to} - from) * part_q16) >> 16));
  };
  const std::int64_t turn = (b.heading - a.heading).signed_raw();
  const auto raw = static_cast<std::uint16_t>(
      static_cast<std::uint64_t>(std::int64_t{a.heading.raw()} + ((turn * part_q16) >> 16)) &
      0xffffu);
  return {{between(a.position.x_um, b.position.x_um), between(a.position.y_um, b.position.y_um)},
          BinaryAngle(raw)};
}

// `point`, measured from `from`, as it looks from `to`.
ScanPoint seen_from(const ScanPoint& point, const Pose& from, const Pose& to) {
  ScanPoint moved = point;
  moved.bearing = point.bearing + from.heading - to.heading;
  if (point.echo == Echo::kNothing || from.position == to.position) return moved;
  const BinaryAngle direction = from.heading + point.bearing;
  const std::int32_t range_um = std::int32_t{point.range_mm} * 1000;
  const std::int64_t dx =
      std::int64_t{from.position.x_um} - to.position.x_um + scale_q30(range_um, cos_q30(direction));
  const std::int64_t dy =
      std::int64_t{from.position.y_um} - to.position.y_um + scale_q30(range_um, sin_q30(direction));
  const std::uint32_t range = integer_sqrt(static_cast<std::uint64_t>(dx * dx + dy * dy));
  const std::uint32_t range_mm = (range + 500) / 1000;
  if (range_mm > 0xffff) return {moved.bearing, 0, Echo::kNothing, 0};
  moved.bearing = atan2_binary(dy, dx) - to.heading;
  moved.range_mm = static_cast<std::uint16_t>(range_mm);
  return moved;
}

}  // namespace

void PoseHistory::add(TimeUs time_us, const Pose& pose) {
  if (!empty() && time_us < entry(0).time_us) return;
  entries_[next_] = {time_us, pose};
  next_ = (next_ + 1) % kMaxPoses;
  if (size_ < kMaxPoses) ++size_;
}

Pose PoseHistory::at(TimeUs time_us) const {
  if (time_us >= entry(0).time_us) return entry(0).pose;
  for (std::size_t age = 1; age < size_; ++age) {
    const Entry& before = entry(age);
    if (before.time_us > time_us) continue;
    const Entry& after = entry(age - 1);
    const std::uint64_t span = after.time_us - before.time_us;
    if (span == 0) return after.pose;
    return interpolate(before.pose, after.pose,
                       static_cast<std::int64_t>(((time_us - before.time_us) << 16) / span));
  }
  return entry(size_ - 1).pose;
}

void deskew(const Scan& scan, TimeUs start_us, TimeUs end_us, const PoseHistory& history,
            Scan& out) {
  out.clear();
  const Pose end = history.at(end_us);
  const std::uint64_t last = scan.size > 1 ? scan.size - 1 : 1;
  for (std::size_t i = 0; i < scan.size; ++i) {
    const TimeUs time_us = start_us + (end_us - start_us) * i / last;
    (void)out.push(seen_from(scan.storage[i], history.at(time_us), end));
  }
}

}  // namespace ivfm
