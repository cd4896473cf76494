// Finds out how the maps of robots that are kept apart lie in the team's map.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "firmware/hal/clock.h"
#include "host/map_server/map_alignment.h"
#include "host/map_server/map_store.h"

namespace ivfm::host {

using ApartMaps = std::map<std::uint16_t, MapStore>;  // by robot

// Looks at one robot's map after another, whenever it or the team's has grown; a share of the work
// at each step. A frame counts when very much is seen by both, or when it was found twice and both
// had seen more of the place by the second time.
class FrameFinder {
 public:
  struct Found {
    std::uint16_t robot;
    MapMatch match;
  };

  std::optional<Found> step(const MapStore& team, const ApartMaps& apart, std::int32_t cell_um,
                            TimeUs now_us);
  // The robot's map is another one from now on, or it is not apart any more.
  void forget(std::uint16_t robot);

 private:
  struct Search {
    std::uint64_t team_cells = 0, apart_cells = 0;  // obstacles when it was begun
    TimeUs begun_us = 0;
    std::optional<MapMatch> likely;
    bool done = false;
  };

  void begin(const MapStore& team, const ApartMaps& apart, std::int32_t cell_um, TimeUs now_us);
  static bool is_due(const Search& search, const MapStore& team, const MapStore& apart,
                     TimeUs now_us);
  static bool confirms(const std::optional<MapMatch>& earlier, const MapMatch& match);

  std::map<std::uint16_t, Search> searches_;
  std::uint16_t searching_ = 0;  // whose map alignment_ is about
  std::unique_ptr<MapAlignment> alignment_;
};

}  // namespace ivfm::host
