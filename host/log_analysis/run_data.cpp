#include "host/log_analysis/run_data.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include "firmware/supervisor/supervisor.h"
#include "firmware/supervisor/supervisor_table.h"

namespace ivfm::host {
namespace {

constexpr double kUnheardAfterS = 3;
constexpr double kMovingMPerS = 0.03, kTurningRadPerS = 0.1;
constexpr std::size_t kMostPathPoints = 20'000, kMostCurvePoints = 4'000;
constexpr std::int32_t kPathStepUm = 50'000;

double seconds(std::int64_t time_us) { return static_cast<double>(time_us) / 1e6; }
std::uint64_t count(std::int64_t value) { return static_cast<std::uint64_t>(value); }
std::uint16_t robot_id(std::int64_t value) { return static_cast<std::uint16_t>(value); }

std::string state_name(std::int64_t state) {
  if (state < 0 || state >= static_cast<std::int64_t>(kRobotStates)) return "unknown";
  return supervisor_table::kStates[static_cast<std::size_t>(state)].name;
}

bool has(std::uint8_t causes, StopReason reason) {
  return (causes & static_cast<unsigned>(reason)) != 0;
}

// Counters begin anew at every start of a robot: adds up what they gained.
class Gain {
 public:
  // Answers what was gained.
  std::uint64_t take(std::uint64_t value) {
    const std::uint64_t gained = value >= last_ ? value - last_ : value;
    last_ = value;
    total_ += gained;
    return gained;
  }
  std::uint64_t total() const { return total_; }

 private:
  std::uint64_t last_ = 0, total_ = 0;
};

// Adds evenly spread elements to a list: all, then every second, fourth ... so that it stays short.
class Selection {
 public:
  template <typename T>
  void add(std::vector<T>& list, std::size_t most, const T& value) {
    if (offered_++ % stride_ != 0) return;
    if (list.size() >= most) {
      std::size_t kept = 0;
      for (std::size_t i = 0; i < list.size(); i += 2) list[kept++] = list[i];
      list.resize(kept);
      stride_ *= 2;
    }
    list.push_back(value);
  }

 private:
  std::size_t stride_ = 1, offered_ = 0;
};

// Follows the robots through the rows of a run, which come in the order of time.
class RunReader {
 public:
  RunReader(const std::filesystem::path& database, const LoadProgress& progress)
      : path_(database), connection_(open_run_database(database)), progress_(progress) {
    run_.name = database.filename().string();
  }

  RunData read() {
    connection_.execute("BEGIN");  // one moment of a run that goes on
    warn_if_cut();
    attempt("its length", [this] { read_meta(); });
    attempt("its robots", [this] { read_robots(); });
    attempt("its sessions", [this] { read_sessions(); });
    attempt("its outcome", [this] { read_outcome(); });
    attempt("a part of its status messages", [this] { read_status(); });
    attempt("a part of its traffic", [this] { read_traffic(); });
    attempt("a part of its goals", [this] { read_goals(); });
    attempt("a part of its progress", [this] { read_progress(); });
    attempt("where its robots really were",
            [this] { run_.pose_errors = load_pose_errors(connection_, kMostCurvePoints); });
    attempt("a part of its map", [this] { read_tiles(); });
    finish();
    return std::move(run_);
  }

 private:
  struct Now {
    std::optional<double> last_s;
    std::optional<Pose> pose, pose_at_last;
    Gain actions, distance_mm, retransmissions, sent;
    double driven_m = 0;
    Selection path, driven, decisions, traffic, goals;
    std::uint64_t last_bytes = 0;
    double last_traffic_s = 0;
  };

  void warn_if_cut() {
    const std::filesystem::path wal = path_.string() + "-wal";
    std::error_code none;
    if (std::filesystem::exists(wal) && std::filesystem::file_size(wal, none) > 0) return;
    // As its head has it: SQLite itself counts the pages that are there.
    std::array<unsigned char, 32> head{};
    std::ifstream(path_, std::ios::binary).read(reinterpret_cast<char*>(head.data()), head.size());
    std::uint64_t pages = 0;
    for (std::size_t i = 28; i < 32; ++i) pages = pages << 8 | head[i];
    const auto expected = pages * count(connection_.integer("PRAGMA page_size").value_or(0));
    const std::uint64_t there = std::filesystem::file_size(path_);
    if (there >= expected) return;
    run_.warnings.push_back("the file is cut off: " + std::to_string(there) + " of " +
                            std::to_string(expected) + " bytes are there");
  }

