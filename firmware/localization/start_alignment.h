// Corrects a start pose that is only roughly known, by what the other robots have mapped there.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/localization/scan_surfaces.h"
#include "firmware/mapping/exploration_map.h"
#include "shared/geometry/pose.h"

namespace ivfm {

// For a robot that stands and has painted nothing yet: searches all poses within 0.5 m and 15
// degrees of the one that it was given for the one at which its scan lies on the others' obstacles
// (Olson, "Real-time correlative scan matching", ICRA 2009). Where the others have not been, or a
// bare corridor leaves open where along it the robot stands, nothing is found.
class StartAlignment {
 public:
  enum class Result : std::uint8_t { kSearching, kFound, kNotFound };

  void begin(const Pose& guess);
  // A revolution's share of the search, `samples` in the robot's frame. kFound: pose() is where the
  // robot stands; kNotFound: all poses were tried, several times as the map grew.
  Result step(const ExplorationMap& map, std::span<const SurfaceSample> samples);
  const Pose& pose() const { return best_.pose; }

 private:
  static constexpr std::int32_t kReach = 10;  // cells
  static constexpr std::int32_t kSide = 2 * kReach + 1;

  struct Candidate {
    Pose pose;
    std::int32_t score = 0;
  };

  void try_heading(const ExplorationMap& map, std::span<const SurfaceSample> samples,
                   BinaryAngle heading);
  void note(const Candidate& candidate);
  bool is_clear(std::size_t samples) const;
  void refine(const ExplorationMap& map, std::span<const SurfaceSample> samples);

  Pose guess_;
  std::int32_t turn_ = 0;  // degrees, next to try
  std::uint8_t passes_ = 0;
  Candidate best_, second_;  // second_: the best at another place
};

}  // namespace ivfm
