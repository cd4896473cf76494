#include "host/demo/run_options.h"

namespace ivfm::host {
namespace {

void add_place(CLI::App& command, const RunOptionTargets& targets) {
  command.add_option("--robots", targets.world.robots, "how many")
      ->capture_default_str()
      ->check(CLI::Range(1, 8));
  command
      .add_option("--world", targets.world.name,
                  "corridor, malaga, building, or a map file (.yaml, .pgm, .png)")
      ->capture_default_str();
  command.add_option("--seed", targets.world.seed, "of everything random")->capture_default_str();
  command.add_flag("--random-starts", targets.world.random_starts,
                   "draw the start poses in the corridor from the seed");
  command.add_flag("--unknown-starts", targets.unknown_starts,
                   "tell robots but the first nothing of where they start");
}

void add_end(CLI::App& command, const RunOptionTargets& targets) {
  command.add_option("--until", targets.until, "share of the free space to see")
      ->capture_default_str()
      ->check(CLI::Range(0.01, 1.0));
  command.add_option("--time-limit", targets.time_limit_s, "seconds of the robots' time")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
}

void add_robot(CLI::App& command, const RunOptionTargets& targets) {
  command.add_option("--model", targets.model, "quantized Q-network [the first of models/*.ivfm]");
  command
      .add_option("--goals", targets.goals,
                  "views: of frontiers, the network's goal where its view shows more; network: its "
                  "choice alone, as in the paper")
      ->capture_default_str()
      ->check(CLI::IsMember({"views", "network"}));
  command
      .add_option("--localization", targets.localization,
                  "matching: scans against the map correct the odometry; or odometry")
      ->capture_default_str()
      ->check(CLI::IsMember({"odometry", "matching"}));
  command.add_option("--visit-range", targets.visit_range_m, "metres within which a cell is seen")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 12.0));
  command.add_option("--visit-fov", targets.visit_fov_deg, "and within so many degrees, ahead")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 360.0));
}

void add_noise(CLI::App& command, const RunOptionTargets& targets) {
  command.add_option("--odometry-noise", targets.odometry_noise, "none, mild, turtlebot or harsh")
      ->capture_default_str()
      ->check(CLI::IsMember({"none", "mild", "turtlebot", "harsh"}));
  command.add_option("--lidar-noise", targets.lidar_noise, "none or mild")
      ->capture_default_str()
      ->check(CLI::IsMember({"none", "mild"}));
}

}  // namespace

void add_run_options(CLI::App& command, const RunOptionTargets& targets) {
  add_place(command, targets);
  add_end(command, targets);
  add_robot(command, targets);
  add_noise(command, targets);
}

}  // namespace ivfm::host
