#include "host/map_server/map_reader.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <map>
#include <stdexcept>

#include "host/map_server/map_store.h"
#include "host/map_server/run_database.h"
#include "host/map_server/sqlite.h"
#include "shared/wire/map_dump.h"

namespace ivfm::host {
namespace {

LayerMap empty_map(std::int32_t cell_um, const CellRect& bounds) {
  const auto size = static_cast<std::size_t>(bounds.area());
  return {cell_um, bounds, std::vector<std::uint8_t>(size), std::vector<std::uint8_t>(size)};
}

void add_tile(LayerMap& map, const TileKey& key, std::span<const std::uint8_t> cells) {
  const GridFrame frame(1, map.bounds);
  const unsigned most = key.layer == Layer::kVisits ? 255 : 1;
  auto& layer = map.layer(key.layer);
  const CellRect rect = key.cells();
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    for (std::int32_t x = rect.x; x < rect.right(); ++x) {
      std::uint8_t& value = layer[frame.index_of({x, y})];
      value = static_cast<std::uint8_t>(std::min(most, 0u + value + cells[tile_index({x, y})]));
    }
  }
}

// Adds the tiles that `rows` yields (layer, tile_x, tile_y, cells) to a map.
LayerMap add_tiles(SqliteConnection& connection, const CellRect& bounds, SqliteStatement& rows) {
  LayerMap map =
      empty_map(static_cast<std::int32_t>(
                    connection.integer("SELECT value FROM meta WHERE key = 'cell_um'").value_or(0)),
                bounds);
  while (rows.row()) {
    const auto cells = rows.blob(3);
    if (cells.size() != kTileCells) throw std::runtime_error("run database: a tile is damaged");
    const TileKey key{static_cast<Layer>(rows.integer(0)),
                      static_cast<std::int32_t>(rows.integer(1)),
                      static_cast<std::int32_t>(rows.integer(2))};
    add_tile(map, key, cells);
  }
  return map;
}

CellRect tile_bounds(SqliteStatement& row) {
  if (!row.row() || row.is_null(0)) return {};
  const auto corner = [&row](int column) { return static_cast<std::int32_t>(row.integer(column)); };
  const CellRect low = TileKey{Layer::kVisits, corner(0), corner(1)}.cells();
  const CellRect high = TileKey{Layer::kVisits, corner(2), corner(3)}.cells();
  return low.united(high);
}

// Databases of earlier programs have no such table.
bool has_apart_tiles(SqliteConnection& connection) {
  return connection.integer("SELECT count(*) FROM sqlite_master WHERE name = 'apart_tiles'")
             .value_or(0) != 0;
}

std::set<std::uint16_t> apart_robots(SqliteConnection& connection) {
  std::set<std::uint16_t> robots;
  if (!has_apart_tiles(connection)) return robots;
  SqliteStatement rows(connection, "SELECT DISTINCT robot FROM apart_tiles");
  while (rows.row()) robots.insert(static_cast<std::uint16_t>(rows.integer(0)));
  return robots;
}

struct DumpRows final : MapRowSink {
  std::vector<std::uint8_t> rows[kLayerCount];
  void take_row(Layer layer, std::int32_t, std::span<const std::uint8_t> cells) override {
    auto& all = rows[static_cast<std::size_t>(layer)];
    all.insert(all.end(), cells.begin(), cells.end());
  }
};

const char* name_of(Layer layer) { return layer == Layer::kVisits ? "visits" : "obstacle"; }

// Collects differences between two values of a cell.
class Comparator {
 public:
  void check(const std::string& who, Layer layer, Cell cell, unsigned held, unsigned stored) {
    ++result.cells_compared;
    if (held == stored) return;
    ++result.cells_different;
    note(who + ", cell (" + std::to_string(cell.x) + ", " + std::to_string(cell.y) + "), " +
         name_of(layer) + ": robots hold " + std::to_string(held) + ", the server " +
         std::to_string(stored));
  }
  void note(const std::string& sentence) {
    if (result.first_difference.empty()) result.first_difference = sentence;
  }
  MapComparison result;
};

template <typename Visit>
void for_each_cell(const CellRect& rect, Visit visit) {
  for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
    for (std::int32_t y = rect.y; y < rect.top(); ++y) {
      for (std::int32_t x = rect.x; x < rect.right(); ++x) visit(layer, Cell{x, y});
    }
  }
}

}  // namespace

SqliteConnection open_run_database(const std::filesystem::path& database) {
  if (!std::filesystem::exists(database)) {
    throw std::runtime_error("run database '" + database.string() + "' does not exist");
  }
  if (std::filesystem::is_directory(database)) {
    throw std::runtime_error("run database '" + database.string() +
                             "' is a folder; right is a file such as run.db in it");
  }
  SqliteConnection connection(database, SqliteConnection::Mode::kRead);
  connection.execute("PRAGMA writable_schema = ON");  // else SQLite refuses a file that is cut off
  check_run_database(connection, database, false);
  return connection;
}

std::uint8_t LayerMap::value(Layer layer, Cell cell) const {
  if (!bounds.contains(cell)) return 0;
  const auto& cells = layer == Layer::kVisits ? visits : obstacles;
  return cells[GridFrame(1, bounds).index_of(cell)];
}

LayerMap load_merged_map(const std::filesystem::path& database) {
  SqliteConnection connection = open_run_database(database);
  SqliteStatement extent(connection,
                         "SELECT min(tile_x), min(tile_y), max(tile_x), max(tile_y) FROM tiles");
  SqliteStatement tiles(connection, "SELECT layer, tile_x, tile_y, cells FROM tiles");
  return add_tiles(connection, tile_bounds(extent), tiles);
}

