// One demonstration: a fleet explores a world until a goal is reached, then is judged and reported.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "host/demo/fleet.h"
#include "host/demo/fleet_event.h"
#include "host/demo/run_scores.h"
#include "host/log_analysis/run_report.h"
#include "host/map_server/map_reader.h"
#include "host/simulator/doors.h"
#include "host/simulator/truth_log.h"
#include "host/simulator/world_catalog.h"

namespace ivfm::host {

struct DemoOptions {
  WorldRequest world;
  std::string policy = "qnet";  // qnet or frontier-nearest
  std::filesystem::path model;  // of qnet; empty: the first in the source tree's models/
  std::filesystem::path agent;  // empty: beside this program
  std::filesystem::path out = "out/demo";
  double time_scale = 4;
  double until = 0.5;         // share of the explorable cells
  double time_limit_s = 400;  // simulated
  double visit_range_m = 3;
  double visit_fov_deg = 360;
  std::string goals = "views";            // or network
  std::string localization = "matching";  // or odometry
  std::string odometry_noise = "none";
  std::string lidar_noise = "mild";
  int walkers = 0;
  std::vector<std::string> doors;  // as of parse_door()
  std::vector<std::string> faults;
  bool record_scans = false;
  bool rough_starts = false;       // as in FleetOptions
  bool unknown_starts = false;     // as in FleetOptions
  std::string radio;               // faults between robots and server, as of ivfm radio
  std::vector<FleetEvent> events;  // robots that join late, leave or crash
  std::string target;              // X,Y in metres: seeing it is the goal; empty: none
  std::string command_line;        // for the report
};

// The fleet at one moment of the run.
struct ProgressPoint {
  double time_s = 0;    // simulated
  double explored = 0;  // share 0..1
  double driven_m = 0;
};

// How the run ended.
struct DemoResult {
  RunScores scores;
  std::vector<TruthRow> truth;
  std::vector<AgentReport> agents;
  MapComparison comparison;
  double driven_m = 0;
  int collisions = 0;
  double simulated_s = 0;
  double real_s = 0;
  bool goal_reached = false;
  bool figures_agree = false;     // with those that the log tools compute from the database
  std::uint64_t ghost_cells = 0;  // of the map's obstacles: nothing is there
  PoseErrors pose_errors;         // of all robots
  std::string failure;            // of a process, empty when all ended properly

  bool good() const {
    return goal_reached && collisions == 0 && comparison.equal() && figures_agree &&
           failure.empty();
  }
};

class DemoRun {
 public:
  // `interrupted` ends the run early, with Interrupted. Throws what prepare_world() throws, and
  // std::runtime_error when a file cannot be used.
  DemoRun(DemoOptions options, const std::atomic<bool>& interrupted);

  // Runs from start to report and prints as it goes.
  DemoResult run();

 private:
  void prepare_folder() const;
  FleetOptions fleet_options() const;
  void explore(Fleet& fleet);
  void apply_events(Fleet& fleet);
  static std::string whereabouts(const Fleet& fleet, int robot);
  void note(const Fleet& fleet, int robot, const char* what);
  bool is_over(const Fleet& fleet);
  double simulated_seconds() const;
  std::string goal_text() const;
  void report_progress(const Fleet& fleet);
  DemoResult judge(const Fleet& fleet) const;
  void save_outcome(const DemoResult& result) const;
  World world_at(double simulated_s) const;
  cv::Mat write_pictures(const DemoResult& result) const;
  std::vector<Verdict> verdicts_of(const DemoResult& result) const;
  void write_report(const DemoResult& result, const cv::Mat& map) const;
  void print_table(const DemoResult& result) const;
  double explorable_m2() const;
  double real_seconds() const;

  DemoOptions options_;
  const std::atomic<bool>& interrupted_;
  PreparedWorld world_;
  std::vector<Door> doors_;
  CoverageMeter meter_;
  std::vector<ProgressPoint> progress_;
  bool goal_reached_ = false;
  struct Note {
    double server_s;
    int robot;
    std::string what;
  };
  std::vector<Note> notes_;                    // for the database's events
  std::multimap<TimeUs, FleetEvent> pending_;  // by when they are due
  std::chrono::steady_clock::time_point exploring_since_;
  std::chrono::steady_clock::time_point start_;
};

}  // namespace ivfm::host
