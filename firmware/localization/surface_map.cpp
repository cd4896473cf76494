#include "firmware/localization/surface_map.h"

#include <algorithm>

namespace ivfm {

namespace {

constexpr std::int32_t kSub = 8192;

std::int64_t squared_distance(Cell a, Cell b) {
  const std::int64_t dx = std::int64_t{a.x} - b.x, dy = std::int64_t{a.y} - b.y;
  return dx * dx + dy * dy;
}

// At most a right angle apart, in 256ths of a turn.
bool faces_alike(std::uint8_t a, std::uint8_t b) {
  const auto apart = static_cast<std::uint8_t>(a - b);
  return apart <= 64 || apart >= 192;
}

// The nearer to a hit of the samples before and after it, in the order of the beams.
const SurfaceSample& nearer(const SurfaceSample& before, const SurfaceSample& after, Point hit) {
  const auto far = [hit](const SurfaceSample& s) {
    return squared_distance_um2(hit, {s.x_um, s.y_um});
  };
  return far(after) < far(before) ? after : before;
}

// Running mean.
void move_mean(std::int16_t& mean, std::int32_t sample, std::int32_t weight, std::int32_t total) {
  mean = static_cast<std::int16_t>(mean + (sample - mean) * weight / total);
}

// Near hits are worth more: the lidar's noise grows with the range.
std::int32_t weight_of(std::int32_t range_mm) {
  const std::int32_t decimetres = range_mm / 100;
  return std::max<std::int32_t>(1, 8 * 400 / (400 + decimetres * decimetres));
}

}  // namespace

void SurfaceMap::clear() { std::ranges::fill(entries_, Entry{}); }

std::size_t SurfaceMap::slot(Cell c, std::size_t probe) const {
  std::uint32_t hash =
      static_cast<std::uint32_t>(c.x) * 0x9e3779b1u ^ static_cast<std::uint32_t>(c.y) * 0x85ebca77u;
  hash ^= hash >> 15;
  return (hash + probe) & (entries_.size() - 1);
}

const SurfaceMap::Entry* SurfaceMap::find(Cell c) const {
  for (std::size_t probe = 0; probe < kProbes; ++probe) {
    const Entry& entry = entries_[slot(c, probe)];
    if (entry.weight != 0 && entry.x == c.x && entry.y == c.y) return &entry;
  }
  return nullptr;
}

SurfaceMap::Entry& SurfaceMap::find_or_replace(Cell c, Cell robot) {
  Entry* replaced = &entries_[slot(c, 0)];
  std::int64_t farthest = -1;
  for (std::size_t probe = 0; probe < kProbes; ++probe) {
    Entry& entry = entries_[slot(c, probe)];
    if (entry.weight != 0 && entry.x == c.x && entry.y == c.y) return entry;
    const std::int64_t distance =
        entry.weight == 0 ? INT64_MAX : squared_distance({entry.x, entry.y}, robot);
    if (distance <= farthest) continue;
    farthest = distance;
    replaced = &entry;
  }
  *replaced = {static_cast<std::int16_t>(c.x), static_cast<std::int16_t>(c.y), 0, 0, 0, 0};
  return *replaced;
}

void SurfaceMap::learn(const ExplorationMap& map, const Pose& pose, const Scan& scan,
                       const ScanSurfaces& surfaces, std::int32_t range_um) {
  if (entries_.empty()) return;
  const GridFrame& frame = map.frame();
  const Cell robot = frame.cell_at(pose.position);
  const auto samples = surfaces.samples();
  std::size_t after = 0;  // the first sample behind a beam
  for (std::size_t i = 0; i < scan.size; ++i) {
    const ScanPoint& point = scan.storage[i];
    while (after < samples.size() && samples[after].beam <= i) ++after;
    const std::int32_t reach_um = std::int32_t{point.range_mm} * 1000;
    if (point.echo != Echo::kHit || reach_um > range_um || after == 0) continue;
    // A hit faces as the nearest sample does.
    const SurfaceSample& sample =
        nearer(samples[after - 1], samples[std::min(after, samples.size() - 1)], end_of(point));
    if (!sample.is_flat()) continue;
    const auto facing = static_cast<std::uint8_t>(
        (pose.heading + atan2_binary(sample.normal_y, sample.normal_x)).raw() >> 8);
    const BinaryAngle direction = pose.heading + point.bearing;
    const std::int32_t c = cos_q30(direction), s = sin_q30(direction);
    const Point p{pose.position.x_um + scale_q30(reach_um, c),
                  pose.position.y_um + scale_q30(reach_um, s)};
    // The cell that scan fusion paints: an eighth of a cell behind the end of the beam.
    const std::int32_t behind = frame.cell_um() / 8;
    const Cell cell = frame.cell_at({p.x_um + scale_q30(behind, c), p.y_um + scale_q30(behind, s)});
    if (!frame.contains(cell) || map.layers().occupancy[frame.index_of(cell)] < 0) continue;
    const auto sub = [&](std::int32_t at_um, std::int32_t of) {
      const std::int64_t inside = at_um - std::int64_t{of} * frame.cell_um();
      return static_cast<std::int32_t>(inside * kSub / frame.cell_um());
    };
    Entry& entry = find_or_replace(cell, robot);
    const std::int32_t weight = weight_of(point.range_mm);
    if (entry.weight == 0) entry.facing = facing;
    if (entry.weight + weight > kMaxWeight || !faces_alike(entry.facing, facing)) continue;
    entry.weight = static_cast<std::uint8_t>(entry.weight + weight);
    move_mean(entry.sub_x, sub(p.x_um, cell.x), weight, entry.weight);
    move_mean(entry.sub_y, sub(p.y_um, cell.y), weight, entry.weight);
  }
}

SurfaceMap::Distance SurfaceMap::distance(const ExplorationMap& map, Point p, std::int32_t normal_x,
                                          std::int32_t normal_y, std::uint8_t facing) const {
  const GridFrame& frame = map.frame();
  const Cell middle = frame.cell_at(p);
  const std::int32_t cell_um = frame.cell_um();
  if (!frame.contains({middle.x - 1, middle.y - 1}) ||
      !frame.contains({middle.x + 1, middle.y + 1})) {
    return {};
  }
  std::int64_t sum = 0;
  std::int32_t weights = 0;
  bool obstacle = false;
  for (std::int32_t y = middle.y - 1; y <= middle.y + 1; ++y) {
    const std::int8_t* row = &map.layers().occupancy[frame.index_of({middle.x - 1, y})];
    for (std::int32_t x = middle.x - 1; x <= middle.x + 1; ++x) {
      const std::int8_t occupied = *row++;
      if (occupied < 0) continue;
      obstacle = obstacle || occupied > 0;
      const Entry* entry = find({x, y});
      if (entry == nullptr || !faces_alike(entry->facing, facing)) continue;
      const auto position = [&](std::int32_t cell, std::int32_t sub) {
        return static_cast<std::int32_t>(cell * cell_um + std::int64_t{sub} * cell_um / kSub);
      };
      const std::int64_t dx = position(x, entry->sub_x) - p.x_um;
      const std::int64_t dy = position(y, entry->sub_y) - p.y_um;
      sum += ((dx * normal_x + dy * normal_y) >> 14) * entry->weight;
      weights += entry->weight;
    }
  }
  if (weights == 0) return {0, 0, obstacle};
  return {static_cast<std::int32_t>(sum / weights), weights, obstacle};
}

}  // namespace ivfm
