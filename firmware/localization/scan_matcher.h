// Finds the pose at which a revolution fits the robot's own map best.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "firmware/localization/scan_surfaces.h"
#include "firmware/localization/surface_map.h"
#include "firmware/localization/symmetric3.h"
#include "firmware/mapping/exploration_map.h"
#include "shared/geometry/pose.h"

namespace ivfm {

struct MatcherConfig {
  std::int32_t range_um = 11'500'000;  // points farther away are left out
  std::int32_t search_um =
      200'000;  // how far the prediction may be off along each axis, at most 4 cells
  std::uint16_t search_angle = 1456;   // and in heading, binary angle units (8 degrees)
  std::uint16_t min_samples = 20;      // fewer say nothing
  std::uint16_t min_judged = 15;       // so many of them must lie where the map is known
  std::uint16_t few_judged = 6;        // or so many, if they fit well
  std::uint16_t min_fit_percent = 50;  // share of these that must lie on surfaces of the map
};

enum class MatchOutcome : std::uint8_t {
  kMatched,
  kTooFewPoints,  // the scan holds too little
  kUnknownPlace,  // the map holds too little where the scan's points lie to tell a pose by
  kPoorFit,       // no pose in reach explains the scan
};

struct ScanMatch {
  MatchOutcome outcome = MatchOutcome::kTooFewPoints;
  Pose pose;                  // the most likely one; the prediction unless kMatched
  Symmetric3 covariance;      // of the pose: metres and radians
  std::uint16_t judged = 0;   // samples in known parts of the map, at that pose
  std::uint16_t fitting = 0;  // of these, on surfaces
  // kPoorFit: but a pose farther off than the prediction allows does.
  bool explained_elsewhere = false;
  // Not judged: on obstacles that have not been seen from this side.
  std::uint16_t on_backs = 0;
  std::uint16_t flat = 0;  // samples that face some way: all that can be judged at all

  // How many samples would fit if nothing were new.
  std::int32_t could_fit() const { return flat - on_backs; }
  bool explains(std::int32_t percent) const { return fitting * 100 >= judged * percent; }
};

// A pose that is right explains more than this of a scan, in percent, in a map that is.
inline constexpr std::int32_t kGoodFitPercent = 75;

// From `to` to `from`, in metres and radians.
Vector3 difference(const Pose& from, const Pose& to);

// The most likely pose, given the odometry's prediction with its covariance, and the scan's samples
// with their distances from the map's surfaces, measured across the surface (point to line: Censi,
// "An ICP variant using a point-to-line metric", ICRA 2008), by Gauss-Newton steps with a robust
// kernel. Directions that no surface faces stay where the odometry says, and their covariance
// stays large. Where that does not explain the scan, an exhaustive search comes first (Olson,
// "Real-time correlative scan matching", ICRA 2009).
class ScanMatcher {
 public:
  explicit ScanMatcher(const MatcherConfig& config) : config_(config) {}

  // Matches a scan (already corrected for motion) near `predicted`, both for the same instant.
  // `covariance`: of the prediction, in metres and radians, positive definite.
  ScanMatch match(const ExplorationMap& map, const SurfaceMap& surfaces, const Pose& predicted,
                  const Symmetric3& covariance, const Scan& scan);

  // The same for a robot that has lost its place and may be somewhere around `guess`: how much the
  // best pose there explains, whatever it is. kMatched, or kUnknownPlace.
  ScanMatch locate(const ExplorationMap& map, const SurfaceMap& surfaces, const Pose& guess,
                   const Scan& scan);
  // Only finds the scan's surfaces.
  void look_at(const Scan& scan, std::int32_t cell_um) {
    scan_surfaces_.take(scan, config_.range_um, cell_um);
  }

  const MatcherConfig& config() const { return config_; }
  // Of the last scan.
  const ScanSurfaces& surfaces() const { return scan_surfaces_; }

 private:
  // Sums over the samples for a Gauss-Newton step, and how well they fit.
  struct Evidence {
    Symmetric3 information;
    Vector3 gradient{};
    std::uint16_t judged = 0;
    std::uint16_t fitting = 0;
    std::uint16_t on_backs = 0;
  };
  std::uint16_t count_flat() const;
  Evidence weigh(const Pose& pose, std::int32_t kernel_um) const;
  ScanMatch refine(Pose start, const Pose& predicted, const Symmetric3& information) const;
  Pose search(const Pose& predicted, const Symmetric3& covariance) const;
  Pose search_in_steps(const Pose& middle, std::int32_t stride) const;
  void count_hits(Cell cell, std::int32_t reach, std::int32_t stride,
                  std::span<std::uint8_t> hits) const;
  bool in_reach(const ScanMatch& match, const Pose& predicted, const Symmetric3& information) const;

  MatcherConfig config_;
  ScanSurfaces scan_surfaces_;
  const ExplorationMap* map_ = nullptr;  // these two during match()
  const SurfaceMap* surfaces_ = nullptr;
};

}  // namespace ivfm
