#include "firmware/localization/robot_mask.h"

#include <algorithm>
#include <cstdlib>

namespace ivfm {

namespace {

// Where a robot may be.
struct Disc {
  Point middle;
  std::int64_t radius_um = 0;

  bool holds(Point p) const {
    const std::int64_t dx = std::int64_t{p.x_um} - middle.x_um;
    const std::int64_t dy = std::int64_t{p.y_um} - middle.y_um;
    return std::max(std::abs(dx), std::abs(dy)) <= radius_um &&
           dx * dx + dy * dy <= radius_um * radius_um;
  }
};

// Its radius is 0 when nobody knows any more.
Disc whereabouts(const RobotMaskConfig& config, const PeerRobot& peer, TimeUs time_us) {
  const TimeUs apart_us = std::max(time_us, peer.told_us) - std::min(time_us, peer.told_us);
  const auto ms = static_cast<std::int64_t>(std::min<TimeUs>(apart_us / 1000, 60'000));
  const std::int64_t driven_um = ms * config.max_speed_um_s / 1000;
  if (driven_um > config.max_driven_um) return {};
  return {peer.position, config.robot_radius_um + config.margin_um + driven_um};
}

void mark(const Disc& disc, const Pose& pose, Scan& scan) {
  for (ScanPoint& beam : std::span(scan.storage).first(scan.size)) {
    if (beam.echo != Echo::kHit) continue;
    const BinaryAngle direction = pose.heading + beam.bearing;
    const std::int32_t range_um = std::int32_t{beam.range_mm} * 1000;
    const Point end{pose.position.x_um + scale_q30(range_um, cos_q30(direction)),
                    pose.position.y_um + scale_q30(range_um, sin_q30(direction))};
    if (disc.holds(end)) beam.echo = Echo::kRobot;
  }
}

}  // namespace

void mark_robots(const RobotMaskConfig& config, std::span<const PeerRobot> peers, const Pose& pose,
                 TimeUs time_us, Scan& scan) {
  for (const PeerRobot& peer : peers) {
    const Disc disc = whereabouts(config, peer, time_us);
    if (disc.radius_um > 0) mark(disc, pose, scan);
  }
}

}  // namespace ivfm
