#include "host/map_server/run_database.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "shared/wire/byte_reader.h"
#include "shared/wire/byte_writer.h"

namespace ivfm::host {
namespace {

constexpr const char* kSchema = R"sql(
BEGIN IMMEDIATE;
CREATE TABLE meta (
  key TEXT PRIMARY KEY,
  value INTEGER NOT NULL
) WITHOUT ROWID;
CREATE TABLE sessions (
  session INTEGER PRIMARY KEY,
  epoch INTEGER NOT NULL,
  started_unix_us INTEGER NOT NULL,
  ended_unix_us INTEGER,
  start_time_us INTEGER NOT NULL,
  time_scale REAL NOT NULL
);
CREATE TABLE robots (
  robot INTEGER PRIMARY KEY,
  name TEXT NOT NULL,
  epoch INTEGER NOT NULL,
  first_seen_us INTEGER NOT NULL,
  last_seen_us INTEGER NOT NULL,
  datagrams_in INTEGER NOT NULL,
  bytes_in INTEGER NOT NULL,
  datagrams_out INTEGER NOT NULL,
  bytes_out INTEGER NOT NULL,
  visit_bytes INTEGER NOT NULL,
  visit_cells INTEGER NOT NULL,
  obstacle_bytes INTEGER NOT NULL,
  obstacle_cells INTEGER NOT NULL
);
CREATE TABLE tiles (
  robot INTEGER NOT NULL,
  layer INTEGER NOT NULL,
  tile_x INTEGER NOT NULL,
  tile_y INTEGER NOT NULL,
  epoch INTEGER NOT NULL,
  cells BLOB NOT NULL,
  sequences BLOB,
  PRIMARY KEY (robot, layer, tile_x, tile_y)
);
CREATE TABLE first_seen (
  layer INTEGER NOT NULL,
  tile_x INTEGER NOT NULL,
  tile_y INTEGER NOT NULL,
  times BLOB NOT NULL,
  PRIMARY KEY (layer, tile_x, tile_y)
);
CREATE TABLE outcome (
  key TEXT PRIMARY KEY,
  value REAL NOT NULL
) WITHOUT ROWID;
CREATE TABLE poses (
  time_us INTEGER NOT NULL,
  robot INTEGER NOT NULL,
  x_um INTEGER NOT NULL,
  y_um INTEGER NOT NULL,
  heading INTEGER NOT NULL
);
CREATE TABLE goals (
  time_us INTEGER NOT NULL,
  robot INTEGER NOT NULL,
  cell_x INTEGER NOT NULL,
  cell_y INTEGER NOT NULL
);
CREATE TABLE status (
  time_us INTEGER NOT NULL,
  robot INTEGER NOT NULL,
  state INTEGER NOT NULL,
  fault INTEGER NOT NULL,
  uptime_ms INTEGER NOT NULL,
  actions INTEGER NOT NULL,
  distance_mm INTEGER NOT NULL,
  decision_us INTEGER NOT NULL,
  datagrams_sent INTEGER NOT NULL,
  retransmissions INTEGER NOT NULL
);
CREATE TABLE events (
  time_us INTEGER NOT NULL,
  robot INTEGER,
  kind TEXT NOT NULL,
  detail TEXT NOT NULL
);
CREATE TABLE traffic (
  time_us INTEGER NOT NULL,
  robot INTEGER NOT NULL,
  datagrams_in INTEGER NOT NULL,
  bytes_in INTEGER NOT NULL,
  datagrams_out INTEGER NOT NULL,
  bytes_out INTEGER NOT NULL,
  visit_bytes INTEGER NOT NULL,
  visit_cells INTEGER NOT NULL,
  obstacle_bytes INTEGER NOT NULL,
  obstacle_cells INTEGER NOT NULL
);
CREATE TABLE progress (
  time_us INTEGER NOT NULL,
  explored_cells INTEGER NOT NULL,
  obstacle_cells INTEGER NOT NULL
);
PRAGMA application_id = 1230390861;
PRAGMA user_version = 2;
COMMIT;
)sql";
static_assert(kRunDatabaseId == 1230390861);

#define IVFM_FORGET(table)                                                 \
  "DELETE FROM " table " WHERE rowid < coalesce((SELECT rowid FROM " table \
  " WHERE time_us >= ?1 ORDER BY rowid LIMIT 1), (SELECT max(rowid) + 1 FROM " table "))"
constexpr std::array kForgetSql{
    IVFM_FORGET("poses"),    IVFM_FORGET("goals"),
    IVFM_FORGET("status"),   IVFM_FORGET("traffic"),
    IVFM_FORGET("progress"), "DELETE FROM events WHERE time_us < ?1 AND kind <> 'found'",
};
#undef IVFM_FORGET

// As the table tiles, of robots that do not know where they are. Databases of earlier programs
// have no such table.
constexpr const char* kApartSchema =
    "CREATE TABLE IF NOT EXISTS apart_tiles (robot INTEGER NOT NULL, layer INTEGER NOT NULL, "
    "tile_x INTEGER NOT NULL, tile_y INTEGER NOT NULL, epoch INTEGER NOT NULL, "
    "cells BLOB NOT NULL, sequences BLOB, PRIMARY KEY (robot, layer, tile_x, tile_y))";
#define IVFM_SAVE_TILE(table)                                                  \
  "INSERT INTO " table                                                         \
  " VALUES (?, ?, ?, ?, ?, ?, ?) "                                             \
  "ON CONFLICT DO UPDATE SET epoch = excluded.epoch, cells = excluded.cells, " \
  "sequences = excluded.sequences"

std::runtime_error sentence(const std::filesystem::path& path, const std::string& what) {
  return std::runtime_error("run database '" + path.string() + "' " + what);
}

std::int64_t to_sql(std::uint64_t value) { return static_cast<std::int64_t>(value); }
std::uint64_t to_count(std::int64_t value) { return static_cast<std::uint64_t>(value); }

SqliteStatement& bind_traffic(SqliteStatement& insert, const TrafficCounters& traffic) {
  insert.bind(to_sql(traffic.datagrams_in))
      .bind(to_sql(traffic.bytes_in))
      .bind(to_sql(traffic.datagrams_out))
      .bind(to_sql(traffic.bytes_out));
  for (const LayerTraffic& layer : traffic.layers) {
    insert.bind(to_sql(layer.bytes)).bind(to_sql(layer.cells));
  }
  return insert;
}

// 1,024 numbers as little-endian u32.
void bind_u32s(SqliteStatement& insert, const std::array<std::uint32_t, kTileCells>& numbers) {
  std::array<std::uint8_t, kTileCells * 4> bytes;
  ByteWriter writer(bytes);
  for (const std::uint32_t number : numbers) writer.u32(number);
  insert.bind(std::span<const std::uint8_t>(bytes));
}

}  // namespace

