// Shortest path map: geodesic distance from the robot over free cells, by Dijkstra's algorithm on
// a fixed-size bucket queue (Dial, 1969).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/mapping/exploration_map.h"

namespace ivfm {

namespace path {
// Costs in units of 1/12 cell: a straight step is 12, a diagonal one 17 (error below 0.2 %).
inline constexpr std::uint16_t kStraight = 12;
inline constexpr std::uint16_t kDiagonal = 17;
inline constexpr std::uint16_t kUnreachable = 0xffff;
inline constexpr std::uint16_t kLongest = 0xfff0;  // cells further away count as unreachable
}  // namespace path

// Storage of the queue: a ring of buckets that each hold the cells of one distance.
template <std::size_t kCapacity>
struct BucketStorage {
  static constexpr std::size_t kBuckets = 32;  // > the longest step, 17, and a power of two
  std::array<std::uint32_t, kBuckets * kCapacity> entries;
};

// How much room to keep: as much as the map's inflation, as little as the robot needs, or half a
// cell less still, for a robot that is shut in.
enum class Clearance : std::uint8_t { kPreferred, kTight, kEscape };

struct PathConfig {
  // Robots that map with a short camera drive into the unknown; with a lidar they keep to what
  // they know to be free.
  bool unknown_is_traversable = true;
  std::int32_t tight_radius_um = 0;  // 0: no tighter than the map's inflation
};

class ShortestPathMap {
 public:
  // `entries`: BucketStorage's memory (32 equal buckets).
  ShortestPathMap(const PathConfig& config, std::span<std::uint32_t> entries)
      : config_(config), entries_(entries), capacity_(entries.size() / kBuckets) {}

  // Fills map.layers().path_cost inside `region` (clipped to the window) with the cost of the
  // shortest path from `robot` that stays in the region; cells a robot cannot stand on and cells
  // out of reach get kUnreachable. Cells outside the region become unknown to cost_at().
  // A robot that already touches an inflated obstacle may leave it, and only moves away from it
  // unless it is squeezed in between several.
  // kTight squeezes through gaps that the inflation closes but a robot of config().tight_radius_um
  // fits through; kEscape through gaps that only look narrower than that: a place where an obstacle
  // was seen may be half a cell nearer than the obstacle is.
  void compute(ExplorationMap& map, Cell robot, const CellRect& region,
               Clearance clearance = Clearance::kPreferred);

  // Cost to reach `c`, kUnreachable outside the last computed region.
  std::uint16_t cost_at(const ExplorationMap& map, Cell c) const;
  // Whether a robot may stand on `c`.
  bool is_traversable(const ExplorationMap& map, Cell c) const;
  const CellRect& region() const { return region_; }
  const PathConfig& config() const { return config_; }
  void forget() { region_ = {}; }
  void set_region(const CellRect& region) { region_ = region; }  // after a copied map

 private:
  static constexpr std::size_t kBuckets = 32;
  // ExplorationMap inflates by at most 8 cells; one more on each side leads out of it.
  static constexpr std::size_t kMaxEscapeSide = 19;

  void measure_escape(const ExplorationMap& map, const CellRect& around);
  std::uint16_t escape_clearance(const ExplorationMap& map, std::uint32_t index) const;
  void drain(ExplorationMap& map, std::uint32_t bucket);
  void push(std::uint32_t index, std::uint32_t direction, std::uint16_t cost);
  void settle(ExplorationMap& map, std::uint32_t index, std::uint32_t direction);
  bool leads_outwards(const ExplorationMap& map, std::uint32_t from, std::uint32_t to) const;
  void relax_from_all(ExplorationMap& map);
  void run(ExplorationMap& map);

  PathConfig config_;
  std::span<std::uint32_t> entries_;
  std::size_t capacity_;
  std::array<std::uint32_t, kBuckets> sizes_{};
  std::array<std::int32_t, 8> offsets_{};  // of the neighbours' indices
  std::size_t queued_ = 0;
  bool overflowed_ = false;
  bool leaves_outwards_only_ = true;  // blocked cells lead only to cells further from obstacles
  bool left_blocked_ground_ = false;  // the run has reached a cell that a robot can stand on
  CellRect region_{};
  Cell robot_{};
  // Around a robot that stands on blocked ground: squared distance to an obstacle, in cells.
  CellRect escape_rect_{};
  std::array<std::uint16_t, kMaxEscapeSide * kMaxEscapeSide> escape_clearance2_{};
};

}  // namespace ivfm
