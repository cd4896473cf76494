#include "host/localization/localize_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "host/evaluation/text_table.h"
#include "host/localization/drive_recorder.h"
#include "host/localization/estimators.h"
#include "host/localization/recorded_map.h"
#include "host/simulator/rawlog_replay.h"

namespace ivfm::host {
namespace {

struct LocalizeOptions {
  std::vector<std::string> worlds{"corridor", "malaga"};
  std::vector<std::string> noises{"turtlebot"};
  std::vector<std::string> estimators{"odometry", "matching"};
  unsigned seeds = 20;
  double metres = 100;
  std::string logs;    // folder of recorded drives
  std::string errors;  // CSV
  std::string rawlog;  // instead of simulated drives
  std::string map;     // PNG
  bool sharpness = false;
  bool each = false;
  bool json = false;
};

// Of one estimator over all seeds of a world and a noise.
struct Summary {
  double square_m2 = 0, square_deg2 = 0;  // means over seeds
  double worst_rms_m = 0, max_m = 0, max_deg = 0, cpu_s = 0, drive_s = 0, driven_m = 0;
};

DriveLog drive(const LocalizeOptions& options, const std::string& world, unsigned seed,
               bool second_robot = false) {
  const DriveRequest request{world, seed, options.metres, second_robot};
  if (options.logs.empty()) return record_drive(request);
  const std::filesystem::path path =
      std::filesystem::path(options.logs) /
      (world + "-" + std::to_string(seed) + (second_robot ? "b-" : "-") + fixed(options.metres, 0) +
       ".drive");
  if (std::filesystem::exists(path)) return load_drive_log(path);
  std::filesystem::create_directories(options.logs);
  const DriveLog log = record_drive(request);
  save_drive_log(path, log);
  return log;
}

class Study {
 public:
  explicit Study(const LocalizeOptions& options) : options_(options) {
    if (options.errors.empty()) return;
    errors_.open(options.errors);
    if (!errors_) throw std::runtime_error("cannot write " + options.errors);
    errors_ << "world,noise,estimator,seed,time_s,position_m,heading_deg\n";
  }

  int run() {
    for (const std::string& world : options_.worlds) {
      for (const std::string& noise : options_.noises) run(world, noise);
    }
    std::fputs(options_.json ? (json_.dump(2) + "\n").c_str() : table_.to_text().c_str(), stdout);
    return 0;
  }

 private:
  void run(const std::string& world, const std::string& noise) {
    std::vector<Summary> summaries(options_.estimators.size());
    const SensorNoise sensors = SensorNoise::preset(noise);
    for (unsigned seed = 1; seed <= options_.seeds; ++seed) {
      const DriveLog log = with_noise(drive(options_, world, seed), sensors, seed);
      for (std::size_t i = 0; i < summaries.size(); ++i) {
        const std::string& name = options_.estimators[i];
        const auto estimator = make_estimator(name, log);
        const Assessment found = assess(log, *estimator);
        add(summaries[i], log, found);
        note(world, noise, name, seed, found);
      }
    }
    for (std::size_t i = 0; i < summaries.size(); ++i) {
      report(world, noise, options_.estimators[i], summaries[i]);
    }
  }

  void add(Summary& sum, const DriveLog& log, const Assessment& found) const {
    sum.square_m2 += found.rms_m * found.rms_m / options_.seeds;
    sum.square_deg2 += found.rms_deg * found.rms_deg / options_.seeds;
    sum.worst_rms_m = std::max(sum.worst_rms_m, found.rms_m);
    sum.max_m = std::max(sum.max_m, found.max_m);
    sum.max_deg = std::max(sum.max_deg, found.max_deg);
    sum.cpu_s += found.cpu_s;
    sum.drive_s += static_cast<double>(log.truth.back().time_us - log.truth[0].time_us) * 1e-6;
    sum.driven_m += log.driven_m;
  }

  void note(const std::string& world, const std::string& noise, const std::string& name,
            unsigned seed, const Assessment& found) {
    if (options_.each) {
      std::fprintf(stderr,
                   "%s %s %s seed %u: rms %.3f m %.2f deg, max %.3f m %.2f deg, %.2f s; %s\n",
                   world.c_str(), noise.c_str(), name.c_str(), seed, found.rms_m, found.rms_deg,
                   found.max_m, found.max_deg, found.cpu_s, found.remark.c_str());
    }
    if (!errors_.is_open()) return;
    for (const PoseError& e : found.errors) {
      errors_ << world << ',' << noise << ',' << name << ',' << seed << ',' << e.time_s << ','
              << e.position_m << ',' << e.heading_deg << '\n';
    }
  }

  void report(const std::string& world, const std::string& noise, const std::string& name,
              const Summary& sum) {
    const double rms_m = std::sqrt(sum.square_m2), rms_deg = std::sqrt(sum.square_deg2);
    const double cpu_percent = 100 * sum.cpu_s / sum.drive_s;
    table_.rows.push_back({{world},
                           {noise},
                           {name},
                           {fixed(rms_m, 3)},
                           {fixed(sum.worst_rms_m, 3)},
                           {fixed(sum.max_m, 3)},
                           {fixed(rms_deg, 2)},
                           {fixed(sum.max_deg, 2)},
                           {fixed(cpu_percent, 2)}});
    json_.push_back({{"world", world},
                     {"noise", noise},
                     {"estimator", name},
                     {"seeds", options_.seeds},
                     {"driven_m", sum.driven_m},
                     {"rms_m", rms_m},
                     {"worst_rms_m", sum.worst_rms_m},
                     {"max_m", sum.max_m},
                     {"rms_deg", rms_deg},
                     {"max_deg", sum.max_deg},
                     {"cpu_percent_of_drive", cpu_percent}});
  }

