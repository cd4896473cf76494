#include "host/demo/demo_run.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <stdexcept>
#include <utility>

#include "firmware/planning/explorer.h"
#include "host/cli/progress_line.h"
#include "host/cli/shipped_model.h"
#include "host/simulator/map_file.h"

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

constexpr std::int32_t kCellUm = 50'000;  // of profile `robot`

std::string text_of(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string bytes_text(std::uint64_t bytes) {
  return text_of("%.1f KiB", static_cast<double>(bytes) / 1024);
}

fs::path find_agent(const fs::path& given) {
  if (!given.empty()) return given;
  for (const fs::path& folder : folders_above(own_path())) {
    for (const char* path : {"ivfm-agent", "firmware/agent/linux/ivfm-agent"}) {
      if (fs::is_regular_file(folder / path)) return folder / path;
    }
  }
  throw std::runtime_error("the program ivfm-agent is not beside " + own_path().string() +
                           " nor in its build folder: build it, or give --agent PATH");
}

std::vector<Trajectory> true_paths(const std::vector<TruthRow>& truth) {
  std::map<int, Trajectory> by_robot;
  for (const TruthRow& row : truth) {
    Trajectory& trajectory = by_robot[row.robot];
    trajectory.label = "robot " + std::to_string(row.robot);
    const Point place{static_cast<std::int32_t>(std::lround(row.pose.x_m * 1e6)),
                      static_cast<std::int32_t>(std::lround(row.pose.y_m * 1e6))};
    if (trajectory.points.empty() || trajectory.points.back() != place) {
      trajectory.points.push_back(place);
    }
  }
  std::vector<Trajectory> out;
  for (auto& [robot, trajectory] : by_robot) out.push_back(std::move(trajectory));
  return out;
}

// The truth at the run's own times.
std::vector<TrueSample> samples_of(const std::vector<TruthRow>& truth, RunDatabase& database) {
  const auto micro = [](double metres) {
    return static_cast<std::int32_t>(std::lround(metres * 1e6));
  };
  std::vector<TrueSample> samples;
  for (const TruthRow& row : truth) {
    const std::int64_t time_us = database.time_at(row.unix_us);
    if (time_us < 0) continue;
    samples.push_back({time_us,
                       static_cast<std::uint16_t>(row.robot),
                       {{micro(row.pose.x_m), micro(row.pose.y_m)},
                        BinaryAngle::from_radians(row.pose.heading_rad)}});
  }
  return samples;
}

std::uint64_t sum(const std::vector<AgentReport>& agents, std::uint64_t AgentReport::*member) {
  return std::accumulate(
      agents.begin(), agents.end(), std::uint64_t{0},
      [member](std::uint64_t total, const AgentReport& agent) { return total + agent.*member; });
}

double driven_by(const std::vector<AgentReport>& agents) {
  double metres = 0;
  for (const AgentReport& agent : agents) metres += agent.driven_m;
  return metres;
}

std::uint64_t visits_in(const LayerMap& map) {
  return std::accumulate(map.visits.begin(), map.visits.end(), std::uint64_t{0});
}

std::vector<MapCell> ros_cells(const LayerMap& map) {
  std::vector<MapCell> cells;
  for (std::size_t i = 0; i < map.visits.size(); ++i) {
    const bool occupied = map.obstacles[i] != 0;
    cells.push_back(occupied            ? MapCell::kOccupied
                    : map.visits[i] > 0 ? MapCell::kFree
                                        : MapCell::kUnknown);
  }
  return cells;
}

// The log tools know only the database, this run's judge also the world and the agents' telemetry.
bool figures_agree(const DemoResult& result, const RunData& run) {
  const auto equal = [](double a, double b) { return std::abs(a - b) <= 1e-9 * std::abs(a); };
  const RunScores& mine = result.scores;
  return equal(mine.explored_m2, run.scores.explored_m2) &&
         equal(mine.repeat_rate, run.scores.repeat_rate) &&
         equal(mine.overlap, run.scores.overlap) &&
         equal(mine.pixels_per_metre, run.scores.pixels_per_metre) &&
         equal(mine.coverage, run.scores.coverage);
}

const char* yes_no(bool good) { return good ? "yes" : "NO"; }

}  // namespace