RunDatabase::FileLock::FileLock(const std::filesystem::path& path)
    : fd_(path == ":memory:" ? -1 : ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644)) {
  if (path == ":memory:") return;
  if (fd_ < 0) throw sentence(path, std::string("cannot be written: ") + std::strerror(errno));
  if (::flock(fd_, LOCK_EX | LOCK_NB) == 0) return;
  ::close(fd_);
  throw sentence(path, "is in use by another map server; give this one a file of its own");
}

RunDatabase::FileLock::~FileLock() {
  if (fd_ >= 0) ::close(fd_);
}

void check_run_database(SqliteConnection& connection, const std::filesystem::path& path,
                        bool allow_empty) {
  std::int64_t id = 0, version = 0, tables = 0;
  try {
    id = connection.integer("PRAGMA application_id").value_or(0);
    version = connection.integer("PRAGMA user_version").value_or(0);
    tables = connection.integer("SELECT count(*) FROM sqlite_master").value_or(0);
  } catch (const DatabaseError& error) {
    if (error.code() != SQLITE_NOTADB && error.code() != SQLITE_CORRUPT) throw;
    throw sentence(path, error.code() == SQLITE_NOTADB
                             ? "is not a run database but another kind of file; choose another name"
                             : "is damaged beyond its first page; nothing of it can be read");
  }
  if (tables == 0 && id == 0 && allow_empty) return;
  if (id != kRunDatabaseId) {
    throw sentence(path, tables == 0 ? "is empty; 'ivfm serve' has not written it yet"
                                     : "is a database of another program; choose another name");
  }
  if (version != kRunDatabaseVersion) {
    throw sentence(path, "has schema version " + std::to_string(version) +
                             ", but this program knows only version " +
                             std::to_string(kRunDatabaseVersion));
  }
}

