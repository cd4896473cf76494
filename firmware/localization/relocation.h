// Finds a robot in its map again that has lost its place: carried away, or slipped for long.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "firmware/localization/scan_matcher.h"
#include "firmware/localization/surface_map.h"
#include "firmware/mapping/exploration_map.h"
#include "shared/geometry/pose.h"

namespace ivfm {

// Searches all free places of the map, some each revolution, while the robot stands: first coarsely
// against the inflated obstacles, then by matching at the best few places, and at the one where the
// wheels say it is. A place counts as found only when it explains several revolutions and no other
// one explains nearly as much; of the wheels' place it suffices to explain less.
class Relocation {
 public:
  enum class Result : std::uint8_t { kSearching, kFound, kNotFound };

  // Begins at the first place.
  void begin(const ExplorationMap& map);
  // A revolution's share of the search. kFound: match() tells where; kNotFound: the whole map was
  // searched, and the search began again. `by_wheels`: where it would be had it only driven.
  Result step(const ExplorationMap& map, const SurfaceMap& surfaces, ScanMatcher& matcher,
              const Scan& scan, const Pose& by_wheels);
  const ScanMatch& match() const { return best_; }

 private:
  static constexpr std::size_t kCandidates = 16;
  struct Candidate {
    Pose pose;
    std::int32_t score = 0;
  };

  void try_places(const ExplorationMap& map, const ScanSurfaces& scan,
                  std::span<const Cell> places);
  void keep(const Candidate& candidate);
  Result judge(const ExplorationMap& map, const SurfaceMap& surfaces, ScanMatcher& matcher,
               const Scan& scan, const Pose& by_wheels);

  Result give_up(const ExplorationMap& map);
  void note(const ScanMatch& match);
  static bool is_same_place(const Pose& a, const Pose& b);
  static std::int32_t support(const ScanMatch& match);

  CellRect region_;
  Cell next_;  // place to try
  std::array<Candidate, kCandidates> candidates_{};
  std::size_t judged_ = 0;  // of the candidates
  ScanMatch best_;
  std::int32_t second_ = 0;  // support of the best match at another place
  int looks_ = 0;            // at the best match's place, again
  std::int32_t odd_ = 0;     // samples that do not fit there, wrong ones counted several times
  std::int32_t could_fit_ = 0;
};

}  // namespace ivfm