DemoRun::DemoRun(DemoOptions options, const std::atomic<bool>& interrupted)
    : options_(std::move(options)),
      interrupted_(interrupted),
      world_(prepare_world(options_.world)),
      meter_(world_.world, world_.starts.front().position, kCellUm),
      start_(std::chrono::steady_clock::now()) {
  for (const std::string& door : options_.doors) doors_.push_back(parse_door(door));
  static_cast<void>(Doors(world_.world, doors_));  // or they are refused at once
  for (const FleetEvent& event : options_.events) {
    if (event.robot > options_.world.robots) {
      throw std::invalid_argument("robot " + std::to_string(event.robot) +
                                  " cannot join, leave or crash: there are only " +
                                  std::to_string(options_.world.robots));
    }
    pending_.emplace(event.at_us, event);
  }
}

DemoResult DemoRun::run() {
  prepare_folder();
  Fleet fleet(fleet_options(), interrupted_);
  std::printf("%d robots explore %s (%.0f m2), goal: %s; %gx real time, into %s\n",
              options_.world.robots, world_.world.name.c_str(), explorable_m2(),
              goal_text().c_str(), options_.time_scale, options_.out.c_str());
  std::fflush(stdout);
  fleet.start();
  std::printf("live page %s\n", fleet.live_page().c_str());
  std::fflush(stdout);
  explore(fleet);
  fleet.end_radio_faults();
  std::printf("robots stop and hand over their maps\n");
  std::fflush(stdout);
  fleet.stop();
  DemoResult result = judge(fleet);
  save_outcome(result);
  const RunData run = load_run(options_.out / "run.db");
  result.figures_agree = figures_agree(result, run);
  result.pose_errors = over_all(run.pose_errors);
  write_report(result, write_pictures(result));
  print_table(result);
  return result;
}

// An earlier run's files would be taken for this one's.
void DemoRun::prepare_folder() const {
  std::error_code error;
  fs::create_directories(options_.out, error);
  std::ofstream probe(options_.out / "run.db");
  if (error || !probe) {
    throw std::runtime_error("folder " + options_.out.string() + " cannot be written");
  }
  probe.close();
  for (const char* name : {"run.db", "run.db-wal", "run.db-shm", "can.log", "truth.csv", "map.png",
                           "map.pgm", "map.yaml", "report.html", "keys", "logs", "lidars"}) {
    fs::remove_all(options_.out / name);
  }
  for (int robot = 1; robot <= 8; ++robot) {
    for (const char* kind : {".map", ".recording"}) {
      fs::remove(options_.out / ("robot" + std::to_string(robot) + kind));
    }
  }
}

