// Finds the pose at which a revolution fits the robot's own occupancy map best, in integers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "firmware/localization/surface_map.h"
#include "firmware/mapping/exploration_map.h"
#include "shared/geometry/pose.h"

namespace ivfm {

struct MatcherConfig {
  std::int32_t range_um = 6'000'000;   // points farther away are left out: too noisy, not mapped
  std::int32_t search_um = 100'000;    // how far the prediction may be off along each axis
  std::uint16_t search_angle = 546;    // and in heading, binary angle units (3 degrees)
  std::uint16_t min_points = 40;       // fewer points say nothing
  std::uint16_t min_judged = 30;       // so many of them must lie where the map is known
  std::uint16_t min_fit_percent = 50;  // share of these that must lie on obstacles of the map
};

enum class MatchOutcome : std::uint8_t {
  kMatched,
  kTooFewPoints,  // the scan holds too little
  kUnknownPlace,  // the map holds too little where the scan's points lie
  kPoorFit,       // no pose in reach explains the scan
};

// How much a match knows. Weights are Q10: 0 the odometry alone counts, 1024 the match alone.
struct MatchCertainty {
  BinaryAngle axis;  // direction in the map along which the match knows the position best
  std::int32_t along_q10 = 0;
  std::int32_t across_q10 = 0;  // at right angles to `axis`: near 0 in a bare corridor
  std::int32_t heading_q10 = 0;
};

struct ScanMatch {
  MatchOutcome outcome = MatchOutcome::kTooFewPoints;
  Pose pose;                  // the best fit; the prediction when nothing was searched
  std::uint16_t points = 0;   // taken from the scan
  std::uint16_t judged = 0;   // of these, in known parts of the map
  std::uint16_t fitting = 0;  // of these, on obstacles
  MatchCertainty certainty;   // all 0 unless kMatched
};

// The prediction moved towards a match as far as the match is certain, direction by direction.
Pose blend(const Pose& predicted, const ScanMatch& match);

// Correlative matching (Olson, "Real-time correlative scan matching", ICRA 2009): a hill climb from
// the prediction with steps down to 1/32 cell; where that does not explain the scan, an exhaustive
// search first; Gauss-Newton steps at the end. A point is worth the more the nearer it lies to the
// surface in its own or a neighbouring cell, measured across the scan's surface there (point to
// line: Censi, "An ICP variant using a point-to-line metric", ICRA 2008). Certainty comes from the
// scan's surfaces, too: directions that none faces stay with the odometry.
class ScanMatcher {
 public:
  static constexpr std::size_t kMaxPoints = 160;

  explicit ScanMatcher(const MatcherConfig& config) : config_(config) {}

  // Matches a scan (already corrected for motion) near `predicted`, both for the same instant.
  ScanMatch match(const ExplorationMap& map, const SurfaceMap& surfaces, const Pose& predicted,
                  const Scan& scan);

  const MatcherConfig& config() const { return config_; }

 private:
  // Positions in 1/256 cell.
  struct GridPoint {
    std::int32_t x = 0;
    std::int32_t y = 0;
  };
  // A pose relative to the prediction.
  struct Offset {
    std::int32_t x = 0;  // 1/256 cell
    std::int32_t y = 0;
    std::int32_t turn = 0;  // binary angle units
  };
  struct Candidate {
    Offset offset;
    std::int64_t score = 0;
  };

  void take_points(const Scan& scan, std::int32_t cell_um);
  void turn_to(std::int32_t turn);
  void find_normals();
  std::int32_t value(std::size_t i, GridPoint p) const;
  bool is_known_at(GridPoint p) const;
  GridPoint place(std::size_t i, const Offset& offset) const;
  std::int64_t overlap(const Offset& offset);
  std::int64_t score(const Offset& offset);
  Candidate climb(Candidate best);
  bool improve(Candidate& best, std::int32_t step, std::int32_t turn_step);
  Candidate search_everywhere();
  Candidate settle(const Candidate& climbed);
  bool newton_step(Offset& offset);
  bool nearest_surface(GridPoint p, GridPoint& to_surface) const;
  bool in_reach(const Offset& offset) const;
  void judge(const Offset& offset, ScanMatch& match);
  MatchCertainty certainty(const Offset& offset);
  // In the robot's frame, Q10; zero where the surface is not flat.
  GridPoint surface_normal(std::size_t i) const;

  MatcherConfig config_;
  const ExplorationMap* map_ = nullptr;  // these two during match()
  const SurfaceMap* surfaces_ = nullptr;
  BinaryAngle heading_;     // of the prediction
  GridPoint origin_;        // the prediction, from the middle of the window's lowest left cell
  std::int32_t reach_ = 0;  // search_um in 1/256 cell
  std::array<GridPoint, kMaxPoints> points_{};          // in the robot's frame
  std::array<GridPoint, kMaxPoints> turned_{};          // in the map's axes, for the turn below
  std::array<GridPoint, kMaxPoints> normals_{};         // Q10, in the robot's frame
  std::array<GridPoint, kMaxPoints> turned_normals_{};  // in the map's axes
  std::size_t size_ = 0;
  std::int32_t turn_ = 0;
};

}  // namespace ivfm
