// The robot's map: occupancy, visit frequencies (own and peers'), and what planning derives from
// it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/link/shared_map.h"
#include "shared/geometry/grid_frame.h"
#include "shared/status/status.h"

namespace ivfm {

// Occupancy evidence of a cell, in bounded steps: above 0 occupied, below 0 free, 0 unknown.
namespace occupancy {
inline constexpr std::int8_t kUnknown = 0;
inline constexpr int kHit = 8;       // added when a beam ends in the cell
inline constexpr int kMiss = -1;     // added when a beam passes through the cell
inline constexpr int kMax = 24;      // an obstacle that went away is forgotten after 24 misses
inline constexpr int kMin = -4;      // surely free; one hit makes an obstacle of it all the same
inline constexpr int kDoubted = -1;  // surely free, but hit by the last scan
}  // namespace occupancy

// Bits of the flags layer.
namespace cell_flag {
inline constexpr std::uint8_t kOwnObstacle = 1;  // own evidence says occupied
// Another robot says occupied, and this one has not seen for itself that it is free: what others
// saw may have moved since, or have been this very robot.
inline constexpr std::uint8_t kPeerObstacle = 2;
inline constexpr std::uint8_t kSeenThisAction =
    4;                                           // already counted in this action's union of views
inline constexpr std::uint8_t kHitThisScan = 8;  // a beam of the scan being fused ends here
inline constexpr std::uint8_t kGivenUp = 16;     // was a goal, and going there showed nothing new
inline constexpr std::uint8_t kDoubted = 32;     // the scan being fused hits it, surely free before
inline constexpr std::uint8_t kRobot = 64;       // another robot stood here in the last scan
inline constexpr std::uint8_t kPeerTold = 128;   // others say occupied, whatever this one has seen
inline constexpr std::uint8_t kObstacle = kOwnObstacle | kPeerObstacle | kRobot;
}  // namespace cell_flag

// The stored cells, one value a cell in the order of GridFrame. Owned by MapStorage.
struct MapLayers {
  std::span<std::int8_t> occupancy;
  std::span<std::uint8_t> own_visits;   // saturating at 255
  std::span<std::uint8_t> peer_visits;  // the sum of the others, saturating at 255
  std::span<std::uint8_t> flags;
  std::span<std::uint8_t> inflation;   // known obstacle cells within the robot's radius
  std::span<std::uint16_t> path_cost;  // see ShortestPathMap; says nothing outside its region
};

// Fixed memory for a square window of `kCells` x `kCells`.
template <std::int32_t kCells>
struct MapStorage {
  static constexpr std::size_t kSize = static_cast<std::size_t>(kCells) * kCells;
  std::array<std::int8_t, kSize> occupancy;
  std::array<std::uint8_t, kSize> own_visits, peer_visits, flags, inflation;
  std::array<std::uint16_t, kSize> path_cost;

  MapLayers layers() { return {occupancy, own_visits, peer_visits, flags, inflation, path_cost}; }
};

// Logic over the layers. Cells outside the window read as unknown, unvisited and blocked.
class ExplorationMap final : public SharedMap {
 public:
  // `robot_radius_um`: obstacles are inflated by this much. At most 8 cells, so that inflation
  // counts fit a byte.
  ExplorationMap(const MapLayers& layers, std::int32_t cell_um, std::int32_t window_cells,
                 std::int32_t robot_radius_um);

  // Forgets everything; the window is centred on `center`.
  void clear(Cell center);
  // Rolls the window so that `robot` keeps a quarter of the window's side to every edge; what
  // leaves the window is forgotten. Returns true when it moved.
  bool roll_to(Cell robot);

  const GridFrame& frame() const { return frame_; }
  const MapLayers& layers() const { return layers_; }
  std::int32_t robot_radius_um() const { return robot_radius_um_; }

  bool is_obstacle(Cell c) const { return has_flag(c, cell_flag::kObstacle); }
  bool is_given_up(Cell c) const { return has_flag(c, cell_flag::kGivenUp); }
  // Observed free or visited, and not an obstacle.
  bool is_known_free(Cell c) const;
  // Visits of all robots, saturating at 255.
  unsigned visits(Cell c) const;
  bool is_seen(Cell c) const { return visits(c) != 0; }
  // A robot centred here would touch a known obstacle, or the cell lies outside the window.
  bool is_blocked(Cell c) const {
    return !frame_.contains(c) || layers_.inflation[frame_.index_of(c)] != 0;
  }