FleetOptions DemoRun::fleet_options() const {
  FleetOptions fleet;
  fleet.ivfm = own_path();
  fleet.agent = find_agent(options_.agent);
  fleet.folder = options_.out;
  fleet.robots = options_.world.robots;
  fleet.time_scale = options_.time_scale;
  fleet.radio = options_.radio;
  fleet.rough_starts = options_.rough_starts;
  fleet.unknown_starts = options_.unknown_starts;
  fleet.seed = options_.world.seed;
  for (const FleetEvent& event : options_.events) {
    if (event.kind == FleetEvent::Kind::kJoin) fleet.late.push_back(event.robot);
  }
  fleet.simulator_arguments = {"--world",          options_.world.name,
                               "--seed",           std::to_string(options_.world.seed),
                               "--odometry-noise", options_.odometry_noise,
                               "--lidar-noise",    options_.lidar_noise,
                               "--walkers",        std::to_string(options_.walkers)};
  if (options_.world.resolution_m) {
    fleet.simulator_arguments.emplace_back("--resolution");
    fleet.simulator_arguments.emplace_back(text_of("%.9g", *options_.world.resolution_m));
  }
  if (options_.world.random_starts) fleet.simulator_arguments.emplace_back("--random-starts");
  for (const Pose& start : options_.world.starts) {
    fleet.simulator_arguments.push_back("--start=" + format_pose(start));
  }
  if (options_.record_scans) {
    fleet.simulator_arguments.insert(fleet.simulator_arguments.end(), {"--record", options_.out});
  }
  for (const std::string& door : options_.doors) {
    fleet.simulator_arguments.push_back("--door=" + door);
  }
  for (const std::string& fault : options_.faults) {
    fleet.simulator_arguments.emplace_back("--fault");
    fleet.simulator_arguments.emplace_back(fault);
  }
  fleet.agent_arguments = {"--profile",      "robot",
                           "--localization", options_.localization,
                           "--visit-range",  text_of("%.9g", options_.visit_range_m),
                           "--visit-fov",    text_of("%.9g", options_.visit_fov_deg),
                           "--goals",        options_.goals,
                           "--robot-radius", text_of("%.9g", world_.body.radius_m),
                           "--wheel-radius", text_of("%.9g", world_.body.wheel_radius_m),
                           "--wheel-base",   text_of("%.9g", world_.body.wheel_base_m)};
  fleet.server_arguments = {"--visit-range", text_of("%.9g", options_.visit_range_m),
                            "--explorable", text_of("%.9g", explorable_m2())};
  if (options_.policy == "qnet" && !options_.model.empty()) {
    fleet.server_arguments.emplace_back("--model");
    fleet.server_arguments.emplace_back(options_.model);
  }
  if (!options_.target.empty()) {
    fleet.agent_arguments.insert(fleet.agent_arguments.end(), {"--target", options_.target});
  }
  if (options_.policy == "qnet") {
    fleet.agent_arguments.emplace_back("--model");
    fleet.agent_arguments.emplace_back(options_.model.empty() ? shipped_model(".ivfm")
                                                              : options_.model);
  }
  return fleet;
}

double DemoRun::explorable_m2() const {
  return static_cast<double>(meter_.explorable_cells()) * (kCellUm / 1e6) * (kCellUm / 1e6);
}

double DemoRun::real_seconds() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

double DemoRun::simulated_seconds() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - exploring_since_)
             .count() *
         options_.time_scale;
}

// Until the goal is reached, nothing is left to do, or time is up.
void DemoRun::explore(Fleet& fleet) {
  exploring_since_ = std::chrono::steady_clock::now();
  while (!is_over(fleet)) {
    const auto next = std::chrono::steady_clock::now() + std::chrono::seconds(1);
    while (std::chrono::steady_clock::now() < next) {
      fleet.wait(milliseconds(100));
      apply_events(fleet);
    }
    progress_.push_back({simulated_seconds(), 0, driven_by(fleet.agents())});
    report_progress(fleet);
  }
}

// With a target: when every robot at work knows that it was found. Else when enough was seen.
bool DemoRun::is_over(const Fleet& fleet) {
  if (progress_.empty()) return false;
  const auto at_work_all = [&fleet](std::initializer_list<const char*> states) {
    return std::all_of(fleet.agents().begin(), fleet.agents().end(), [&](const AgentReport& agent) {
      return !agent.at_work || agent.leaving ||
             std::count(states.begin(), states.end(), agent.state) != 0;
    });
  };
  const bool waiting =
      !pending_.empty() ||
      std::any_of(fleet.agents().begin(), fleet.agents().end(),
                  [](const AgentReport& agent) { return agent.state == "starting"; });
  goal_reached_ = !waiting && (options_.target.empty() ? progress_.back().explored >= options_.until
                                                       : at_work_all({"found"}));
  const bool idle = !waiting && at_work_all({"explored", "stopped", "found"});
  return goal_reached_ || idle || progress_.back().time_s > options_.time_limit_s;
}

