// Maps out of a run database, and their comparison with what the robots held.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "host/map_server/map_store.h"
#include "host/map_server/sqlite.h"
#include "shared/geometry/grid_frame.h"
#include "shared/wire/layer.h"

namespace ivfm::host {

// Both layers of a map in a rectangle of cells that bounds what is known.
struct LayerMap {
  std::int32_t cell_um = 0;
  CellRect bounds;                      // empty when nothing is known
  std::vector<std::uint8_t> visits;     // row by row from the lowest; counts
  std::vector<std::uint8_t> obstacles;  // the same; 0 or 1

  // 0 outside the bounds.
  std::uint8_t value(Layer layer, Cell cell) const;
  std::vector<std::uint8_t>& layer(Layer layer) {
    return layer == Layer::kVisits ? visits : obstacles;
  }
};

// All throw std::runtime_error with one sentence when `database` is no run database. It may be in
// use by a server at the same time.

// To ask it something; nothing can be written. Of a file that is cut off, what is there can be
// read; the rest throws DatabaseError (SQLITE_CORRUPT).
SqliteConnection open_run_database(const std::filesystem::path& database);
// What the fleet saw: visits summed (at most 255), obstacles of any robot.
LayerMap load_merged_map(const std::filesystem::path& database);
// What one robot saw, in a frame of its own while it is apart; empty bounds when it is not known.
LayerMap load_robot_map(const std::filesystem::path& database, std::uint16_t robot);
// The same of a server's memory; `cell_um` of its run.
LayerMap merged_map(const MapStore& store, std::int32_t cell_um);
LayerMap robot_map(const MapStore& store, std::uint16_t robot, std::int32_t cell_um);
// The robots whose maps are no part of the merged map: where their frames lie is not known.
std::set<std::uint16_t> load_apart_robots(const std::filesystem::path& database);
// The robots of the run, in order.
std::vector<std::uint16_t> load_robot_ids(const std::filesystem::path& database);

// A robot's map dump (shared/wire/FORMAT.md). Throws std::runtime_error when it is damaged.
struct MapDump {
  std::uint16_t robot = 0;
  std::uint32_t epoch = 0;
  LayerMap map;
};
MapDump load_map_dump(const std::filesystem::path& file);

struct MapComparison {
  std::uint64_t cells_compared = 0;  // cells of either layer, over all robots and the merged map
  std::uint64_t cells_different = 0;
  std::uint64_t explored_cells = 0;  // of the merged map
  std::string first_difference;      // a sentence for people
  bool equal() const { return cells_different == 0 && first_difference.empty(); }
};

// Whether the server holds, cell for cell in every dump's window, what the robot held, and whether
// the merged map is the sum over the robots. A robot without a dump, or a dump without a robot, is
// a difference too; but robots that have `crashed` have no dump. Throws as above.
MapComparison compare_with_dumps(const std::filesystem::path& database,
                                 const std::vector<std::filesystem::path>& dumps,
                                 const std::set<std::uint16_t>& crashed = {});

}  // namespace ivfm::host