  // Whether the middle of a known obstacle lies within `radius_um` of the middle of `c`.
  bool obstacle_within(Cell c, std::int32_t radius_um) const;

  // Adds `evidence` (occupancy::kHit or kMiss) to a cell; outside the window nothing happens.
  void add_evidence(Cell c, int evidence);
  // Seen free again and again, and not hit by the last scan.
  bool is_surely_free(Cell c) const {
    return frame_.contains(c) && layers_.occupancy[frame_.index_of(c)] == occupancy::kMin;
  }
  // A scan hits what was surely free: the next hit makes an obstacle, misses make it free again.
  void doubt(Cell c);
  bool is_doubted(Cell c) const { return has_flag(c, cell_flag::kDoubted); }
  // Moves what this robot has seen by `moved` (T_new_old of the map frame); what the others told
  // stays. Uses MapLayers::path_cost as its scratch memory. What leaves the window is forgotten.
  void re_express(const Pose& moved);
  // The same for a move of any size, of a robot that was told nothing by others: the window goes
  // along, and what then lies outside it is forgotten.
  void re_express_alone(const Pose& moved);
  // Another robot stands there: an obstacle until the next forget_robots(), and no evidence.
  void put_robot(Cell c);
  void forget_robots();
  // Adds occupancy::kMiss to the cells on the straight line from `a` to before `b` (Bresenham) that
  // no beam of the scan being fused ends in (kHitThisScan), as often as `times` beams do.
  void add_misses_on_line(Cell a, Cell b, int times = 1);
  // Counts one visit of this robot. Requires the cell inside the window.
  void count_visit(Cell c);
  // The same for many: count_visit_at() each index, then note_visits() with their rectangle once.
  void count_visit_at(std::size_t index) {
    std::uint8_t& count = layers_.own_visits[index];
    count = static_cast<std::uint8_t>(count + (count < 255 ? 1 : 0));
  }
  void note_visits(const CellRect& rect);
  // Holds every cell that was ever observed or reported, so that planning need not look elsewhere.
  const CellRect& known_rect() const { return known_; }
  void set_flag(Cell c, std::uint8_t flag);
  void clear_flag(const CellRect& rect, std::uint8_t flag);

  // What changed in an own layer since the last call; empty when nothing did.
  CellRect take_changes(Layer layer);

  Status read_own(Layer layer, const CellRect& rect, std::span<std::uint8_t> out) const override;
  Status write_peers(Layer layer, const CellRect& rect,
                     std::span<const std::uint8_t> cells) override;
  Status restore_own(Layer layer, const CellRect& rect,
                     std::span<const std::uint8_t> cells) override;

  // Takes over another map's contents; both must have the same window size and cell size.
  void copy_from(const ExplorationMap& other);

 private:
  bool has_flag(Cell c, std::uint8_t flag) const {
    return frame_.contains(c) && (layers_.flags[frame_.index_of(c)] & flag) != 0;
  }
  void update_obstacle(Cell c, std::uint8_t flag, bool occupied);
  void believe_peers(Cell c);
  void set_flag_at(std::size_t index, std::uint8_t flag, bool on) {
    std::uint8_t& flags = layers_.flags[index];
    flags = static_cast<std::uint8_t>(on ? flags | flag : flags & ~flag);
  }
  void restore_cell(Layer layer, Cell c, std::uint8_t value);
  void note_change(Layer layer, Cell c) {
    CellRect& change = changes_[static_cast<std::size_t>(layer)];
    change = change.united(c);
  }
  void stamp_inflation(Cell c, int step);
  void add_misses_at(std::size_t index, int times);
  template <typename Visit>
  void for_each_on_line(Cell a, Cell b, Visit visit);

  MapLayers layers_;
  GridFrame frame_;
  std::int32_t robot_radius_um_;
  std::array<std::int8_t, 17> disc_half_width_{};  // columns of the inflation disc, row by row
  std::int32_t disc_radius_cells_ = 0;
  std::array<CellRect, 2> changes_{};
  CellRect known_{};
  CellRect robots_{};  // holds all cells with kRobot
};

}  // namespace ivfm