  LocalizeOptions options_;
  std::ofstream errors_;
  nlohmann::ordered_json json_ = nlohmann::ordered_json::array();
  TextTable table_{{"world", "noise", "estimator", "rms [m]", "worst rms", "max [m]", "rms [deg]",
                    "max [deg]", "CPU [%]"},
                   {}};
};

// The obstacle cells of all robots' maps together.
std::set<std::pair<std::int32_t, std::int32_t>> merged_obstacles(const std::vector<DriveLog>& logs,
                                                                 const std::string& estimator) {
  std::set<std::pair<std::int32_t, std::int32_t>> cells;
  for (const DriveLog& log : logs) {
    const auto robot = make_estimator(estimator, log);
    (void)assess(log, *robot);
    if (robot->map() == nullptr) {
      throw std::invalid_argument("estimator '" + estimator + "' has no map of its own");
    }
    const auto flags = robot->map()->layers().flags;
    for (std::size_t i = 0; i < flags.size(); ++i) {
      if ((flags[i] & cell_flag::kOwnObstacle) == 0) continue;
      const Cell cell = robot->map()->frame().cell_of_index(i);
      cells.emplace(cell.x, cell.y);
    }
  }
  return cells;
}

// Two robots in one frame: how many more cells do the walls of their merged map take than with
// true poses?
int compare_sharpness(const LocalizeOptions& options) {
  TextTable table{
      {"world", "noise", "estimator", "cells", "with true poses", "more [%]", "worst [%]"}, {}};
  for (const std::string& world : options.worlds) {
    for (const std::string& noise : options.noises) {
      for (const std::string& estimator : options.estimators) {
        double cells = 0, true_cells = 0, worst = -1;
        for (unsigned seed = 1; seed <= options.seeds; ++seed) {
          std::vector<DriveLog> logs;
          for (const bool second : {false, true}) {
            logs.push_back(with_noise(drive(options, world, seed, second),
                                      SensorNoise::preset(noise), 2 * seed + (second ? 1 : 0)));
          }
          const auto found = static_cast<double>(merged_obstacles(logs, estimator).size());
          const auto real = static_cast<double>(merged_obstacles(logs, "truth").size());
          cells += found;
          true_cells += real;
          worst = std::max(worst, found / real - 1);
        }
        table.rows.push_back({{world},
                              {noise},
                              {estimator},
                              {fixed(cells / options.seeds, 0)},
                              {fixed(true_cells / options.seeds, 0)},
                              {fixed(100 * (cells / true_cells - 1), 1)},
                              {fixed(100 * worst, 1)}});
      }
    }
  }
  std::fputs(table.to_text().c_str(), stdout);
  return 0;
}

// A real recording: nobody knows the truth, but walls show it.
int map_rawlog(const LocalizeOptions& options) {
  const DriveLog log = to_drive_log(load_rawlog(options.rawlog));
  std::vector<RecordedMap> maps;
  TextTable table{{"estimator", "obstacle cells", "known cells", "CPU [ms/scan]"}, {}};
  for (const std::string& name : options.estimators) {
    const RecordedMap& map = maps.emplace_back(map_of(log, name));
    table.rows.push_back(
        {{name},
         {std::to_string(map.obstacle_cells)},
         {std::to_string(map.known_cells)},
         {fixed(1000 * map.cpu_s / static_cast<double>(log.revolutions.size()), 2)}});
  }
  std::fputs(table.to_text().c_str(), stdout);
  if (!options.map.empty()) write_maps(options.map, maps);
  return 0;
}

}  // namespace

void add_localize_command(CLI::App& app, CommandAction& action) {
  auto options = std::make_shared<LocalizeOptions>();
  CLI::App* command = app.add_subcommand(
      "localize", "How far simulated robots are from where they believe to be, method by method");
  command->add_option("--world", options->worlds, "corridor, malaga")->capture_default_str();
  command->add_option("--noise", options->noises, "none, mild, turtlebot, harsh")
      ->capture_default_str();
  command
      ->add_option("--estimator", options->estimators,
                   "odometry, matching, matching-mcu, truth, icp-slam")
      ->capture_default_str();
  command->add_option("--seeds", options->seeds, "Drives in each world")
      ->check(CLI::Range(1u, 1000u))
      ->capture_default_str();
  command->add_option("--metres", options->metres, "Length of a drive")
      ->check(CLI::Range(1.0, 1000.0))
      ->capture_default_str();
  command->add_option("--logs", options->logs, "Keep recorded drives in this folder, and use them");
  command->add_option("--errors", options->errors, "Write every error, 10 a second, as CSV");
  auto* rawlog = command->add_option("--rawlog", options->rawlog,
                                     "An MRPT rawlog instead: how thin are the walls of its map?");
  command->add_option("--map", options->map, "Write the maps of --rawlog side by side as PNG")
      ->needs(rawlog);
  command
      ->add_flag(
          "--sharpness", options->sharpness,
          "Teams of two robots instead: occupied cells of their merged map, against the same "
          "drives with true poses")
      ->excludes(rawlog);
  command->add_flag("--each", options->each, "A line for each drive, on standard error");
  command->add_flag("--json", options->json, "Report as JSON");
  command->footer(
      "Example:\n  ivfm localize --noise turtlebot harsh --estimator odometry matching icp-slam\n"
      "All methods get the same recorded drives; CPU is a share of the time driven, on one core.");
  command->callback([options, &action] {
    action = [options] {
      if (options->sharpness) return compare_sharpness(*options);
      return options->rawlog.empty() ? Study(*options).run() : map_rawlog(*options);
    };
  });
}

}  // namespace ivfm::host
