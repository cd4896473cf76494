#include "firmware/localization/surface_map.h"

#include <algorithm>

namespace ivfm {

namespace {

// Running mean: a step of the difference's `hits`th part.
std::uint16_t moved(std::uint16_t mean, std::int32_t sample, std::int32_t hits) {
  return static_cast<std::uint16_t>(mean + (sample - std::int32_t{mean}) / hits);
}

std::int64_t squared_distance(Cell a, Cell b) {
  const std::int64_t dx = std::int64_t{a.x} - b.x, dy = std::int64_t{a.y} - b.y;
  return dx * dx + dy * dy;
}

}  // namespace

void SurfaceMap::clear() { std::ranges::fill(entries_, Entry{}); }

std::size_t SurfaceMap::slot(Cell c, std::size_t probe) const {
  std::uint32_t hash =
      static_cast<std::uint32_t>(c.x) * 0x9e3779b1u ^ static_cast<std::uint32_t>(c.y) * 0x85ebca77u;
  hash ^= hash >> 15;
  return (hash + probe) & (entries_.size() - 1);
}

SurfaceMap::Mean SurfaceMap::mean(Cell c) const {
  if (entries_.empty()) return {};
  for (std::size_t probe = 0; probe < kProbes; ++probe) {
    const Entry& entry = entries_[slot(c, probe)];
    if (entry.hits != 0 && entry.x == c.x && entry.y == c.y) {
      return {entry.sub_x >> 8, entry.sub_y >> 8};
    }
  }
  return {};
}

SurfaceMap::Entry& SurfaceMap::find_or_replace(Cell c, Cell robot) {
  Entry* replaced = &entries_[slot(c, 0)];
  std::int64_t farthest = -1;
  for (std::size_t probe = 0; probe < kProbes; ++probe) {
    Entry& entry = entries_[slot(c, probe)];
    if (entry.hits != 0 && entry.x == c.x && entry.y == c.y) return entry;
    const std::int64_t distance =
        entry.hits == 0 ? INT64_MAX : squared_distance({entry.x, entry.y}, robot);
    if (distance <= farthest) continue;
    farthest = distance;
    replaced = &entry;
  }
  *replaced = {static_cast<std::int16_t>(c.x), static_cast<std::int16_t>(c.y), 0, 0, 0};
  return *replaced;
}

void SurfaceMap::learn(const ExplorationMap& map, const Pose& pose, const Scan& scan,
                       std::int32_t range_um) {
  if (entries_.empty()) return;
  const GridFrame& frame = map.frame();
  const Cell robot = frame.cell_at(pose.position);
  for (const ScanPoint& point : scan.points()) {
    const std::int32_t reach_um = std::int32_t{point.range_mm} * 1000;
    if (point.echo != Echo::kHit || reach_um > range_um) continue;
    // As in scan fusion, an eighth of a cell behind the end of the beam.
    const std::int32_t length = reach_um + frame.cell_um() / 8;
    const BinaryAngle direction = pose.heading + point.bearing;
    const Point p{pose.position.x_um + scale_q30(length, cos_q30(direction)),
                  pose.position.y_um + scale_q30(length, sin_q30(direction))};
    const Cell c = frame.cell_at(p);
    if (!frame.contains(c) || map.layers().occupancy[frame.index_of(c)] <= 0) continue;
    const auto sub = [&](std::int32_t at_um, std::int32_t cell) {
      const std::int64_t inside = at_um - std::int64_t{cell} * frame.cell_um();
      return static_cast<std::int32_t>((inside << 16) / frame.cell_um());
    };
    Entry& entry = find_or_replace(c, robot);
    if (entry.hits == kMaxHits) continue;
    ++entry.hits;
    entry.sub_x = moved(entry.sub_x, sub(p.x_um, c.x), entry.hits);
    entry.sub_y = moved(entry.sub_y, sub(p.y_um, c.y), entry.hits);
  }
}

}  // namespace ivfm