  void attempt(const char* what, const std::function<void()>& work) {
    salvage(run_.warnings, what, work);
  }

  void report(std::int64_t time_us, double from, double to) {
    if (!progress_ || ++rows_ % 4096 != 0) return;
    const double share = run_.time_s > 0 ? std::min(1.0, seconds(time_us) / run_.time_s) : 1;
    progress_(static_cast<std::uint64_t>(from + (to - from) * share));
  }

  RobotRun& robot(std::uint16_t id) {
    const auto found = index_.find(id);
    if (found != index_.end()) return run_.robots[found->second];
    index_[id] = run_.robots.size();
    run_.robots.emplace_back().robot = id;
    run_.robots.back().name = "robot " + std::to_string(id);
    return run_.robots.back();
  }

  void read_meta() {
    const auto value = [this](const char* sql) {
      return static_cast<double>(connection_.integer(sql).value_or(0)) / 1e6;
    };
    run_.time_s = value("SELECT value FROM meta WHERE key = 'time_us'");
    run_.cell_m = value("SELECT value FROM meta WHERE key = 'cell_um'");
  }

  void read_robots() {
    SqliteStatement rows(connection_,
                         "SELECT robot, name, datagrams_in, bytes_in, datagrams_out, bytes_out, "
                         "visit_bytes, visit_cells, obstacle_bytes, obstacle_cells "
                         "FROM robots ORDER BY robot");
    while (rows.row()) {
      RobotRun& one = robot(robot_id(rows.integer(0)));
      if (const std::string name = rows.text(1); !name.empty()) one.name = name;
      one.traffic = {count(rows.integer(2)),
                     count(rows.integer(3)),
                     count(rows.integer(4)),
                     count(rows.integer(5)),
                     {{{count(rows.integer(6)), count(rows.integer(7))},
                       {count(rows.integer(8)), count(rows.integer(9))}}}};
    }
    SqliteStatement starts(connection_,
                           "SELECT robot, count(*) FROM events WHERE kind = 'started' GROUP BY 1");
    while (starts.row()) robot(robot_id(starts.integer(0))).starts = count(starts.integer(1));
  }

  void read_sessions() {
    SqliteStatement rows(connection_, "SELECT start_time_us, time_scale FROM sessions ORDER BY 1");
    while (rows.row()) {
      scales_.emplace_back(seconds(rows.integer(0)), rows.real(1));
    }
  }

  void read_outcome() {
    SqliteStatement rows(connection_, "SELECT key, value FROM outcome");
    while (rows.row()) {
      run_.outcome[rows.text(0)] = rows.real(1);
    }
  }

  double time_scale(double time_s) const {
    double scale = 1;
    for (const auto& [begin_s, value] : scales_) {
      if (begin_s <= time_s && value > 0) scale = value;
    }
    return scale;
  }

  // Status messages, with the poses up to each of them.
  void read_status() {
    SqliteStatement poses(connection_, "SELECT time_us, robot, x_um, y_um, heading FROM poses");
    SqliteStatement rows(connection_,
                         "SELECT time_us, robot, state, fault, actions, distance_mm, decision_us, "
                         "datagrams_sent, retransmissions, uptime_ms FROM status");
    bool more_poses = poses.row();
    while (rows.row()) {
      const std::int64_t time_us = rows.integer(0);
      for (; more_poses && poses.integer(0) <= time_us; more_poses = poses.row()) take_pose(poses);
      take_status(rows);
      report(time_us, 0, 70);
    }
    for (; more_poses; more_poses = poses.row()) take_pose(poses);
  }

  void take_pose(const SqliteStatement& row) {
    const std::uint16_t id = robot_id(row.integer(1));
    const Pose pose{
        {static_cast<std::int32_t>(row.integer(2)), static_cast<std::int32_t>(row.integer(3))},
        BinaryAngle(static_cast<std::uint16_t>(row.integer(4)))};
    now_[id].pose = pose;
    std::vector<Point>& path = robot(id).path;
    if (!path.empty() && std::abs(path.back().x_um - pose.position.x_um) < kPathStepUm &&
        std::abs(path.back().y_um - pose.position.y_um) < kPathStepUm) {
      return;
    }
    now_[id].path.add(path, kMostPathPoints, pose.position);
  }

