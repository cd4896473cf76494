// Where in each occupied cell the obstacle's surface lies: the mean of the hits, in fixed memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "firmware/mapping/exploration_map.h"
#include "shared/geometry/pose.h"

namespace ivfm {

// A wall painted into cells loses its place and direction between them; scans matched against
// cells alone slowly turn towards the grid. The means keep both. A hash table over global cells;
// where it is full, cells far from the robot give way.
class SurfaceMap {
 public:
  struct Entry {
    std::int16_t x = 0;  // the cell
    std::int16_t y = 0;
    std::uint16_t sub_x = 0;  // the mean, in 1/65536 cell from the cell's lower left corner
    std::uint16_t sub_y = 0;
    std::uint16_t hits = 0;  // 0: the entry is free
  };
  // In 1/256 cell from the cell's lower left corner.
  struct Mean {
    std::int32_t x = 128;
    std::int32_t y = 128;
  };

  // `entries`: the memory, a power of two of at least kProbes; none: every mean is the cell's
  // middle.
  explicit SurfaceMap(std::span<Entry> entries) : entries_(entries) { clear(); }

  void clear();
  // Takes a scan that was just fused into `map` at `pose`: its hits within `range_um` that lie on
  // obstacles of the map.
  void learn(const ExplorationMap& map, const Pose& pose, const Scan& scan, std::int32_t range_um);
  Mean mean(Cell c) const;

 private:
  static constexpr std::size_t kProbes = 4;
  static constexpr std::uint16_t kMaxHits = 64;  // then the mean stays: later poses have drifted

  std::size_t slot(Cell c, std::size_t probe) const;
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