SqliteConnection RunDatabase::open_checked(const std::filesystem::path& path) {
  SqliteConnection connection(path, SqliteConnection::Mode::kWrite);
  check_run_database(connection, path, true);
  return connection;
}

RunDatabase::RunDatabase(const std::filesystem::path& path)
    : path_(path), lock_(path), connection_(open_checked(path)) {
  connection_.execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;");
  if (connection_.integer("SELECT count(*) FROM sqlite_master").value_or(0) == 0) {
    connection_.execute(kSchema);
  }
  connection_.execute(kApartSchema);
}

RunDatabase::~RunDatabase() = default;

// A statement prepared once; `sql` is a string literal, so its address identifies it.
SqliteStatement& RunDatabase::statement(const char* sql) {
  const auto found = statements_.find(sql);
  if (found != statements_.end()) return found->second;
  return statements_.try_emplace(sql, connection_, sql).first->second;
}

std::uint64_t RunDatabase::file_bytes() const {
  std::uint64_t sum = 0;
  for (const char* end : {"", "-wal"}) {
    std::error_code error;
    const auto size = std::filesystem::file_size(path_.string() + end, error);
    sum += error ? 0 : size;
  }
  return sum;
}

std::uint32_t RunDatabase::begin_session(std::int64_t unix_time_us, double time_scale) {
  const std::int64_t last = connection_.integer("SELECT max(epoch) FROM sessions").value_or(0);
  const std::int64_t epoch = std::max(last + 1, unix_time_us / 1000000);
  statement(
      "INSERT INTO sessions (epoch, started_unix_us, start_time_us, time_scale) "
      "VALUES (?, ?, ?, ?)")
      .bind(epoch)
      .bind(unix_time_us)
      .bind(last_time_us())
      .bind(time_scale)
      .run();
  return static_cast<std::uint32_t>(epoch);
}

void RunDatabase::end_session(std::int64_t unix_time_us) {
  statement(
      "UPDATE sessions SET ended_unix_us = ? WHERE session = (SELECT max(session) FROM "
      "sessions)")
      .bind(unix_time_us)
      .run();
}

std::vector<RobotRecord> RunDatabase::load_robots() {
  std::vector<RobotRecord> robots;
  SqliteStatement& rows = statement(
      "SELECT robot, name, epoch, first_seen_us, last_seen_us, datagrams_in, bytes_in, "
      "datagrams_out, bytes_out, visit_bytes, visit_cells, obstacle_bytes, obstacle_cells "
      "FROM robots ORDER BY robot");
  while (rows.row()) {
    RobotRecord robot;
    robot.robot = static_cast<std::uint16_t>(rows.integer(0));
    robot.name = rows.text(1);
    robot.epoch = static_cast<std::uint32_t>(rows.integer(2));
    robot.first_seen_us = rows.integer(3);
    robot.last_seen_us = rows.integer(4);
    robot.traffic = {to_count(rows.integer(5)),
                     to_count(rows.integer(6)),
                     to_count(rows.integer(7)),
                     to_count(rows.integer(8)),
                     {{{to_count(rows.integer(9)), to_count(rows.integer(10))},
                       {to_count(rows.integer(11)), to_count(rows.integer(12))}}}};
    robots.push_back(std::move(robot));
  }
  return robots;
}

void RunDatabase::load_tiles(MapStore& store) {
  load_tiles_of("SELECT robot, layer, tile_x, tile_y, epoch, cells, sequences FROM tiles",
                [&store](std::uint16_t) -> MapStore& { return store; });
}

void RunDatabase::load_apart(std::map<std::uint16_t, MapStore>& stores) {
  load_tiles_of("SELECT robot, layer, tile_x, tile_y, epoch, cells, sequences FROM apart_tiles",
                [&stores](std::uint16_t robot) -> MapStore& { return stores[robot]; });
}