  void take_status(const SqliteStatement& row) {
    const double time_s = seconds(row.integer(0));
    const std::uint16_t id = robot_id(row.integer(1));
    RobotRun& one = robot(id);
    Now& now = now_[id];
    const auto causes = static_cast<std::uint8_t>(row.integer(3));
    one.last_state = state_name(row.integer(2));
    const std::uint64_t new_actions = now.actions.take(count(row.integer(4)));
    const double moved_m = static_cast<double>(now.distance_mm.take(count(row.integer(5)))) / 1e3;
    now.sent.take(count(row.integer(7)));
    now.retransmissions.take(count(row.integer(8)));
    // A robot that was not heard from its start on says in its first message how long it has run.
    const double begin_s = std::max(0.0, time_s - static_cast<double>(row.integer(9)) / 1e3);
    if (!now.last_s && time_s - begin_s > kUnheardAfterS) {
      one.spans.push_back({begin_s, time_s, Activity::kUnheard, 0, {}});
    }
    if (now.last_s) {
      add_span(one, now, row.integer(2), causes, *now.last_s, time_s, moved_m);
    }
    now.last_s = time_s;
    run_.time_s = std::max(run_.time_s, time_s);
    now.pose_at_last = now.pose;
    now.driven_m += moved_m;
    add_driven(now, one.driven, time_s);
    if (new_actions == 0) return;
    const double ms = static_cast<double>(row.integer(6)) / 1e3 / time_scale(time_s);
    one.decisions_ms.push_back(static_cast<float>(ms));
    now.decisions.add(one.decisions, kMostCurvePoints, {time_s, ms});
  }

  // Standing is two points, however long.
  static void add_driven(Now& now, Curve& curve, double time_s) {
    const std::size_t size = curve.size();
    if (size >= 2 && curve[size - 1].second == now.driven_m &&
        curve[size - 2].second == now.driven_m) {
      curve.back().first = time_s;
    } else {
      now.driven.add(curve, kMostCurvePoints, {time_s, now.driven_m});
    }
  }

  void add_span(RobotRun& one, const Now& now, std::int64_t state, std::uint8_t causes,
                double begin_s, double end_s, double moved_m) {
    Span span{begin_s, end_s, Activity::kDriving, causes, {}};
    span.activity = activity_of(now, state, causes, end_s - begin_s, moved_m);
    const bool idle =
        span.activity == Activity::kStanding || span.activity == Activity::kHeldByObstacle;
    const bool goes_on = !one.spans.empty() && one.spans.back().activity == span.activity && !idle;
    if (goes_on) {
      span.blocker = one.spans.back().blocker;
    } else if (now.pose && (idle || span.activity == Activity::kDone)) {
      span.blocker = robot_near(one.robot, now.pose->position, end_s, idle ? kNearM : kInWayM);
      if (idle && span.blocker) span.activity = Activity::kHeldByRobot;
    }
    if (!one.spans.empty() && one.spans.back().activity == span.activity &&
        one.spans.back().blocker == span.blocker && one.spans.back().end_s == begin_s) {
      one.spans.back().end_s = end_s;
      one.spans.back().causes |= causes;
    } else {
      one.spans.push_back(span);
    }
  }

  static Activity activity_of(const Now& now, std::int64_t state, std::uint8_t causes,
                              double length_s, double moved_m) {
    if (length_s > kUnheardAfterS) return Activity::kUnheard;
    switch (static_cast<RobotState>(state)) {
      case RobotState::kFault: return Activity::kFault;
      case RobotState::kBoot:
      case RobotState::kReady: return Activity::kWaiting;
      case RobotState::kStopped: return Activity::kStopped;
      case RobotState::kExplored:
      case RobotState::kFound: return Activity::kDone;
      case RobotState::kExploring:
      case RobotState::kReturning: break;
    }
    if (moved_m > kMovingMPerS * length_s) return Activity::kDriving;
    if (now.pose && now.pose_at_last) {
      const double turned = std::abs(std::remainder(
          now.pose->heading.radians() - now.pose_at_last->heading.radians(), 2 * 3.14159265));
      if (turned > kTurningRadPerS * length_s) return Activity::kTurning;
    }
    return has(causes, StopReason::kObstacle) ? Activity::kHeldByObstacle : Activity::kStanding;
  }

  std::optional<std::uint16_t> robot_near(std::uint16_t id, Point place, double time_s,
                                          double within_m) const {
    std::optional<std::uint16_t> nearest;
    double least_um = within_m * 1e6;
    for (const auto& [other, now] : now_) {
      if (other == id || !now.pose || !now.last_s || time_s - *now.last_s > kUnheardAfterS)
        continue;
      const Point at = now.pose->position;
      const double distance_um = std::hypot(at.x_um - place.x_um, at.y_um - place.y_um);
      if (distance_um >= least_um) continue;
      least_um = distance_um;
      nearest = other;
    }
    return nearest;
  }