// What is due of the robots' joining, leaving and crashing.
void DemoRun::apply_events(Fleet& fleet) {
  const auto now_us = static_cast<TimeUs>(simulated_seconds() * 1e6);
  while (!pending_.empty() && pending_.begin()->first <= now_us) {
    const FleetEvent event = pending_.begin()->second;
    pending_.erase(pending_.begin());
    switch (event.kind) {
      case FleetEvent::Kind::kJoin:
        if (fleet.agents()[static_cast<std::size_t>(event.robot - 1)].at_work) {
          pending_.emplace(now_us + 1'000'000, event);  // it has not left yet
          break;
        }
        fleet.start_agent(event.robot, whereabouts(fleet, event.robot));
        note(fleet, event.robot, "joins");
        break;
      case FleetEvent::Kind::kLeave:
        fleet.dismiss_agent(event.robot);
        note(fleet, event.robot, "leaves");
        break;
      case FleetEvent::Kind::kCrash:
        fleet.kill_agent(event.robot);
        note(fleet, event.robot, "crashes");
        break;
    }
    if (event.again_us) {
      pending_.emplace(*event.again_us, FleetEvent{FleetEvent::Kind::kJoin, event.robot, 0, {}});
    }
  }
}

// A robot that is started again is told where it stands, as by who has switched it on.
std::string DemoRun::whereabouts(const Fleet& fleet, int robot) {
  if (fleet.agents()[static_cast<std::size_t>(robot - 1)].starts == 0) return {};
  std::string pose;
  for (const TruthRow& row : read_truth_log(fleet.truth())) {
    if (row.robot != robot) continue;
    pose = text_of("%.6f,", row.pose.x_m) + text_of("%.6f,", row.pose.y_m) +
           text_of("%.4f", row.pose.heading_rad * 180 / std::numbers::pi);
  }
  return pose;
}

void DemoRun::note(const Fleet& fleet, int robot, const char* what) {
  notes_.push_back({fleet.server_seconds(), robot, what});
  std::printf("%5.0f s  robot %d %s\n", simulated_seconds(), robot, what);
  std::fflush(stdout);
}

void DemoRun::report_progress(const Fleet& fleet) {
  const LayerMap merged = load_merged_map(fleet.database());
  ProgressPoint& now = progress_.back();
  now.explored = meter_.share_visited(merged);
  std::printf("%5.0f s  explored %5.1f %%  driven %6.1f m  %6llu visits  radio %s out, %s in",
              now.time_s, now.explored * 100, now.driven_m,
              static_cast<unsigned long long>(visits_in(merged)),
              bytes_text(sum(fleet.agents(), &AgentReport::bytes_sent)).c_str(),
              bytes_text(sum(fleet.agents(), &AgentReport::bytes_received)).c_str());
  if (now.explored > 0.02 && now.explored < options_.until) {
    const double left_s = now.time_s * (options_.until - now.explored) / now.explored;
    std::printf("  %s left", duration_text(left_s / options_.time_scale).c_str());
  }
  if (fleet.collisions() > 0) std::printf("  %d collisions", fleet.collisions());
  for (std::size_t i = 0; i < fleet.agents().size(); ++i) {
    const std::string& state = fleet.agents()[i].state;
    if (state != "exploring") std::printf("  [%zu %s]", i + 1, state.c_str());
  }
  std::printf("\n");
  std::fflush(stdout);
}

DemoResult DemoRun::judge(const Fleet& fleet) const {
  DemoResult result;
  result.goal_reached = goal_reached_;
  result.failure = fleet.failure();
  result.agents = fleet.agents();
  result.truth = read_truth_log(fleet.truth());
  std::map<int, TruthRow> last;
  for (const TruthRow& row : result.truth) last[row.robot] = row;
  for (const auto& [robot, row] : last) {
    result.driven_m += row.travelled_m;
    result.collisions += row.collisions;
  }
  result.simulated_s = progress_.empty() ? 0 : progress_.back().time_s;
  result.real_s = real_seconds();

  std::vector<fs::path> dumps;
  std::set<std::uint16_t> crashed;
  std::vector<LayerMap> robots;
  for (int robot = 1; robot <= options_.world.robots; ++robot) {
    if (fs::exists(fleet.map_dump(robot))) {
      dumps.push_back(fleet.map_dump(robot));
    } else if (fleet.agents()[static_cast<std::size_t>(robot - 1)].state == "crashed") {
      crashed.insert(static_cast<std::uint16_t>(robot));
    }
    robots.push_back(load_robot_map(fleet.database(), static_cast<std::uint16_t>(robot)));
  }
  if (result.failure.empty()) {
    result.comparison = compare_with_dumps(fleet.database(), dumps, crashed);
  } else {
    result.comparison.first_difference = "not compared, because a process failed";
  }
  const LayerMap merged = load_merged_map(fleet.database());
  result.scores = score_run(merged, robots, meter_, result.driven_m);
  result.ghost_cells = count_ghosts(merged, world_at(result.simulated_s));
  return result;
}