// Puts each tile into the store that `place` names for its robot.
template <typename Place>
void RunDatabase::load_tiles_of(const char* sql, Place place) {
  SqliteStatement& rows = statement(sql);
  while (rows.row()) {
    const auto layer = rows.integer(1);
    const auto cells = rows.blob(5);
    if (layer < 0 || layer >= static_cast<std::int64_t>(kLayerCount) ||
        cells.size() != kTileCells) {
      throw DatabaseError("run database: a tile is damaged", SQLITE_CORRUPT);
    }
    const TileKey key{static_cast<Layer>(layer), static_cast<std::int32_t>(rows.integer(2)),
                      static_cast<std::int32_t>(rows.integer(3))};
    RobotTile tile;
    tile.epoch = static_cast<std::uint32_t>(rows.integer(4));
    std::copy(cells.begin(), cells.end(), tile.cells.begin());
    if (key.layer == Layer::kObstacles) {
      tile.sequences = std::make_unique<std::array<std::uint32_t, kTileCells>>();
      ByteReader reader(rows.blob(6));
      for (std::uint32_t& sequence : *tile.sequences) sequence = reader.u32();
    }
    const auto robot = static_cast<std::uint16_t>(rows.integer(0));
    place(robot).restore(robot, key, std::move(tile));
  }
}

std::map<TileKey, FirstSeen> RunDatabase::load_first_seen() {
  std::map<TileKey, FirstSeen> seen;
  SqliteStatement& rows = statement("SELECT layer, tile_x, tile_y, times FROM first_seen");
  while (rows.row()) {
    const TileKey key{static_cast<Layer>(rows.integer(0)),
                      static_cast<std::int32_t>(rows.integer(1)),
                      static_cast<std::int32_t>(rows.integer(2))};
    ByteReader reader(rows.blob(3));
    for (std::uint32_t& time : seen[key]) time = reader.u32();
  }
  return seen;
}

std::optional<std::int32_t> RunDatabase::cell_um() {
  const auto value = connection_.integer("SELECT value FROM meta WHERE key = 'cell_um'");
  if (!value) return std::nullopt;
  return static_cast<std::int32_t>(*value);
}

std::int64_t RunDatabase::last_time_us() {
  return connection_.integer("SELECT value FROM meta WHERE key = 'time_us'").value_or(0);
}

std::optional<std::uint16_t> RunDatabase::finder() {
  const auto robot =
      connection_.integer("SELECT robot FROM events WHERE kind = 'found' ORDER BY time_us LIMIT 1");
  if (!robot) return std::nullopt;
  return static_cast<std::uint16_t>(*robot);
}

void RunDatabase::begin() {
  begun_ = std::chrono::steady_clock::now();
  connection_.execute("BEGIN IMMEDIATE");
}

void RunDatabase::commit() {
  connection_.execute("COMMIT");
  commit_times_.add(
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun_).count());
}

void RunDatabase::rollback() { connection_.execute("ROLLBACK"); }

void RunDatabase::save_cell_um(std::int32_t cell_um) {
  statement("REPLACE INTO meta VALUES ('cell_um', ?)").bind(std::int64_t{cell_um}).run();
}

void RunDatabase::save_time(std::int64_t time_us) {
  statement("REPLACE INTO meta VALUES ('time_us', ?)").bind(time_us).run();
}

