// What a run's database tells about the fleet: figures, paths, and what happened when.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "host/demo/run_scores.h"
#include "host/log_analysis/map_picture.h"
#include "host/map_server/map_reader.h"
#include "host/map_server/run_database.h"

namespace ivfm::host {

struct RobotSummary {
  std::uint16_t robot = 0;
  std::string name;
  double driven_m = 0;  // by odometry, over all its starts
  std::uint64_t actions = 0;
  double slowest_decision_ms = 0;
  std::uint64_t retransmissions = 0;
  std::string last_state;
  TrafficCounters traffic;
};

struct ProgressRow {
  double time_s = 0;
  double explored_m2 = 0;
};

struct TimelineEntry {
  double time_s = 0;
  std::optional<std::uint16_t> robot;
  std::string text;
};

struct RunSummary {
  double time_s = 0;
  double cell_m = 0;
  std::uint64_t explored_cells = 0;
  std::uint64_t obstacle_cells = 0;
  double driven_m = 0;  // of all robots
  RunScores scores;     // but the coverage: that needs the world
  std::vector<RobotSummary> robots;
  std::vector<ProgressRow> progress;
};

// All throw std::runtime_error with one sentence when `database` is no run database.
RunSummary summarize_run(const std::filesystem::path& database);
// Starts, finds, refusals, and changes of the robots' states and faults, in the order of time.
std::vector<TimelineEntry> load_timeline(const std::filesystem::path& database);
// Where each robot went, in the order of their numbers.
std::vector<Trajectory> load_trajectories(const std::filesystem::path& database);

}  // namespace ivfm::host
