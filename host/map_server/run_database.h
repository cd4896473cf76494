// The run database: everything a fleet did, in one SQLite file (docs/run_database.md).
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/map_server/map_store.h"
#include "host/map_server/sqlite.h"
#include "host/map_server/time_histogram.h"
#include "shared/geometry/pose.h"
#include "shared/wire/messages.h"

namespace ivfm::host {

inline constexpr std::int64_t kRunDatabaseId = 0x4956464d;  // "IVFM", PRAGMA application_id
inline constexpr std::int64_t kRunDatabaseVersion = 2;      // PRAGMA user_version

// What came from a robot of one layer: rectangles, with their heads.
struct LayerTraffic {
  std::uint64_t bytes = 0;
  std::uint64_t cells = 0;
  bool operator==(const LayerTraffic&) const = default;
};

// Since the run began. Bytes count 28 for the IP and UDP headers of each datagram.
struct TrafficCounters {
  std::uint64_t datagrams_in = 0;
  std::uint64_t bytes_in = 0;
  std::uint64_t datagrams_out = 0;
  std::uint64_t bytes_out = 0;
  std::array<LayerTraffic, kLayerCount> layers{};  // of bytes_in
  bool operator==(const TrafficCounters&) const = default;
};

// Of a tile's cells, in their order.
using FirstSeen = std::array<std::uint32_t, kTileCells>;

struct TrueSample {
  std::int64_t time_us = 0;
  std::uint16_t robot = 0;
  Pose pose;
};

struct RobotRecord {
  std::uint16_t robot = 0;
  std::string name;
  std::uint32_t epoch = 0;
  std::int64_t first_seen_us = 0;
  std::int64_t last_seen_us = 0;
  TrafficCounters traffic;
};

// Written by the map server alone; others read the file (map_reader.h) while it works. All methods
// throw DatabaseError. Times are microseconds since the run began, on the server's clock.
class RunDatabase {
 public:
  // Opens a run to go on with it, or creates it; ":memory:" is a run that is forgotten. Throws
  // std::runtime_error with one sentence when the file cannot be written, is not a run database, or
  // another server has it.
  explicit RunDatabase(const std::filesystem::path& path);
  ~RunDatabase();
  RunDatabase(const RunDatabase&) = delete;
  RunDatabase& operator=(const RunDatabase&) = delete;

  // A new start of the server: an epoch greater than every earlier one's, at least
  // `unix_time_us` in seconds. Durable when this returns.
  std::uint32_t begin_session(std::int64_t unix_time_us, double time_scale);
  void end_session(std::int64_t unix_time_us);

  // What is stored.
  std::vector<RobotRecord> load_robots();
  void load_tiles(MapStore& store);
  // The maps of robots that are kept apart.
  void load_apart(std::map<std::uint16_t, MapStore>& stores);
  // When each cell of the merged map was seen first, tenths of a second + 1; 0: not yet.
  std::map<TileKey, FirstSeen> load_first_seen();
  std::optional<std::int32_t> cell_um();
  std::int64_t last_time_us();
  std::optional<std::uint16_t> finder();

  // Between begin() and commit() the writes are one transaction: all durable or none.
  void begin();
  void commit();
  // Real time from begin() to the end of commit().
  const TimeHistogram& commit_times() const { return commit_times_; }
  // Of the file and its write-ahead log.
  std::uint64_t file_bytes() const;
  void rollback();
  void save_cell_um(std::int32_t cell_um);
  void save_time(std::int64_t time_us);
  void save_robot(const RobotRecord& robot);
  // `apart`: the robot's map frame is its own. A table for such tiles is there only after that.
  void save_tile(std::uint16_t robot, const TileKey& key, const RobotTile& tile,
                 bool apart = false);
  void forget_apart(std::uint16_t robot);
  void save_first_seen(const TileKey& key, const FirstSeen& seen);
  // What a judge who knows the world says of the run.
  void save_outcome(std::string_view key, double value);
  // Where the robots really were, told by the same judge; the table is there only after this.
  void save_truth(std::span<const TrueSample> samples);
  // The run's time in the newest session at a time of the wall clock; before the run began: < 0.
  std::int64_t time_at(std::int64_t unix_time_us);
  void add_pose(std::int64_t time_us, std::uint16_t robot, const Pose& pose);
  void add_goal(std::int64_t time_us, std::uint16_t robot, Cell goal);
  void add_status(std::int64_t time_us, std::uint16_t robot, const RobotStatus& status);
  void add_event(std::int64_t time_us, std::optional<std::uint16_t> robot, std::string_view kind,
                 std::string_view detail);
  void add_traffic(std::int64_t time_us, std::uint16_t robot, const TrafficCounters& traffic);
  void add_progress(std::int64_t time_us, std::uint64_t explored_cells,
                    std::uint64_t obstacle_cells);
  // Deletes what was added earlier than `time_us`, but for the find. The map stays. The file keeps
  // its size and is filled anew.
  void forget_before(std::int64_t time_us);

 private:
  // Keeps other servers out: a lock on the file, taken before and released after SQLite has it.
  class FileLock {
   public:
    explicit FileLock(const std::filesystem::path& path);
    ~FileLock();
    FileLock(const FileLock&) = delete;
    FileLock& operator=(const FileLock&) = delete;

   private:
    int fd_;
  };

  template <typename Place>
  void load_tiles_of(const char* sql, Place place);
  static SqliteConnection open_checked(const std::filesystem::path& path);
  SqliteStatement& statement(const char* sql);

  std::filesystem::path path_;
  std::chrono::steady_clock::time_point begun_{};
  TimeHistogram commit_times_;
  FileLock lock_;
  SqliteConnection connection_;
  std::map<const char*, SqliteStatement> statements_;
};

// Throws std::runtime_error with one sentence when `connection`'s file is not a run database that
// this build understands. An empty file passes when `allow_empty`.
void check_run_database(SqliteConnection& connection, const std::filesystem::path& path,
                        bool allow_empty);

}  // namespace ivfm::host