void RunDatabase::save_robot(const RobotRecord& robot) {
  SqliteStatement& insert =
      statement("REPLACE INTO robots VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(std::int64_t{robot.robot})
      .bind(std::string_view(robot.name))
      .bind(std::int64_t{robot.epoch})
      .bind(robot.first_seen_us)
      .bind(robot.last_seen_us);
  bind_traffic(insert, robot.traffic).run();
}

void RunDatabase::save_tile(std::uint16_t robot, const TileKey& key, const RobotTile& tile,
                            bool apart) {
  // Not REPLACE: the row stays where it is.
  SqliteStatement& insert =
      statement(apart ? IVFM_SAVE_TILE("apart_tiles") : IVFM_SAVE_TILE("tiles"));
  insert.bind(std::int64_t{robot})
      .bind(static_cast<std::int64_t>(key.layer))
      .bind(std::int64_t{key.x})
      .bind(std::int64_t{key.y})
      .bind(std::int64_t{tile.epoch})
      .bind(std::span<const std::uint8_t>(tile.cells));
  if (tile.sequences) {
    bind_u32s(insert, *tile.sequences);
    insert.run();
  } else {
    insert.bind_null().run();
  }
}

void RunDatabase::forget_apart(std::uint16_t robot) {
  statement("DELETE FROM apart_tiles WHERE robot = ?").bind(std::int64_t{robot}).run();
}

void RunDatabase::save_first_seen(const TileKey& key, const FirstSeen& seen) {
  SqliteStatement& insert = statement("REPLACE INTO first_seen VALUES (?, ?, ?, ?)");
  insert.bind(static_cast<std::int64_t>(key.layer))
      .bind(std::int64_t{key.x})
      .bind(std::int64_t{key.y});
  bind_u32s(insert, seen);
  insert.run();
}

void RunDatabase::save_outcome(std::string_view key, double value) {
  statement("REPLACE INTO outcome VALUES (?, ?)").bind(key).bind(value).run();
}

void RunDatabase::save_truth(std::span<const TrueSample> samples) {
  connection_.execute(
      "CREATE TABLE IF NOT EXISTS truth (robot INTEGER NOT NULL, time_us INTEGER NOT NULL, "
      "x_um INTEGER NOT NULL, y_um INTEGER NOT NULL, heading INTEGER NOT NULL, "
      "PRIMARY KEY (robot, time_us)) WITHOUT ROWID");
  for (const TrueSample& sample : samples) {
    statement("REPLACE INTO truth VALUES (?, ?, ?, ?, ?)")
        .bind(std::int64_t{sample.robot})
        .bind(sample.time_us)
        .bind(std::int64_t{sample.pose.position.x_um})
        .bind(std::int64_t{sample.pose.position.y_um})
        .bind(std::int64_t{sample.pose.heading.raw()})
        .run();
  }
}

std::int64_t RunDatabase::time_at(std::int64_t unix_time_us) {
  SqliteStatement newest(connection_,
                         "SELECT started_unix_us, start_time_us, time_scale FROM sessions "
                         "ORDER BY session DESC LIMIT 1");
  if (!newest.row()) return -1;
  const auto real_us = static_cast<double>(unix_time_us - newest.integer(0));
  return newest.integer(1) + static_cast<std::int64_t>(real_us * newest.real(2));
}

void RunDatabase::add_pose(std::int64_t time_us, std::uint16_t robot, const Pose& pose) {
  statement("INSERT INTO poses VALUES (?, ?, ?, ?, ?)")
      .bind(time_us)
      .bind(std::int64_t{robot})
      .bind(std::int64_t{pose.position.x_um})
      .bind(std::int64_t{pose.position.y_um})
      .bind(std::int64_t{pose.heading.raw()})
      .run();
}

void RunDatabase::add_goal(std::int64_t time_us, std::uint16_t robot, Cell goal) {
  statement("INSERT INTO goals VALUES (?, ?, ?, ?)")
      .bind(time_us)
      .bind(std::int64_t{robot})
      .bind(std::int64_t{goal.x})
      .bind(std::int64_t{goal.y})
      .run();
}

void RunDatabase::add_status(std::int64_t time_us, std::uint16_t robot, const RobotStatus& status) {
  statement("INSERT INTO status VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)")
      .bind(time_us)
      .bind(std::int64_t{robot})
      .bind(std::int64_t{status.state})
      .bind(std::int64_t{status.fault})
      .bind(std::int64_t{status.uptime_ms})
      .bind(std::int64_t{status.actions})
      .bind(std::int64_t{status.distance_mm})
      .bind(std::int64_t{status.decision_us})
      .bind(std::int64_t{status.datagrams_sent})
      .bind(std::int64_t{status.retransmissions})
      .run();
}

void RunDatabase::add_event(std::int64_t time_us, std::optional<std::uint16_t> robot,
                            std::string_view kind, std::string_view detail) {
  SqliteStatement& insert = statement("INSERT INTO events VALUES (?, ?, ?, ?)");
  insert.bind(time_us);
  if (robot) {
    insert.bind(std::int64_t{*robot});
  } else {
    insert.bind_null();
  }
  insert.bind(kind).bind(detail).run();
}

void RunDatabase::add_traffic(std::int64_t time_us, std::uint16_t robot,
                              const TrafficCounters& traffic) {
  SqliteStatement& insert = statement("INSERT INTO traffic VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(time_us).bind(std::int64_t{robot});
  bind_traffic(insert, traffic).run();
}

void RunDatabase::add_progress(std::int64_t time_us, std::uint64_t explored_cells,
                               std::uint64_t obstacle_cells) {
  statement("INSERT INTO progress VALUES (?, ?, ?)")
      .bind(time_us)
      .bind(to_sql(explored_cells))
      .bind(to_sql(obstacle_cells))
      .run();
}

// Rows are in the order of their times, so that only what goes is looked at.
void RunDatabase::forget_before(std::int64_t time_us) {
  for (const char* sql : kForgetSql) statement(sql).bind(time_us).run();
}

}  // namespace ivfm::host