LayerMap load_robot_map(const std::filesystem::path& database, std::uint16_t robot) {
  SqliteConnection connection = open_run_database(database);
  const bool apart = apart_robots(connection).contains(robot);
  const std::string where =
      std::string(apart ? " FROM apart_tiles" : " FROM tiles") + " WHERE robot = ?";
  SqliteStatement extent(
      connection, ("SELECT min(tile_x), min(tile_y), max(tile_x), max(tile_y)" + where).c_str());
  extent.bind(std::int64_t{robot});
  SqliteStatement tiles(connection, ("SELECT layer, tile_x, tile_y, cells" + where).c_str());
  tiles.bind(std::int64_t{robot});
  return add_tiles(connection, tile_bounds(extent), tiles);
}

LayerMap merged_map(const MapStore& store, std::int32_t cell_um) {
  const std::set<TileKey> tiles = store.tiles();
  CellRect bounds;
  for (const TileKey& key : tiles) bounds = bounds.united(key.cells());
  LayerMap map = empty_map(cell_um, bounds);
  std::array<std::uint8_t, kTileCells> cells;
  for (const TileKey& key : tiles) {
    store.read_merged(key, cells);
    add_tile(map, key, cells);
  }
  return map;
}

LayerMap robot_map(const MapStore& store, std::uint16_t robot, std::int32_t cell_um) {
  const auto* tiles = store.robot_tiles(robot);
  if (tiles == nullptr) return {};
  CellRect bounds;
  for (const auto& [key, tile] : *tiles) bounds = bounds.united(key.cells());
  LayerMap map = empty_map(cell_um, bounds);
  for (const auto& [key, tile] : *tiles) add_tile(map, key, tile.cells);
  return map;
}

std::set<std::uint16_t> load_apart_robots(const std::filesystem::path& database) {
  SqliteConnection connection = open_run_database(database);
  return apart_robots(connection);
}

std::vector<std::uint16_t> load_robot_ids(const std::filesystem::path& database) {
  SqliteConnection connection = open_run_database(database);
  SqliteStatement rows(connection, "SELECT robot FROM robots ORDER BY robot");
  std::vector<std::uint16_t> robots;
  while (rows.row()) robots.push_back(static_cast<std::uint16_t>(rows.integer(0)));
  return robots;
}

MapDump load_map_dump(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw std::runtime_error("map dump '" + file.string() + "' cannot be read");
  const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(stream),
                                        std::istreambuf_iterator<char>()};
  DumpRows rows;
  const auto header = read_map_dump(bytes, rows);
  if (!header.ok()) {
    throw std::runtime_error("map dump '" + file.string() +
                             "' is no proper dump: " + to_string(header.status()));
  }
  return {header->robot,
          header->epoch,
          {header->cell_um, header->window, std::move(rows.rows[0]), std::move(rows.rows[1])}};
}

MapComparison compare_with_dumps(const std::filesystem::path& database,
                                 const std::vector<std::filesystem::path>& dumps,
                                 const std::set<std::uint16_t>& crashed) {
  Comparator comparator;
  const LayerMap merged = load_merged_map(database);
  CellRect everything = merged.bounds;
  std::map<std::uint16_t, LayerMap> held;    // by the robots
  std::map<std::uint16_t, LayerMap> stored;  // by the server
  for (const std::uint16_t robot : load_robot_ids(database)) {
    stored[robot] = load_robot_map(database, robot);
  }
  const std::set<std::uint16_t> apart = load_apart_robots(database);
  for (const auto& file : dumps) {
    MapDump dump = load_map_dump(file);
    const std::string who = "robot " + std::to_string(dump.robot);
    if (!stored.contains(dump.robot)) comparator.note(who + " is not known to the server");
    if (merged.cell_um != 0 && dump.map.cell_um != merged.cell_um) {
      comparator.note(who + " has cells of another size than the server");
    }
    if (!apart.contains(dump.robot)) everything = everything.united(dump.map.bounds);
    if (!held.emplace(dump.robot, std::move(dump.map)).second) {
      comparator.note(who + " has two dumps");
    }
  }
  for (const auto& [robot, stored_map] : stored) {
    const LayerMap& map = stored_map;
    const std::string who = "robot " + std::to_string(robot);
    const auto dump = held.find(robot);
    if (dump == held.end()) {
      if (!crashed.contains(robot)) comparator.note(who + " has no dump");
      continue;
    }
    for_each_cell(dump->second.bounds, [&](Layer layer, Cell cell) {
      comparator.check(who, layer, cell, dump->second.value(layer, cell), map.value(layer, cell));
    });
  }
  for_each_cell(everything, [&](Layer layer, Cell cell) {
    unsigned sum = 0;
    for (const auto& [robot, map] : stored) {
      if (apart.contains(robot)) continue;
      // What has left a robot's window only the server still knows.
      const auto dump = held.find(robot);
      const bool in_dump = dump != held.end() && dump->second.bounds.contains(cell);
      sum += in_dump ? dump->second.value(layer, cell) : map.value(layer, cell);
    }
    const unsigned most = layer == Layer::kVisits ? 255 : 1;
    comparator.check("merged map", layer, cell, std::min(sum, most), merged.value(layer, cell));
  });
  comparator.result.explored_cells = static_cast<std::uint64_t>(
      std::count_if(merged.visits.begin(), merged.visits.end(), [](auto v) { return v != 0; }));
  return comparator.result;
}

}  // namespace ivfm::host
