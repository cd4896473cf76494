// Fuses scans into the map: occupancy from every beam, visit frequency from the visit footprint.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/lidar/scan.h"
#include "firmware/mapping/exploration_map.h"
#include "shared/geometry/pose.h"

namespace ivfm {

// The part of the floor that counts as seen from a pose, where nothing blocks the view.
struct VisitFootprint {
  enum class Kind : std::uint8_t { kSector, kTrapezoid };
  Kind kind = Kind::kSector;
  // Sector of the scan: within `far_um` of the robot and `half_angle` of straight ahead
  // (0x8000 = the full circle).
  // Trapezoid: near_um <= x <= far_um ahead and |y| <= slope_q16 * x / 2^16 + offset_um aside.
  std::int32_t near_um = 0;
  std::int32_t far_um = 3'000'000;
  std::uint16_t half_angle = 0x8000;
  std::int32_t slope_q16 = 0;
  std::int32_t offset_um = 0;

  static constexpr VisitFootprint sector(std::int32_t range_um, BinaryAngle half_angle) {
    return {Kind::kSector, 0, range_um, half_angle.raw(), 0, 0};
  }
  // The paper's camera (method.md, "Sensor footprint"): 0.040 <= x <= 0.245 m,
  // |y| <= 1.026 (0.866 x + 0.035) m.
  static constexpr VisitFootprint paper_camera() {
    return {Kind::kTrapezoid, 40'000, 245'000, 0, 58'230, 35'910};
  }
};

// A lidar's hits farther away are not mapped: its noise (1 % of the range with an RPLIDAR A1)
// exceeds a cell, and walls would become thick.
inline constexpr std::int32_t kLidarMappingRangeUm = 6'000'000;

struct FusionConfig {
  VisitFootprint footprint;
  // Beams are followed this far for occupancy; hits beyond say only "free up to here".
  std::int32_t mapping_range_um = 12'000'000;
  // Directions further than this from a measured beam are not seen.
  std::uint16_t max_beam_gap = 400;  // binary angle units, 2.2 degrees
  // Where the floor is surely free, only a second scan in a row makes an obstacle: who walks by
  // leaves no trail.
  bool doubt_changes = false;
};

// What an action saw, for rewards and metrics.
struct ViewStatistics {
  std::uint32_t newly_seen_cells = 0;    // nobody had seen them before
  std::uint32_t re_seen_cells = 0;       // seen before this action, by anybody
  std::int64_t re_seen_penalty_q12 = 0;  // sum of 2 sigma(count) - 1 over the re-seen cells, Q12

  void add(const ViewStatistics& o) {
    newly_seen_cells += o.newly_seen_cells;
    re_seen_cells += o.re_seen_cells;
    re_seen_penalty_q12 += o.re_seen_penalty_q12;
  }
};

// How far one can see in each direction, in 1024 bins of bearing. Fixed memory.
class VisibilityProfile {
 public:
  static constexpr std::size_t kBins = 1024;

  // Takes the nearest reading of each bin; bins without a beam take their neighbour's unless the
  // gap is wider than `max_gap`. Beams that measured nothing see nothing.
  void build(const Scan& scan, std::uint16_t max_gap);
  // Range in units of 1,024 um; 0: nothing seen in that direction.
  std::uint16_t range_units(BinaryAngle bearing) const { return range_[bearing.raw() >> 6]; }
  bool ends_on_obstacle(BinaryAngle bearing) const { return hit_[bearing.raw() >> 6] != 0; }

 private:
  void fill_gaps(std::uint16_t max_gap);

  std::array<std::uint16_t, kBins> range_;
  std::array<std::uint8_t, kBins> hit_;
};

class ScanFusion {
 public:
  explicit ScanFusion(const FusionConfig& config) : config_(config) {}

  // Starts a new action: visits are counted once per action on the union of its views.
  void begin_action(ExplorationMap& map);
  // Fuses one scan taken at `pose` (REP 103 frames). `count_visits` false updates occupancy only.
  ViewStatistics fuse(ExplorationMap& map, const Pose& pose, const Scan& scan, bool count_visits);

  const FusionConfig& config() const { return config_; }

 private:
  void update_occupancy(ExplorationMap& map, const Pose& pose, const Scan& scan);
  ViewStatistics update_visits(ExplorationMap& map, const Pose& pose);
  bool sees(std::int32_t ahead, std::int32_t left, std::int32_t surface_units) const;
  static void count(ExplorationMap& map, std::size_t index, ViewStatistics& seen);

  FusionConfig config_;
  VisibilityProfile profile_;
  CellRect action_rect_{};  // cells that may carry kSeenThisAction
};

}  // namespace ivfm