// With its doors as they are then.
World DemoRun::world_at(double simulated_s) const {
  World world = world_.world;
  Doors(world, doors_).step(static_cast<TimeUs>(simulated_s * 1e6), world, {}, 0);
  return world;
}

cv::Mat DemoRun::write_pictures(const DemoResult& result) const {
  const LayerMap merged = load_merged_map(options_.out / "run.db");
  if (merged.bounds.empty()) return {};
  PictureOptions picture;
  picture.title =
      std::to_string(options_.world.robots) + " robots explore the world " + world_.world.name;
  picture.subtitle = text_of("%.1f %% seen", result.scores.coverage * 100) +
                     text_of(" in %.0f s, ", result.simulated_s) +
                     text_of("%.1f m driven, ", result.driven_m) +
                     std::to_string(result.collisions) + " collisions, policy " + options_.policy;
  picture.world = &world_.world;
  std::vector<Trajectory> trajectories = true_paths(result.truth);
  const std::vector<Trajectory> told = trajectories_of(load_run(options_.out / "run.db"));
  for (std::size_t i = 0; i < std::min(told.size(), trajectories.size()); ++i) {
    trajectories[i].goals = told[i].goals;
  }
  const cv::Mat map = draw_map_picture(to_picture_layers(merged), trajectories, picture);
  write_png(options_.out / "map.png", map);
  write_map_file(options_.out / "map.yaml", GridFrame(merged.cell_um, merged.bounds),
                 ros_cells(merged));
  return map;
}

// What this run's judge knows and the server does not: so `ivfm log` reports the same figures.
void DemoRun::save_outcome(const DemoResult& result) const {
  RunDatabase database(options_.out / "run.db");
  database.begin();
  for (const Note& note : notes_) {
    database.add_event(static_cast<std::int64_t>(note.server_s * 1e6),
                       static_cast<std::uint16_t>(note.robot), note.what, "");
  }
  database.save_outcome("coverage", result.scores.coverage);
  database.save_outcome("explorable_m2", explorable_m2());
  database.save_outcome("driven_m", result.driven_m);
  database.save_outcome("collisions", result.collisions);
  database.save_outcome("rer", result.scores.repeat_rate);
  database.save_outcome("pe", result.scores.pixels_per_metre);
  database.save_outcome("overlap", result.scores.overlap);
  database.save_outcome("ghost_cells", static_cast<double>(result.ghost_cells));
  database.save_outcome("maps_equal", result.comparison.equal() ? 1 : 0);
  database.save_truth(samples_of(result.truth, database));
  database.commit();
}

std::string DemoRun::goal_text() const {
  return options_.target.empty() ? text_of("%.0f %% explored", options_.until * 100)
                                 : "found " + options_.target + ", and every robot knows it";
}

std::vector<Verdict> DemoRun::verdicts_of(const DemoResult& result) const {
  return {{result.goal_reached, goal_text()},
          {result.collisions == 0, std::to_string(result.collisions) + " collisions"},
          {result.comparison.equal(), result.comparison.equal()
                                          ? "server's map equals the sum of the robots' maps"
                                          : "maps differ: " + result.comparison.first_difference},
          {result.figures_agree, "the database gives the same figures"},
          {result.failure.empty(),
           result.failure.empty() ? "every process ended properly" : result.failure}};
}

