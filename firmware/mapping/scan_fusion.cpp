#include "firmware/mapping/scan_fusion.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "firmware/mapping/visit_value.h"

namespace ivfm {

namespace {

constexpr std::uint16_t kUnset = 0xffff;
constexpr int kUnitShift = 10;  // 1 unit = 1,024 um

std::uint16_t to_units(std::uint16_t range_mm) {
  return static_cast<std::uint16_t>((std::uint32_t{range_mm} * 1000u) >> kUnitShift);
}

// The smallest rectangle of cells that holds the footprint seen from `pose`.
CellRect footprint_box(const VisitFootprint& f, const GridFrame& frame, const Pose& pose) {
  const Cell robot = frame.cell_at(pose.position);
  if (f.kind == VisitFootprint::Kind::kSector) {
    return CellRect{robot.x, robot.y, 1, 1}.grown(f.far_um / frame.cell_um() + 1);
  }
  CellRect box{};
  for (const std::int32_t ahead : {f.near_um, f.far_um}) {
    const auto half =
        static_cast<std::int32_t>((std::int64_t{f.slope_q16} * ahead) >> 16) + f.offset_um;
    box = box.united(frame.cell_at(transform(pose, ahead, half)));
    box = box.united(frame.cell_at(transform(pose, ahead, -half)));
  }
  return box.grown(1);
}

}  // namespace

void VisibilityProfile::build(const Scan& scan, std::uint16_t max_gap) {
  range_.fill(kUnset);
  hit_.fill(0);
  for (const ScanPoint& point : scan.points()) {
    const std::size_t bin = point.bearing.raw() >> 6;
    const std::uint16_t units = point.echo == Echo::kNothing ? 0 : to_units(point.range_mm);
    // A measured beam beats one that measured nothing; the nearer of two measured ones wins.
    const bool better =
        range_[bin] == kUnset || range_[bin] == 0 || (units != 0 && units < range_[bin]);
    if (!better) continue;
    range_[bin] = units;
    hit_[bin] = point.echo == Echo::kHit;
  }
  fill_gaps(max_gap);
}

// Goes once around, from one bin with a beam to the next; in the middle of a gap the lower bin is
// the nearer one.
void VisibilityProfile::fill_gaps(std::uint16_t max_gap) {
  const std::size_t reach = std::max<std::size_t>(1, (max_gap >> 6) / 2 + 1);
  const auto* const first_set = std::ranges::find_if(range_, [](auto r) { return r != kUnset; });
  if (first_set == range_.end()) return range_.fill(0);
  const auto take_over = [this](std::size_t from, std::size_t to) {
    range_[to % kBins] = range_[from % kBins];
    hit_[to % kBins] = hit_[from % kBins];
  };
  const auto first = static_cast<std::size_t>(first_set - range_.begin());
  for (std::size_t low = first, high = low + 1; low < first + kBins; low = high++) {
    while (range_[high % kBins] == kUnset) ++high;
    const std::size_t gap = high - low - 1;
    const std::size_t last_of_low = low + std::min(reach, (gap + 1) / 2);
    const std::size_t first_of_high = high - std::min(reach, gap / 2);
    for (std::size_t i = low + 1; i <= last_of_low; ++i) take_over(low, i);
    for (std::size_t i = last_of_low + 1; i < first_of_high; ++i) range_[i % kBins] = 0;
    for (std::size_t i = first_of_high; i < high; ++i) take_over(high, i);
  }
}

void ScanFusion::begin_action(ExplorationMap& map) {
  map.clear_flag(action_rect_, cell_flag::kSeenThisAction);
  action_rect_ = {};
}

ViewStatistics ScanFusion::fuse(ExplorationMap& map, const Pose& pose, const Scan& scan,
                                bool count_visits) {
  update_occupancy(map, pose, scan);
  if (!count_visits) return {};
  profile_.build(scan, config_.max_beam_gap);
  return update_visits(map, pose);
}

void ScanFusion::update_occupancy(ExplorationMap& map, const Pose& pose, const Scan& scan) {
  const GridFrame& frame = map.frame();
  const Cell robot = frame.cell_at(pose.position);
  struct BeamEnd {
    Cell cell;
    Echo echo;  // kClear beyond the mapping range
  };
  // A surface's cell is an eighth of a cell behind it.
  const auto end_of = [&](const ScanPoint& point) {
    const std::int32_t range_um = std::int32_t{point.range_mm} * 1000;
    const bool surface = point.is_in_the_way() && range_um <= config_.mapping_range_um;
    const std::int32_t reach = std::min(range_um, config_.mapping_range_um);
    const BinaryAngle direction = pose.heading + point.bearing;
    const std::int32_t length = surface ? reach + frame.cell_um() / 8 : reach;
    const Cell cell = frame.cell_at({pose.position.x_um + scale_q30(length, cos_q30(direction)),
                                     pose.position.y_um + scale_q30(length, sin_q30(direction))});
    return BeamEnd{cell, surface ? point.echo : Echo::kClear};
  };
  CellRect hits{};
  map.forget_robots();
  for (const ScanPoint& point : scan.points()) {
    if (!point.is_in_the_way()) continue;
    const auto [end, echo] = end_of(point);
    if (echo == Echo::kRobot) map.put_robot(end);
    if (echo != Echo::kHit) continue;
    map.set_flag(end, cell_flag::kHitThisScan);
    if (config_.doubt_changes && map.is_surely_free(end)) map.set_flag(end, cell_flag::kDoubted);
    hits = hits.united(end);
  }
  // Neighbouring clear beams of a camera often end in the same cell: one line for all of them.
  Cell clear_end;
  int clear_beams = 0;
  const auto fuse_clear_beams = [&] {
    if (clear_beams > 0) map.add_misses_on_line(robot, clear_end, std::exchange(clear_beams, 0));
  };
  for (const ScanPoint& point : scan.points()) {
    if (point.echo == Echo::kNothing) continue;
    const auto [end, echo] = end_of(point);
    if (echo != Echo::kHit) {
      if (!(end == clear_end)) fuse_clear_beams();
      clear_end = end;
      ++clear_beams;
      continue;
    }
    fuse_clear_beams();
    map.add_misses_on_line(robot, end, 1);
    if (map.is_doubted(end)) {
      map.doubt(end);
    } else {
      map.add_evidence(end, occupancy::kHit);
    }
  }
  fuse_clear_beams();
  map.clear_flag(hits, cell_flag::kHitThisScan | cell_flag::kDoubted);
}

// Whether the floor at (ahead, left), both in um in the robot's frame, lies in the footprint and in
// sight.
bool ScanFusion::sees(std::int32_t ahead, std::int32_t left, std::int32_t surface_units) const {
  const VisitFootprint& f = config_.footprint;
  const bool trapezoid = f.kind == VisitFootprint::Kind::kTrapezoid;
  if (trapezoid) {
    if (ahead < f.near_um || ahead > f.far_um) return false;
    const std::int64_t half = ((std::int64_t{f.slope_q16} * ahead) >> 16) + f.offset_um;
    if (left > half || left < -half) return false;
  }
  const std::int32_t ahead_units = ahead >> kUnitShift, left_units = left >> kUnitShift;
  const std::int32_t distance2 = ahead_units * ahead_units + left_units * left_units;
  const std::int32_t far_units = f.far_um >> kUnitShift;
  if (!trapezoid && distance2 > far_units * far_units) return false;
  const BinaryAngle bearing = atan2_binary(left_units, ahead_units);
  if (!trapezoid && std::abs(int{bearing.signed_raw()}) > f.half_angle) return false;
  const std::int32_t range = profile_.range_units(bearing);
  const std::int32_t limit = profile_.ends_on_obstacle(bearing) ? range + surface_units : range;
  return range != 0 && distance2 <= limit * limit;
}

ViewStatistics ScanFusion::update_visits(ExplorationMap& map, const Pose& pose) {
  const GridFrame& frame = map.frame();
  const CellRect box = footprint_box(config_.footprint, frame, pose).intersection(frame.window());
  action_rect_ = action_rect_.united(box);
  const std::int64_t c = cos_q30(pose.heading), s = sin_q30(pose.heading);
  const std::int64_t step_ahead = c * frame.cell_um(), step_left = -s * frame.cell_um();
  // A cell on an obstacle's surface lies a little behind the end of the beam.
  const std::int32_t surface_units = (frame.cell_um() * 3 / 4) >> kUnitShift;
  const std::span<const std::uint8_t> flags = map.layers().flags;
  CellRect counted{};
  ViewStatistics seen;
  for (std::int32_t y = box.y; y < box.top(); ++y) {
    const Point first = frame.center_of({box.x, y});
    const std::int64_t dx = std::int64_t{first.x_um} - pose.position.x_um;
    const std::int64_t dy = std::int64_t{first.y_um} - pose.position.y_um;
    std::int64_t ahead_q30 = dx * c + dy * s, left_q30 = dy * c - dx * s;
    std::size_t i = frame.index_of({box.x, y});
    std::int32_t leftmost = box.right(), rightmost = box.x - 1;
    for (std::int32_t x = box.x; x < box.right(); ++x, ++i) {
      const auto ahead = static_cast<std::int32_t>(ahead_q30 >> 30);
      const auto left = static_cast<std::int32_t>(left_q30 >> 30);
      ahead_q30 += step_ahead;
      left_q30 += step_left;
      if (flags[i] & cell_flag::kSeenThisAction) continue;
      if (!sees(ahead, left, surface_units)) continue;
      count(map, i, seen);
      leftmost = std::min(leftmost, x);
      rightmost = x;
    }
    if (rightmost >= leftmost) {
      counted = counted.united(CellRect{leftmost, y, rightmost - leftmost + 1, 1});
    }
  }
  map.note_visits(counted);
  return seen;
}

void ScanFusion::count(ExplorationMap& map, std::size_t index, ViewStatistics& seen) {
  const MapLayers& layers = map.layers();
  layers.flags[index] = layers.flags[index] | cell_flag::kSeenThisAction;
  const unsigned before = layers.own_visits[index] + unsigned{layers.peer_visits[index]};
  if (before == 0) {
    ++seen.newly_seen_cells;
  } else {
    ++seen.re_seen_cells;
    seen.re_seen_penalty_q12 += visit_penalty_q12(before);
  }
  map.count_visit_at(index);
}

}  // namespace ivfm
