// The fleet's map in memory: what every robot saw, and the sum, in tiles of 32 x 32 cells.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <tuple>
#include <vector>

#include "shared/geometry/grid_frame.h"
#include "shared/wire/layer.h"

namespace ivfm::host {

inline constexpr std::int32_t kTileSide = 32;
inline constexpr std::size_t kTileCells = static_cast<std::size_t>(kTileSide) * kTileSide;

// A tile's place: cells [32 x, 32 x + 32) by [32 y, 32 y + 32) of one layer.
struct TileKey {
  Layer layer = Layer::kVisits;
  std::int32_t x = 0;
  std::int32_t y = 0;
  bool operator==(const TileKey&) const = default;
  bool operator<(const TileKey& other) const {
    return std::tie(layer, y, x) < std::tie(other.layer, other.y, other.x);
  }
  CellRect cells() const { return {x * kTileSide, y * kTileSide, kTileSide, kTileSide}; }
};

// What one robot said about a tile. Visits need no sequence: the greater count is the newer one.
struct RobotTile {
  std::array<std::uint8_t, kTileCells> cells{};
  std::uint32_t epoch = 0;  // obstacles only: of `sequences`
  std::unique_ptr<std::array<std::uint32_t, kTileCells>> sequences;  // obstacles only
};

// A part of a tile that a merge has changed.
struct TileChange {
  TileKey key;
  CellRect changed;      // bounding rectangle of the cells with a new value; may be empty
  bool touched = false;  // anything to store, be it only a sequence number
};

// Memory grows with the mapped area, not with traffic.
class MapStore {
 public:
  // Takes over a region of a robot's datagram: visits by maximum, obstacles by newest (epoch,
  // sequence) per cell. Appends to `changes` one entry a tile. Any order, any repetition of
  // datagrams gives the same map.
  void merge(std::uint16_t robot, std::uint32_t epoch, std::uint32_t sequence, Layer layer,
             const CellRect& rect, std::span<const std::uint8_t> cells,
             std::vector<TileChange>& changes);
  // Forgets all that a robot said; appends to `changes` one entry a tile.
  void forget(std::uint16_t robot, std::vector<TileChange>& changes);
  // Puts back a stored tile, replacing what is there.
  void restore(std::uint16_t robot, const TileKey& key, RobotTile tile);

  // What a robot said; 0 where it said nothing.
  std::uint8_t robot_value(std::uint16_t robot, Layer layer, Cell cell) const;
  // Sum of the visits (at most 255), or 1 when any robot says obstacle.
  std::uint8_t merged_value(Layer layer, Cell cell) const;
  // The same without what `robots` said, for `rect` within one tile; rect.area() bytes.
  void read_without(std::span<const std::uint16_t> robots, const TileKey& key, const CellRect& rect,
                    std::span<std::uint8_t> out) const;

  // The merged values of a whole tile; kTileCells bytes.
  void read_merged(const TileKey& key, std::span<std::uint8_t> out) const;
  // Tiles about which any robot said something.
  std::set<TileKey> tiles() const;

  // Null when the robot said nothing about the tile.
  const RobotTile* robot_tile(std::uint16_t robot, const TileKey& key) const;
  // Tiles that touch `window` about which a robot other than `robot` said something.
  std::vector<TileKey> tiles_of_others(std::uint16_t robot, const CellRect& window) const;
  // All tiles of a robot, in order; null when it said nothing.
  const std::map<TileKey, RobotTile>* robot_tiles(std::uint16_t robot) const;
  // How many new tiles `rect` would need for this robot.
  std::size_t missing_tiles(std::uint16_t robot, Layer layer, const CellRect& rect) const;

  std::size_t tile_count() const { return tile_count_; }  // over all robots
  std::uint64_t explored_cells() const { return nonzero_[0]; }
  std::uint64_t obstacle_cells() const { return nonzero_[1]; }

 private:
  struct Sums : std::array<std::uint32_t, kTileCells> {
    std::uint32_t robots = 0;  // that said something about the tile
  };
  using RobotTiles = std::map<TileKey, RobotTile>;

  RobotTile& tile_for(std::uint16_t robot, const TileKey& key);
  void set(RobotTile& tile, Sums& sums, const TileKey& key, std::size_t index, std::uint8_t value);

  std::map<std::uint16_t, RobotTiles> robots_;
  std::map<TileKey, Sums> sums_;  // of visits, or of robots that say obstacle
  std::size_t tile_count_ = 0;
  std::array<std::uint64_t, kLayerCount> nonzero_{};
};

// Calls visit(key, part of `rect` inside that tile) for every tile that `rect` touches.
template <typename Visit>
void for_each_tile(Layer layer, const CellRect& rect, Visit visit) {
  const auto tile_of = [](std::int32_t cell) { return cell >> 5; };
  static_assert(kTileSide == 1 << 5);
  if (rect.empty()) return;
  for (std::int32_t y = tile_of(rect.y); y <= tile_of(rect.top() - 1); ++y) {
    for (std::int32_t x = tile_of(rect.x); x <= tile_of(rect.right() - 1); ++x) {
      const TileKey key{layer, x, y};
      visit(key, key.cells().intersection(rect));
    }
  }
}

// Index of a cell in its tile.
constexpr std::size_t tile_index(Cell cell) {
  return static_cast<std::size_t>(cell.y & (kTileSide - 1)) * kTileSide +
         static_cast<std::size_t>(cell.x & (kTileSide - 1));
}

// The cell with that index.
constexpr Cell cell_of_tile_index(const TileKey& key, std::size_t index) {
  const auto i = static_cast<std::int32_t>(index);
  return {key.x * kTileSide + i % kTileSide, key.y * kTileSide + i / kTileSide};
}

}  // namespace ivfm::host
