#include "host/log_analysis/run_summary.h"

#include <algorithm>
#include <map>

#include "firmware/supervisor/supervisor.h"
#include "firmware/supervisor/supervisor_table.h"

namespace ivfm::host {
namespace {

double seconds(std::int64_t time_us) { return static_cast<double>(time_us) / 1e6; }
std::uint64_t count(std::int64_t value) { return static_cast<std::uint64_t>(value); }
std::uint16_t robot_id(std::int64_t value) { return static_cast<std::uint16_t>(value); }

std::string state_name(std::int64_t state) {
  if (state < 0 || state >= static_cast<std::int64_t>(kRobotStates)) return "unknown";
  return supervisor_table::kStates[static_cast<std::size_t>(state)].name;
}

// The causes in a status message's `fault`, for people.
std::string fault_text(std::int64_t fault) {
  constexpr std::pair<StopReason, const char*> kTexts[] = {
      {StopReason::kLidarStale, "lidar silent"},
      {StopReason::kOdometryStale, "odometry silent"},
      {StopReason::kDriveLost, "wheel drive lost"},
      {StopReason::kStopCommand, "stop command"},
      {StopReason::kInternalError, "internal error"},
      {StopReason::kObstacle, "obstacle too near"},
  };
  std::string text;
  for (const auto& [reason, name] : kTexts) {
    if ((fault & static_cast<std::int64_t>(reason)) == 0) continue;
    text += (text.empty() ? "" : ", ") + std::string(name);
  }
  return text;
}

// Counters begin anew at every start of a robot: adds up what they gained.
class Gain {
 public:
  void take(std::uint64_t value) {
    total_ += value >= last_ ? value - last_ : value;
    last_ = value;
  }
  std::uint64_t total() const { return total_; }

 private:
  std::uint64_t last_ = 0, total_ = 0;
};

RobotSummary load_robot(SqliteConnection& connection, RobotSummary robot) {
  SqliteStatement rows(connection,
                       "SELECT state, actions, distance_mm, decision_us, retransmissions "
                       "FROM status WHERE robot = ? ORDER BY time_us");
  rows.bind(std::int64_t{robot.robot});
  Gain actions, distance_mm, retransmissions;
  while (rows.row()) {
    robot.last_state = state_name(rows.integer(0));
    actions.take(count(rows.integer(1)));
    distance_mm.take(count(rows.integer(2)));
    robot.slowest_decision_ms =
        std::max(robot.slowest_decision_ms, static_cast<double>(rows.integer(3)) / 1e3);
    retransmissions.take(count(rows.integer(4)));
  }
  robot.actions = actions.total();
  robot.driven_m = static_cast<double>(distance_mm.total()) / 1e3;
  robot.retransmissions = retransmissions.total();
  return robot;
}

std::vector<RobotSummary> load_robots(SqliteConnection& connection) {
  SqliteStatement rows(connection,
                       "SELECT robot, name, datagrams_in, bytes_in, datagrams_out, bytes_out "
                       "FROM robots ORDER BY robot");
  std::vector<RobotSummary> robots;
  while (rows.row()) {
    RobotSummary robot;
    robot.robot = robot_id(rows.integer(0));
    robot.name = rows.text(1);
    if (robot.name.empty()) robot.name = "robot " + std::to_string(robot.robot);
    robot.traffic = {count(rows.integer(2)), count(rows.integer(3)), count(rows.integer(4)),
                     count(rows.integer(5))};
    robots.push_back(load_robot(connection, robot));
  }
  return robots;
}

std::uint64_t count_nonzero(const std::vector<std::uint8_t>& cells) {
  return static_cast<std::uint64_t>(
      std::count_if(cells.begin(), cells.end(), [](auto value) { return value != 0; }));
}

}  // namespace

RunSummary summarize_run(const std::filesystem::path& database) {
  SqliteConnection connection = open_run_database(database);
  RunSummary run;
  const LayerMap merged = load_merged_map(database);
  run.cell_m = merged.cell_um / 1e6;
  run.time_s =
      seconds(connection.integer("SELECT value FROM meta WHERE key = 'time_us'").value_or(0));
  run.explored_cells = count_nonzero(merged.visits);
  run.obstacle_cells = count_nonzero(merged.obstacles);
  run.robots = load_robots(connection);
  std::vector<LayerMap> maps;
  for (const RobotSummary& robot : run.robots) {
    run.driven_m += robot.driven_m;
    maps.push_back(load_robot_map(database, robot.robot));
  }
  run.scores = score_maps(merged, maps, run.driven_m);
  SqliteStatement progress(connection,
                           "SELECT time_us, explored_cells FROM progress ORDER BY time_us");
  while (progress.row()) {
    run.progress.push_back({seconds(progress.integer(0)),
                            static_cast<double>(progress.integer(1)) * run.cell_m * run.cell_m});
  }
  return run;
}

std::vector<TimelineEntry> load_timeline(const std::filesystem::path& database) {
  SqliteConnection connection = open_run_database(database);
  std::vector<TimelineEntry> entries;
  SqliteStatement events(connection,
                         "SELECT time_us, robot, kind, detail FROM events ORDER BY time_us");
  while (events.row()) {
    TimelineEntry entry{seconds(events.integer(0)), std::nullopt, events.text(2)};
    if (!events.is_null(1)) entry.robot = robot_id(events.integer(1));
    if (const std::string detail = events.text(3); !detail.empty()) entry.text += ": " + detail;
    entries.push_back(std::move(entry));
  }
  SqliteStatement status(connection,
                         "SELECT time_us, robot, state, fault FROM status ORDER BY time_us");
  std::map<std::uint16_t, std::string> last;
  while (status.row()) {
    const std::uint16_t robot = robot_id(status.integer(1));
    std::string text = state_name(status.integer(2));
    if (const std::string fault = fault_text(status.integer(3)); !fault.empty()) {
      text += " (" + fault + ")";
    }
    if (last[robot] == text) continue;
    last[robot] = text;
    entries.push_back({seconds(status.integer(0)), robot, text});
  }
  std::stable_sort(entries.begin(), entries.end(),
                   [](const auto& a, const auto& b) { return a.time_s < b.time_s; });
  return entries;
}

std::vector<Trajectory> load_trajectories(const std::filesystem::path& database) {
  SqliteConnection connection = open_run_database(database);
  SqliteStatement rows(connection, "SELECT robot, x_um, y_um FROM poses ORDER BY robot, time_us");
  std::vector<Trajectory> trajectories;
  std::optional<std::int64_t> last;
  while (rows.row()) {
    if (last != rows.integer(0)) {
      last = rows.integer(0);
      trajectories.push_back({"robot " + std::to_string(*last), {}});
    }
    trajectories.back().points.push_back(
        {static_cast<std::int32_t>(rows.integer(1)), static_cast<std::int32_t>(rows.integer(2))});
  }
  return trajectories;
}

}  // namespace ivfm::host
