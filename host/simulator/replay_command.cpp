#include "host/simulator/replay_command.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

#include "firmware/agent/profile.h"
#include "firmware/nn/q_function.h"
#include "host/cli/progress_line.h"
#include "host/log_analysis/map_picture.h"
#include "host/quantizer/robot_model.h"
#include "host/simulator/rawlog_replay.h"
#include "host/simulator/recording_player.h"
#include "host/simulator/rplidar_terminal.h"

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

volatile std::sig_atomic_t g_interrupted = 0;

void on_signal(int) { g_interrupted = 1; }

struct CommandOptions {
  fs::path input;
  fs::path lidar;    // play on a pseudo-terminal
  fs::path map;      // write the fused map
  fs::path extract;  // write a recording
  fs::path model;
  double time_scale = 1;
  double visit_range_m = 3;
  ReplayOptions replay;
  bool json = false;
};

void handle_signals() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

Recording load(const CommandOptions& options) {
  return is_recording(options.input) ? read_recording(options.input) : load_rawlog(options.input);
}

// --- On a pseudo-terminal ---

// Time stands still at the first scan until somebody asks for scans.
int play(const CommandOptions& options, const Recording& recording) {
  using Clock = std::chrono::steady_clock;
  RplidarTerminal lidar(options.lidar);
  std::fprintf(stderr, "ivfm replay: lidar at %s, waiting for a scan request (Ctrl-C ends)\n",
               options.lidar.c_str());
  handle_signals();
  const Clock::time_point start = Clock::now();
  std::optional<TimeUs> first_us;
  std::size_t next = 0;
  ProgressLine progress(recording.scans.size(), "scans");
  while (g_interrupted == 0) {
    const double elapsed_us =
        std::chrono::duration<double, std::micro>(Clock::now() - start).count();
    const auto now_us = static_cast<TimeUs>(elapsed_us * options.time_scale);
    if (!first_us && lidar.emulator().scanning()) first_us = now_us;
    const TimeUs played_us = first_us ? now_us - *first_us : 0;
    for (; next < recording.scans.size() && recording.scans[next].time_us <= played_us; ++next) {
      lidar.emulator().set_revolution(full_turn(recording.scans[next]));
      progress(next + 1);
    }
    lidar.step(now_us);
    // The last scan is shown for a while, too.
    if (next == recording.scans.size() && played_us > recording.duration_us() + 500'000) return 0;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return 1;
}

// --- In process ---

PictureLayers picture_layers(const ExplorationMap& map) {
  PictureLayers layers{map.frame(), {}, {}};
  const std::size_t size = map.frame().size();
  layers.visits.reserve(size);
  layers.obstacles.reserve(size);
  for (std::size_t i = 0; i < size; ++i) {
    layers.visits.push_back(map.layers().own_visits[i]);
    layers.obstacles.push_back((map.layers().flags[i] & cell_flag::kObstacle) != 0);
  }
  return layers;
}

void draw_map(const CommandOptions& options, const Recording& recording, const Explorer& explorer,
              const ReplayResult& result) {
  Trajectory way{"odometry", {}};
  for (const RecordedScan& scan : recording.scans) way.points.push_back(scan.lidar_pose.position);
  char subtitle[160];
  std::snprintf(subtitle, sizeof subtitle, "%zu recorded scans over %.0f s, map hash %016llx",
                result.scans, static_cast<double>(recording.duration_us()) / 1e6,
                static_cast<unsigned long long>(result.map_hash));
  const Trajectory ways[] = {way};
  write_png(options.map, draw_map_picture(picture_layers(explorer.map()), ways,
                                          {recording.source, subtitle, nullptr, 2400}));
}

const char* kind_name(Decision::Kind kind) {
  switch (kind) {
    case Decision::Kind::kLocalGoal: return "local";
    case Decision::Kind::kGlobalGoal: return "global";
    case Decision::Kind::kReturn: return "return";
    case Decision::Kind::kExplored: return "explored";
  }
  return "unknown";
}

std::string hex(std::uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

Json report(const Recording& recording, const Explorer& explorer, const ReplayResult& result) {
  const GridFrame& frame = explorer.map().frame();
  std::size_t seen = 0, obstacles = 0;
  for (std::size_t i = 0; i < frame.size(); ++i) {
    seen += explorer.map().layers().own_visits[i] != 0;
    obstacles += (explorer.map().layers().flags[i] & cell_flag::kObstacle) != 0;
  }
  const double cell_m = frame.cell_um() / 1e6;
  Json goals = Json::array();
  for (const ReplayGoal& goal : result.goals) {
    const Point p = frame.center_of(goal.decision.goal);
    goals.push_back({{"scan", goal.scan},
                     {"kind", kind_name(goal.decision.kind)},
                     {"x_m", p.x_um / 1e6},
                     {"y_m", p.y_um / 1e6}});
  }
  return {{"source", recording.source},
          {"scans", result.scans},
          {"points", result.points},
          {"duration_s", static_cast<double>(recording.duration_us()) / 1e6},
          {"cell_m", cell_m},
          {"seen_m2", static_cast<double>(seen) * cell_m * cell_m},
          {"obstacle_cells", obstacles},
          {"map_hash", hex(result.map_hash)},
          {"goals_hash", hex(result.goals_hash)},
          {"lidar_bytes", result.lidar.bytes},
          {"lidar_resyncs", result.lidar.resyncs},
          {"lidar_dropped_frames", result.lidar.dropped_frames},
          {"goals", goals}};
}

void print(const Json& json) {
  for (const auto& [key, value] : json.items()) {
    if (key != "goals") std::printf("%-22s %s\n", key.c_str(), value.dump().c_str());
  }
  for (const Json& goal : json["goals"]) {
    std::printf("goal after scan %-5d %-9s %8.3f m %8.3f m\n", goal["scan"].get<int>(),
                goal["kind"].get<std::string>().c_str(), goal["x_m"].get<double>(),
                goal["y_m"].get<double>());
  }
}

int fuse(const CommandOptions& options, const Recording& recording) {
  handle_signals();
  const auto explorer = std::make_unique<ExplorerFor<RobotProfile>>(ExplorerConfig::lidar(
      static_cast<std::int32_t>(options.visit_range_m * 1e6), RobotProfile::kCellUm));
  NoPolicy no_policy;
  const auto model = options.model.empty() ? nullptr : std::make_unique<RobotModel>(options.model);
  QFunction& policy = model ? static_cast<QFunction&>(model->network()) : no_policy;
  ProgressLine line(recording.scans.size(), "scans");
  const auto progress = [&](std::size_t done) {
    line(done);
    return g_interrupted == 0;
  };
  const ReplayResult result = replay(recording, *explorer, policy, options.replay, progress);
  if (g_interrupted != 0) return 1;
  const Json json = report(recording, *explorer, result);
  if (options.json) {
    std::printf("%s\n", json.dump(2).c_str());
  } else {
    print(json);
  }
  if (!options.map.empty()) draw_map(options, recording, *explorer, result);
  return 0;
}

int run(const CommandOptions& options) {
  const Recording recording = load(options);
  if (!recording.warning.empty()) {
    std::fprintf(stderr, "ivfm replay: warning: %s\n", recording.warning.c_str());
  }
  if (!options.extract.empty()) write_recording(options.extract, recording);
  if (!options.lidar.empty()) return play(options, recording);
  return fuse(options, recording);
}

}  // namespace

void add_replay_command(CLI::App& app, CommandAction& action) {
  auto options = std::make_shared<CommandOptions>();
  CLI::App* command = app.add_subcommand(
      "replay", "A recorded drive as RPLIDAR bytes: fused into a map, or on a pseudo-terminal");
  command->add_option("file", options->input, "An MRPT rawlog, or a recording (--extract)")
      ->required();
  auto* lidar = command->add_option(
      "--lidar", options->lidar,
      "Play at the recorded pace on a pseudo-terminal, linked here; a robot's lidar path");
  command
      ->add_option("--time-scale", options->time_scale, "How much faster than recorded (--lidar)")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  command->add_option("--map", options->map, "Write the fused map as PNG")->excludes(lidar);
  command->add_option("--model", options->model,
                      "Policy model that chooses the goals; without it the nearest frontier");
  command
      ->add_option("--goal-every", options->replay.scans_per_goal,
                   "Scans of an action, at whose end a goal is computed and logged")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_option("--visit-range", options->visit_range_m, "Range that counts as seen, in m")
      ->check(CLI::Range(0.1, 12.0))
      ->capture_default_str();
  command->add_option("--extract", options->extract,
                      "Write the scans and poses as a small recording that needs no MRPT");
  command->add_flag("--json", options->json, "Report as JSON");
  command->footer(
      "Example:\n  ivfm replay \"/usr/share/mrpt/datasets/2006-01ENE-21-SENA_Telecom "
      "Faculty_one_loop_only.rawlog\" --map map.png --json\n"
      "The recording steers itself: goals are computed and logged, nobody drives there.");
  command->callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace ivfm::host