  void read_traffic() {
    SqliteStatement rows(connection_,
                         "SELECT time_us, robot, bytes_in + bytes_out, datagrams_in FROM traffic");
    while (rows.row()) {
      const double time_s = seconds(rows.integer(0));
      const std::uint16_t id = robot_id(rows.integer(1));
      Now& now = now_[id];
      const std::uint64_t bytes = count(rows.integer(2));
      const double length_s = time_s - now.last_traffic_s;
      Curve& curve = robot(id).kib_per_s;
      if (length_s > 0) {
        now.traffic.add(curve, kMostCurvePoints,
                        {time_s, static_cast<double>(bytes - now.last_bytes) / 1024 / length_s});
      }
      now.last_bytes = bytes;
      now.last_traffic_s = time_s;
      report(rows.integer(0), 70, 85);
    }
  }

  void read_goals() {
    SqliteStatement rows(connection_, "SELECT robot, cell_x, cell_y FROM goals");
    const auto cell_um = static_cast<std::int32_t>(std::lround(run_.cell_m * 1e6));
    if (cell_um == 0) return;
    while (rows.row()) {
      const std::uint16_t id = robot_id(rows.integer(0));
      now_[id].goals.add(robot(id).goals, kMostPathPoints,
                         GridFrame(cell_um, {})
                             .center_of({static_cast<std::int32_t>(rows.integer(1)),
                                         static_cast<std::int32_t>(rows.integer(2))}));
    }
  }

  void read_progress() {
    SqliteStatement rows(connection_, "SELECT time_us, explored_cells FROM progress");
    Selection progress;
    std::pair<double, double> last;
    while (rows.row()) {
      last = {seconds(rows.integer(0)),
              static_cast<double>(rows.integer(1)) * run_.cell_m * run_.cell_m};
      progress.add(run_.explored_m2, kMostCurvePoints, last);
    }
    if (!run_.explored_m2.empty()) run_.explored_m2.push_back(last);
  }

  // The merged map, and how many robots saw each cell (at most 2).
  void read_tiles() {
    SqliteStatement extent(connection_,
                           "SELECT min(tile_x), min(tile_y), max(tile_x), max(tile_y) FROM tiles");
    if (!extent.row() || extent.is_null(0)) return;
    const auto corner = [&](int column) {
      return TileKey{Layer::kVisits, static_cast<std::int32_t>(extent.integer(column)),
                     static_cast<std::int32_t>(extent.integer(column + 1))}
          .cells();
    };
    run_.map.cell_um = static_cast<std::int32_t>(std::lround(run_.cell_m * 1e6));
    run_.map.bounds = corner(0).united(corner(2));
    const GridFrame frame(1, run_.map.bounds);
    run_.map.visits.resize(frame.size());
    run_.map.obstacles.resize(frame.size());
    seers_.resize(frame.size());
    SqliteStatement rows(connection_, "SELECT layer, tile_x, tile_y, cells FROM tiles");
    const auto total = std::max<std::uint64_t>(
        1, count(connection_.integer("SELECT count(*) FROM tiles").value_or(0)));
    for (std::uint64_t done = 1; rows.row(); ++done) {
      add_tile(rows, frame);
      if (progress_) progress_(85 + 15 * std::min(done, total) / total);
    }
  }

  void add_tile(const SqliteStatement& row, const GridFrame& frame) {
    const auto cells = row.blob(3);
    if (cells.size() != kTileCells) throw DatabaseError("a tile is damaged", SQLITE_CORRUPT);
    const CellRect rect = TileKey{Layer::kVisits, static_cast<std::int32_t>(row.integer(1)),
                                  static_cast<std::int32_t>(row.integer(2))}
                              .cells();
    if (!run_.map.bounds.contains(rect)) throw DatabaseError("a tile is damaged", SQLITE_CORRUPT);
    const bool visits = row.integer(0) == 0;
    for (std::size_t i = 0; i < kTileCells; ++i) {
      if (cells[i] == 0) continue;
      const auto x = static_cast<std::int32_t>(i) % kTileSide;
      const auto y = static_cast<std::int32_t>(i) / kTileSide;
      const std::size_t at = frame.index_of({rect.x + x, rect.y + y});
      if (visits) {
        run_.map.visits[at] =
            static_cast<std::uint8_t>(std::min(255, run_.map.visits[at] + cells[i]));
        seers_[at] = static_cast<std::uint8_t>(std::min(2, seers_[at] + 1));
      } else {
        run_.map.obstacles[at] = 1;
      }
    }
  }

