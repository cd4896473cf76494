#include "host/demo/rehearse_command.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "firmware/agent/profile.h"
#include "host/cli/progress_line.h"
#include "host/cli/shipped_model.h"
#include "host/demo/rehearsal.h"
#include "host/demo/run_options.h"
#include "host/environment/parallel.h"
#include "host/quantizer/robot_model.h"

namespace ivfm::host {
namespace {

std::atomic<bool> g_interrupted{false};

void on_signal(int) { g_interrupted = true; }

struct CommandOptions {
  RehearsalOptions rehearsal;
  std::filesystem::path model;
  std::string odometry = "turtlebot", lidar = "mild", goals = "views", localization = "matching";
  int episodes = 10;
  int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
};

struct Column {
  const char* name;
  int digits;
  double (*value)(const RehearsalResult& result, double width_m);
};

constexpr Column kColumns[] = {
    {"steps", 1, [](const RehearsalResult& r, double) { return double{1} * r.actions; }},
    {"RER", 3, [](const RehearsalResult& r, double) { return r.scores.repeat_rate; }},
    {"PE", 0,
     [](const RehearsalResult& r, double width_m) { return r.scores.pixels_per_metre / width_m; }},
    {"overlap", 3, [](const RehearsalResult& r, double) { return r.scores.overlap; }},
    {"coverage", 3, [](const RehearsalResult& r, double) { return r.scores.coverage; }},
    {"seconds", 0, [](const RehearsalResult& r, double) { return r.simulated_s; }},
    {"metres", 1, [](const RehearsalResult& r, double) { return r.driven_m; }},
    {"contacts", 1, [](const RehearsalResult& r, double) { return double{1} * r.collisions; }},
    {"off rms (m)", 3, [](const RehearsalResult& r, double) { return r.rms_error_m; }},
    {"off at most", 3, [](const RehearsalResult& r, double) { return r.largest_error_m; }},
};

void print_row(const std::string& name, const std::vector<double>& values) {
  std::printf("%-10s", name.c_str());
  for (std::size_t i = 0; i < values.size(); ++i)
    std::printf(" %11.*f", kColumns[i].digits, values[i]);
  std::printf("\n");
}

void print(const std::vector<RehearsalResult>& results, const CommandOptions& options) {
  const double width_m =
      local_map_width_m(options.rehearsal.agent.visit_range_m, RobotProfile::kCellUm);
  std::printf("%-10s", "seed");
  for (const Column& column : kColumns) std::printf(" %11s", column.name);
  std::printf("\n");
  std::vector<double> sums(std::size(kColumns)), squares(std::size(kColumns));
  int reached = 0;
  for (std::size_t k = 0; k < results.size(); ++k) {
    std::vector<double> row;
    for (const Column& column : kColumns) row.push_back(column.value(results[k], width_m));
    const char* mark = results[k].goal_reached ? "" : " gave up";
    reached += results[k].goal_reached ? 1 : 0;
    print_row(std::to_string(options.rehearsal.world.seed + k) + mark, row);
    for (std::size_t i = 0; i < row.size(); ++i) sums[i] += row[i], squares[i] += row[i] * row[i];
  }
  const auto n = static_cast<double>(results.size());
  std::vector<double> errors;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    sums[i] /= n;
    const double variance = std::max(0.0, squares[i] / n - sums[i] * sums[i]);
    errors.push_back(n > 1 ? std::sqrt(variance / (n - 1)) : 0);
  }
  print_row("mean", sums);
  print_row("std. error", errors);
  std::printf(
      "%d of %zu saw %.0f %%; PE takes the local map's width, %.1f m, as the paper's metre\n",
      reached, results.size(), 100 * options.rehearsal.until, width_m);
}

void print_joined(const std::vector<RehearsalResult>& results) {
  std::size_t joined = 0;
  int apart = 0;
  double seconds = 0, most_m = 0, most_rad = 0;
  for (const RehearsalResult& result : results) {
    apart += result.apart;
    joined += result.joined.size();
    for (const Joining& joining : result.joined) {
      seconds += joining.after_s;
      most_m = std::max(most_m, joining.off_m);
      most_rad = std::max(most_rad, joining.off_rad);
    }
  }
  std::printf("unknown starts: %zu robots joined the team, %d stayed apart", joined, apart);
  if (joined > 0) {
    std::printf("; after %.0f s in the mean, then at most %.3f m and %.2f degrees off",
                seconds / static_cast<double>(joined), most_m, most_rad * 180 / M_PI);
  }
  std::printf("\n");
}

int rehearse_all(CommandOptions& options) {
  options.rehearsal.odometry = OdometryNoise::preset(options.odometry);
  options.rehearsal.lidar = LidarModel::preset(options.lidar);
  options.rehearsal.agent.goals =
      options.goals == "network" ? GoalsChoice::kNetwork : GoalsChoice::kViews;
  options.rehearsal.agent.localization = options.localization == "matching"
                                             ? LocalizationChoice::kMatching
                                             : LocalizationChoice::kOdometry;
  options.rehearsal.model =
      read_robot_model(options.model.empty() ? shipped_model(".ivfm") : options.model);
  options.rehearsal.interrupted = &g_interrupted;
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  const auto count = static_cast<std::size_t>(options.episodes);
  std::vector<RehearsalResult> results(count);
  ProgressLine progress(count, "runs");
  std::mutex mutex;
  std::uint64_t finished = 0;
  for_each_index(count, options.threads, [&](std::size_t i) {
    if (g_interrupted) return;
    RehearsalOptions one = options.rehearsal;
    one.world.seed += i;
    results[i] = rehearse(one);
    const std::scoped_lock lock(mutex);
    progress(++finished);
  });
  if (g_interrupted) {
    std::fprintf(stderr, "ivfm: interrupted\n");
    return 1;
  }
  print(results, options);
  if (options.rehearsal.unknown_starts) print_joined(results);
  return 0;
}

}  // namespace

void add_rehearse_command(CLI::App& app, CommandAction& action) {
  auto options = std::make_shared<CommandOptions>();
  RehearsalOptions& rehearsal = options->rehearsal;
  CLI::App* command = app.add_subcommand(
      "rehearse", "Many runs of whole agents in simulated time: means of what they achieve");
  add_run_options(*command, {rehearsal.world, rehearsal.unknown_starts, options->model,
                             options->goals, options->localization, options->odometry,
                             options->lidar, rehearsal.until, rehearsal.time_limit_s,
                             rehearsal.agent.visit_range_m, rehearsal.agent.visit_fov_deg});
  command
      ->add_option("--episodes", options->episodes,
                   "how many runs, each with its own seed: --seed and those after it")
      ->capture_default_str()
      ->check(CLI::Range(1, 100'000));
  command->add_option("--threads", options->threads, "the results do not depend on it [all cores]")
      ->check(CLI::Range(1, 1024));
  command->footer(
      "Example: ivfm rehearse --goals network --visit-range 1.2 --visit-fov 150 --random-starts");
  command->callback([options, &action] { action = [options] { return rehearse_all(*options); }; });
}

}  // namespace ivfm::host
