// Corrects a start pose that is only roughly known, by what the other robots have mapped there.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/localization/scan_surfaces.h"
#include "firmware/mapping/exploration_map.h"
#include "shared/geometry/pose.h"

namespace ivfm {

// Searches all start poses around the one that a robot was given for the one with which its scan
// lies on the others' obstacles (Olson, "Real-time correlative scan matching", ICRA 2009): while it
// stands there within 0.6 m and 16 degrees, more than a start may be wrong; later, from wherever it
// has driven to, within 1.2 m and 32 degrees, because the others' frame may be as wrong as its own.
// Where the others have not been, or a bare corridor leaves open where along it the robot stands,
// nothing is found, and nor is a pose at the rim of what is searched: beyond may be a better one.
class StartAlignment {
 public:
  enum class Result : std::uint8_t { kSearching, kFound, kNotFound };

  void begin(const Pose& start);
  // From the next pass on: searches twice as far.
  void search_far();
  // A revolution's share of a pass through all headings, by the scan of the revolution in which the
  // pass begins: `samples` in the robot's frame, seen from `pose`, which follows from the start
  // that was given. kFound: correction() is where that start really was; kNotFound: nothing was
  // found, several times as the map grew. Either way the next step begins anew.
  Result step(const ExplorationMap& map, std::span<const SurfaceSample> samples, const Pose& pose);
  // T_new_old of the map frame.
  Pose correction() const { return compose(best_.pose, relative_pose(seen_from_, {})); }
  // Where the scan was taken that told it, in the old frame.
  const Pose& seen_from() const { return seen_from_; }

 private:
  struct Reach {
    std::int32_t cells;
    std::int32_t turns;         // to either side
    std::int32_t turn_degrees;  // from one to the next
    std::int32_t headings_per_step;
  };
  static constexpr Reach kNear{12, 16, 1, 2};
  static constexpr Reach kFar{24, 16, 2, 1};

  struct Candidate {
    Pose pose;
    std::int32_t score = 0;
    bool at_rim = false;  // of what is searched
  };
  // Shifts that are counted at once: some rows of all those in reach.
  static constexpr std::int32_t kBandRows = 13;
  using Band = std::array<std::uint8_t, kBandRows*(2 * kFar.cells + 1)>;

  struct SeenPoint {  // in the robot's frame; a range of 32 m fits
    std::int16_t x_mm = 0, y_mm = 0;
  };

  std::span<const SeenPoint> points() const { return {points_.data(), size_}; }
  void begin_pass(std::span<const SurfaceSample> samples, const Pose& pose);
  void try_turn(const ExplorationMap& map, std::int32_t turn);
  void count_hits(const ExplorationMap& map, Cell middle, std::int32_t first_row, std::int32_t rows,
                  Band& hits) const;
  void note(const Candidate& candidate);
  bool is_clear() const;
  void refine(const ExplorationMap& map);

  Pose start_;  // as it was given
  Pose seen_from_;
  std::array<SeenPoint, ScanSurfaces::kMaxSamples> points_{};
  std::size_t size_ = 0;
  bool far_ = false;
  Reach reach_ = kNear;    // of this pass
  std::int32_t turn_ = 0;  // next to try
  std::uint8_t passes_ = 0;
  Candidate best_, second_;  // second_: the best at another place
};

}  // namespace ivfm
