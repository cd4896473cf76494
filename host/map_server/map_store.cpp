#include "host/map_server/map_store.h"

#include <algorithm>

namespace ivfm::host {
namespace {

constexpr TileKey key_of(Layer layer, Cell cell) { return {layer, cell.x >> 5, cell.y >> 5}; }

constexpr std::uint8_t merged(Layer layer, std::uint32_t sum) {
  return static_cast<std::uint8_t>(std::min(sum, layer == Layer::kVisits ? 255u : 1u));
}

}  // namespace

RobotTile& MapStore::tile_for(std::uint16_t robot, const TileKey& key) {
  const auto [it, inserted] = robots_[robot].try_emplace(key);
  if (inserted) {
    ++tile_count_;
    ++sums_[key].robots;
    if (key.layer == Layer::kObstacles) {
      it->second.sequences = std::make_unique<std::array<std::uint32_t, kTileCells>>();
    }
  }
  return it->second;
}

void MapStore::set(RobotTile& tile, Sums& sums, const TileKey& key, std::size_t index,
                   std::uint8_t value) {
  const std::uint32_t before = sums[index];
  sums[index] = before - tile.cells[index] + value;
  tile.cells[index] = value;
  std::uint64_t& nonzero = nonzero_[static_cast<std::size_t>(key.layer)];
  nonzero += sums[index] != 0 ? 1u : 0u;
  nonzero -= before != 0 ? 1u : 0u;
}

void MapStore::merge(std::uint16_t robot, std::uint32_t epoch, std::uint32_t sequence, Layer layer,
                     const CellRect& rect, std::span<const std::uint8_t> cells,
                     std::vector<TileChange>& changes) {
  for_each_tile(layer, rect, [&](const TileKey& key, const CellRect& part) {
    RobotTile& tile = tile_for(robot, key);
    Sums& sums = sums_[key];
    TileChange change{key, {}, false};
    if (layer == Layer::kObstacles && epoch > tile.epoch) {
      tile.epoch = epoch;
      tile.sequences->fill(0);
    }
    if (layer == Layer::kObstacles && epoch < tile.epoch) return;
    for (std::int32_t y = part.y; y < part.top(); ++y) {
      for (std::int32_t x = part.x; x < part.right(); ++x) {
        const std::size_t index = tile_index({x, y});
        const auto offset =
            static_cast<std::size_t>(y - rect.y) * static_cast<std::size_t>(rect.width) +
            static_cast<std::size_t>(x - rect.x);
        std::uint8_t value = cells[offset];
        if (layer == Layer::kVisits) {
          value = std::max(value, tile.cells[index]);
        } else if (sequence > (*tile.sequences)[index]) {
          (*tile.sequences)[index] = sequence;
          change.touched = true;
          value = value != 0 ? 1 : 0;
        } else {
          continue;
        }
        if (value == tile.cells[index]) continue;
        set(tile, sums, key, index, value);
        change.changed = change.changed.united(Cell{x, y});
        change.touched = true;
      }
    }
    if (change.touched) changes.push_back(change);
  });
}

// Its tiles stay, empty: whoever was told of them has to be told that nothing is left.
void MapStore::forget(std::uint16_t robot, std::vector<TileChange>& changes) {
  const auto tiles = robots_.find(robot);
  if (tiles == robots_.end()) return;
  for (auto& [key, tile] : tiles->second) {
    TileChange change{key, {}, true};
    for (std::size_t i = 0; i < kTileCells; ++i) {
      if (tile.cells[i] == 0) continue;
      set(tile, sums_[key], key, i, 0);
      change.changed = change.changed.united(cell_of_tile_index(key, i));
    }
    changes.push_back(change);
  }
}

void MapStore::restore(std::uint16_t robot, const TileKey& key, RobotTile tile) {
  RobotTile& place = tile_for(robot, key);
  Sums& sums = sums_[key];
  for (std::size_t i = 0; i < kTileCells; ++i) set(place, sums, key, i, tile.cells[i]);
  place = std::move(tile);
  if (key.layer == Layer::kObstacles && !place.sequences) {
    place.sequences = std::make_unique<std::array<std::uint32_t, kTileCells>>();
  }
}

const RobotTile* MapStore::robot_tile(std::uint16_t robot, const TileKey& key) const {
  const auto tiles = robots_.find(robot);
  if (tiles == robots_.end()) return nullptr;
  const auto tile = tiles->second.find(key);
  return tile == tiles->second.end() ? nullptr : &tile->second;
}

std::uint8_t MapStore::robot_value(std::uint16_t robot, Layer layer, Cell cell) const {
  const RobotTile* tile = robot_tile(robot, key_of(layer, cell));
  return tile == nullptr ? std::uint8_t{0} : tile->cells[tile_index(cell)];
}

std::uint8_t MapStore::merged_value(Layer layer, Cell cell) const {
  const auto sums = sums_.find(key_of(layer, cell));
  return sums == sums_.end() ? std::uint8_t{0} : merged(layer, sums->second[tile_index(cell)]);
}

void MapStore::read_without(std::span<const std::uint16_t> robots, const TileKey& key,
                            const CellRect& rect, std::span<std::uint8_t> out) const {
  const auto sums = sums_.find(key);
  std::vector<const RobotTile*> without;
  for (const std::uint16_t robot : robots) {
    if (const RobotTile* tile = robot_tile(robot, key)) without.push_back(tile);
  }
  std::size_t i = 0;
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    for (std::int32_t x = rect.x; x < rect.right(); ++x) {
      const std::size_t index = tile_index({x, y});
      std::uint32_t sum = sums == sums_.end() ? 0 : sums->second[index];
      for (const RobotTile* tile : without) sum -= tile->cells[index];
      out[i++] = merged(key.layer, sum);
    }
  }
}

void MapStore::read_merged(const TileKey& key, std::span<std::uint8_t> out) const {
  const auto sums = sums_.find(key);
  for (std::size_t i = 0; i < kTileCells; ++i) {
    out[i] = sums == sums_.end() ? std::uint8_t{0} : merged(key.layer, sums->second[i]);
  }
}

std::set<TileKey> MapStore::tiles() const {
  std::set<TileKey> keys;
  for (const auto& entry : sums_) keys.insert(entry.first);
  return keys;
}

std::vector<TileKey> MapStore::tiles_of_others(std::uint16_t robot, const CellRect& window) const {
  std::vector<TileKey> keys;
  for (auto it = sums_.begin(); it != sums_.end();) {
    const TileKey& key = it->first;
    const CellRect tile = key.cells();
    if (tile.right() <= window.x) {  // on to the window's first column in this row of tiles
      it = sums_.lower_bound({key.layer, window.x >> 5, key.y});
    } else if (tile.x >= window.right()) {
      it = sums_.lower_bound({key.layer, window.x >> 5, key.y + 1});
    } else {
      const std::uint32_t own = robot_tile(robot, key) != nullptr ? 1 : 0;
      if (!tile.intersection(window).empty() && it->second.robots > own) keys.push_back(key);
      ++it;
    }
  }
  return keys;
}

const std::map<TileKey, RobotTile>* MapStore::robot_tiles(std::uint16_t robot) const {
  const auto tiles = robots_.find(robot);
  return tiles == robots_.end() ? nullptr : &tiles->second;
}

std::size_t MapStore::missing_tiles(std::uint16_t robot, Layer layer, const CellRect& rect) const {
  std::size_t missing = 0;
  for_each_tile(layer, rect, [&](const TileKey& key, const CellRect&) {
    missing += robot_tile(robot, key) == nullptr ? 1u : 0u;
  });
  return missing;
}

}  // namespace ivfm::host