  void finish() {
    for (RobotRun& one : run_.robots) {
      Now& now = now_[one.robot];
      one.actions = now.actions.total();
      one.driven_m = static_cast<double>(now.distance_mm.total()) / 1e3;
      one.retransmissions = now.retransmissions.total();
      one.datagrams_sent = now.sent.total();
      if (one.datagrams_sent > one.traffic.datagrams_in) {
        one.lost = 1 - static_cast<double>(one.traffic.datagrams_in) /
                           static_cast<double>(one.datagrams_sent);
      }
      run_.driven_m += one.driven_m;
      one.driven.emplace_back(run_.time_s, now.driven_m);
      if (now.last_s && run_.time_s - *now.last_s > kUnheardAfterS) {
        one.spans.push_back({*now.last_s, run_.time_s, Activity::kUnheard, 0, {}});
      }
    }
    score_map(run_, seers_);
  }

  std::filesystem::path path_;
  SqliteConnection connection_;
  const LoadProgress& progress_;
  RunData run_;
  std::map<std::uint16_t, std::size_t> index_;
  std::map<std::uint16_t, Now> now_;
  std::vector<std::pair<double, double>> scales_;  // (from when, time scale)
  std::vector<std::uint8_t> seers_;
  std::uint64_t rows_ = 0;
};

}  // namespace

const char* to_string(Activity activity) {
  constexpr std::array<const char*, kActivities> kNames{"driving",
                                                        "turning",
                                                        "standing",
                                                        "held by an obstacle",
                                                        "another robot in the way",
                                                        "fault",
                                                        "waiting",
                                                        "stopped",
                                                        "done",
                                                        "not heard"};
  return kNames[static_cast<std::size_t>(activity)];
}

std::string fault_text(std::uint8_t fault) {
  constexpr std::pair<StopReason, const char*> kTexts[] = {
      {StopReason::kLidarStale, "lidar silent"},
      {StopReason::kOdometryStale, "odometry silent"},
      {StopReason::kDriveLost, "wheel drive lost"},
      {StopReason::kStopCommand, "stop command"},
      {StopReason::kInternalError, "internal error"},
      {StopReason::kObstacle, "obstacle too near"},
      {StopReason::kLost, "lost its place in the map"},
  };
  std::string text;
  for (const auto& [reason, name] : kTexts) {
    if (has(fault, reason)) text += (text.empty() ? "" : ", ") + std::string(name);
  }
  return text;
}

double RobotRun::time_in(Activity activity) const {
  double total = 0;
  for (const Span& span : spans) total += span.activity == activity ? span.length_s() : 0;
  return total;
}

std::uint64_t RunData::actions() const {
  std::uint64_t total = 0;
  for (const RobotRun& robot : robots) total += robot.actions;
  return total;
}

std::uint64_t RunData::wire_bytes() const {
  std::uint64_t total = 0;
  for (const RobotRun& robot : robots) total += robot.traffic.bytes_in + robot.traffic.bytes_out;
  return total;
}

double RunData::paper_bytes() const {
  constexpr double kStateBytes = 2.0 * 2 * 128 * 128, kPoseBytes = 6;
  double total = static_cast<double>(actions()) * (kStateBytes + 2 * kPoseBytes);
  for (const RobotRun& robot : robots) {
    for (const LayerTraffic& layer : robot.traffic.layers)
      total += static_cast<double>(layer.cells);
  }
  return total;
}

double RunData::judged(const std::string& key, double otherwise) const {
  const auto found = outcome.find(key);
  return found == outcome.end() ? otherwise : found->second;
}

void salvage(Warnings& warnings, const std::string& what, const std::function<void()>& work) {
  try {
    work();
  } catch (const DatabaseError& error) {
    if (error.code() != SQLITE_CORRUPT && error.code() != SQLITE_IOERR &&
        error.code() != SQLITE_NOTADB) {
      throw;
    }
    warnings.push_back(what + " cannot be read: the file is damaged");
  }
}

void score_map(RunData& run, std::span<const std::uint8_t> seers) {
  const double cell_m2 = run.cell_m * run.cell_m;
  double all_visits = 0, shared_cells = 0;
  for (std::size_t at = 0; at < run.map.visits.size(); ++at) {
    const unsigned visits = run.map.visits[at];
    run.obstacle_cells += run.map.obstacles[at];
    if (visits == 0) continue;
    ++run.explored_cells;
    all_visits += visits;
    shared_cells += at < seers.size() && seers[at] >= 2 ? 1 : 0;
    run.visits_m2[static_cast<std::size_t>(std::bit_width(visits - 1))] += cell_m2;
  }
  if (run.explored_cells == 0) return;
  const auto cells = static_cast<double>(run.explored_cells);
  run.scores.explored_m2 = cells * cell_m2;
  run.scores.repeat_rate = (all_visits - cells) / cells;
  run.scores.overlap = shared_cells / cells;
  run.scores.coverage = run.judged("coverage", 0);
  const double driven_m = run.judged("driven_m", run.driven_m);
  if (driven_m > 0) {
    run.scores.pixels_per_metre = run.scores.explored_m2 * kPixelsPerSquareMetre / driven_m;
  }
}

RunData load_run(const std::filesystem::path& database, const LoadProgress& progress) {
  return RunReader(database, progress).read();
}

namespace {

void read_events(SqliteConnection& connection, std::vector<TimelineEntry>& entries) {
  SqliteStatement events(connection, "SELECT time_us, robot, kind, detail FROM events");
  while (events.row()) {
    TimelineEntry entry{seconds(events.integer(0)), std::nullopt, events.text(2)};
    if (!events.is_null(1)) entry.robot = robot_id(events.integer(1));
    if (const std::string detail = events.text(3); !detail.empty()) entry.text += ": " + detail;
    entries.push_back(std::move(entry));
  }
}

void read_changes(SqliteConnection& connection, const LoadProgress& progress,
                  std::vector<TimelineEntry>& entries) {
  const std::int64_t end_us =
      connection.integer("SELECT value FROM meta WHERE key = 'time_us'").value_or(0);
  SqliteStatement status(connection, "SELECT time_us, robot, state, fault FROM status");
  std::map<std::uint16_t, std::string> last;
  for (std::size_t rows = 0; status.row(); ++rows) {
    if (progress && rows % 4096 == 0 && end_us > 0) {
      progress(count(100 * std::min(status.integer(0), end_us) / end_us));
    }
    const std::uint16_t robot = robot_id(status.integer(1));
    std::string text = state_name(status.integer(2));
    if (const std::string fault = fault_text(static_cast<std::uint8_t>(status.integer(3)));
        !fault.empty()) {
      text += " (" + fault + ")";
    }
    if (last[robot] == text) continue;
    last[robot] = text;
    entries.push_back({seconds(status.integer(0)), robot, text});
  }
}

}  // namespace

std::vector<TimelineEntry> load_timeline(const std::filesystem::path& database, Warnings& warnings,
                                         const LoadProgress& progress) {
  SqliteConnection connection = open_run_database(database);
  std::vector<TimelineEntry> entries;
  salvage(warnings, "a part of its events", [&] { read_events(connection, entries); });
  salvage(warnings, "a part of the changes of state",
          [&] { read_changes(connection, progress, entries); });
  std::stable_sort(entries.begin(), entries.end(),
                   [](const auto& a, const auto& b) { return a.time_s < b.time_s; });
  return entries;
}

std::vector<Trajectory> trajectories_of(const RunData& run) {
  std::vector<Trajectory> trajectories;
  for (const RobotRun& robot : run.robots) {
    trajectories.push_back({robot.name, robot.path, robot.goals});
  }
  return trajectories;
}

Curve thinned(const Curve& curve, std::size_t most) {
  if (curve.size() <= most) return curve;
  Curve out;
  const double step = static_cast<double>(curve.size()) / static_cast<double>(most);
  for (double at = 0; at < static_cast<double>(curve.size()); at += step) {
    out.push_back(curve[static_cast<std::size_t>(at)]);
  }
  out.back() = curve.back();
  return out;
}

double value_at(const Curve& curve, double time_s) {
  const auto after = std::upper_bound(curve.begin(), curve.end(), time_s,
                                      [](double t, const auto& point) { return t < point.first; });
  if (after == curve.begin()) return 0;
  const auto before = std::prev(after);
  if (after == curve.end()) return before->second;
  const double share = (time_s - before->first) / (after->first - before->first);
  return before->second + share * (after->second - before->second);
}

}  // namespace ivfm::host
