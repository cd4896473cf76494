// Where in each occupied cell the obstacle's surface lies, and which way it faces, in fixed memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "firmware/localization/scan_surfaces.h"
#include "firmware/mapping/exploration_map.h"
#include "shared/geometry/pose.h"

namespace ivfm {

// A wall painted into cells loses its place and direction between them; scans matched against
// cells alone slowly turn towards the grid. The means of the hits keep both. A hash table over
// global cells; where it is full, cells far from the robot give way.
class SurfaceMap {
 public:
  struct Entry {
    std::int16_t x = 0;  // the cell
    std::int16_t y = 0;
    std::int16_t sub_x = 0;   // the mean, in 1/8192 cell from the cell's lower left corner
    std::int16_t sub_y = 0;   // (it may lie a little outside)
    std::uint8_t weight = 0;  // of the hits so far; 0: the entry is free
    std::uint8_t facing = 0;  // direction of the normal, in 256ths of a turn
  };
  // The surface near a point, as seen by `normal`: the weighted mean of the distances along it.
  struct Distance {
    std::int32_t um = 0;
    std::int32_t weight = 0;       // 0: there is none
    bool beside_obstacle = false;  // an obstacle is there, whichever way it faces
  };

  // `entries`: the memory, a power of two of at least kProbes, or none: nothing is ever remembered.
  explicit SurfaceMap(std::span<Entry> entries) : entries_(entries) { clear(); }

  void clear();
  // Takes a scan that was just fused into `map` at `pose`, and the surfaces found in it: all hits
  // within `range_um`.
  void learn(const ExplorationMap& map, const Pose& pose, const Scan& scan,
             const ScanSurfaces& surfaces, std::int32_t range_um);
  // Of the surfaces in the cell of `p` and its neighbours that face as `normal` (Q14) does, at most
  // a right angle off. Cells that `map` holds to be free have none.
  Distance distance(const ExplorationMap& map, Point p, std::int32_t normal_x,
                    std::int32_t normal_y, std::uint8_t facing) const;

 private:
  static constexpr std::size_t kProbes = 4;
  static constexpr std::int32_t kMaxWeight = 255;  // then the mean stays: later poses have drifted

  std::size_t slot(Cell c, std::size_t probe) const;
  const Entry* find(Cell c) const;
  Entry& find_or_replace(Cell c, Cell robot);

  std::span<Entry> entries_;
};

// The memory of a SurfaceMap.
template <std::size_t kEntries>
struct SurfaceStorage {
  static_assert((kEntries & (kEntries - 1)) == 0, "a power of two");
  std::array<SurfaceMap::Entry, kEntries> surface_entries;
};

}  // namespace ivfm