void DemoRun::write_report(const DemoResult& result, const cv::Mat& map) const {
  ReportExtras extras;
  extras.title =
      std::to_string(options_.world.robots) + " robots explore the world " + world_.world.name;
  extras.subtitle =
      "Software in the loop: the robots' own program, a simulated lidar and "
      "simulated wheel drives each, and the real map server. Policy " +
      options_.policy + ", seed " + std::to_string(options_.world.seed) + ".";
  extras.verdicts = verdicts_of(result);
  extras.goal = options_.until;
  extras.files = {{"map.png", "the merged map as in this report"},
                  {"map.yaml, map.pgm", "the merged map for ROS map_server"},
                  {"run.db", "the run database of the map server (SQLite)"},
                  {"can.log", "every CAN frame, in candump's format"},
                  {"truth.csv", "where the robots really were, ten times a second"},
                  {"robotN.map", "what each robot held at the end"},
                  {"logs/", "what each process said"}};
  if (options_.record_scans) {
    extras.files.insert(extras.files.end() - 1,
                        {"robotN.recording", "what each lidar measured (ivfm log export)"});
  }
  extras.command = options_.command_line;
  const fs::path database = options_.out / "run.db";
  std::ofstream out(options_.out / "report.html");
  RunData run = load_run(database);
  const std::vector<TimelineEntry> timeline = load_timeline(database, run.warnings);
  out << render_run_report(run, timeline, map, extras);
  out.close();
  if (!out) {
    throw std::runtime_error((options_.out / "report.html").string() + " cannot be written");
  }
}

void DemoRun::print_table(const DemoResult& result) const {
  std::printf("\n%-9s %9s %8s %7s %10s %10s %10s\n", "robot", "driven", "actions", "scans",
              "radio out", "radio in", "decision");
  for (std::size_t i = 0; i < result.agents.size(); ++i) {
    const AgentReport& agent = result.agents[i];
    std::printf("%-9zu %7.1f m %8llu %7llu %10s %10s %7.1f ms\n", i + 1, agent.driven_m,
                static_cast<unsigned long long>(agent.actions),
                static_cast<unsigned long long>(agent.scans), bytes_text(agent.bytes_sent).c_str(),
                bytes_text(agent.bytes_received).c_str(), agent.slowest_decision_ms);
  }
  const RunScores& scores = result.scores;
  const double local_map_m = local_map_width_m(options_.visit_range_m, kCellUm);
  std::printf("\n%.1f %% explored in %.0f s, RER %.2f, PE %.0f, overlap %.1f %%\n",
              scores.coverage * 100, result.simulated_s, scores.repeat_rate,
              scores.pixels_per_metre, scores.overlap * 100);
  std::printf("PE as the paper's, with the local map's %.1f m as its 1 m: %.0f\n", local_map_m,
              scores.pixels_per_metre / local_map_m);
  const PoseErrors& errors = result.pose_errors;
  std::printf("robots believed to be %.3f m (rms) from where they were, %.3f m at most, %.2f deg\n",
              errors.rms_m, errors.largest_m, errors.rms_deg);
  std::printf("obstacle cells of the map where nothing is: %llu\n",
              static_cast<unsigned long long>(result.ghost_cells));
  std::printf("%s: %s\n", goal_text().c_str(), yes_no(result.goal_reached));
  std::printf("no collision: %s (%d)\n", yes_no(result.collisions == 0), result.collisions);
  std::printf("server's map is the sum of the robots' maps: %s (%llu cells compared)%s%s\n",
              yes_no(result.comparison.equal()),
              static_cast<unsigned long long>(result.comparison.cells_compared),
              result.comparison.equal() ? "" : ": ", result.comparison.first_difference.c_str());
  std::printf("the database gives the same figures: %s\n", yes_no(result.figures_agree));
  if (!result.failure.empty()) std::printf("failed: %s\n", result.failure.c_str());
  std::printf("\nmap     %s\nreport  %s\n", (options_.out / "map.png").c_str(),
              (options_.out / "report.html").c_str());
}

}  // namespace ivfm::host
