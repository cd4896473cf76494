// The options that every run of whole agents has, be it in real or in simulated time.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "host/simulator/world_catalog.h"

namespace ivfm::host {

// Where a command keeps their values; what these are is their default.
struct RunOptionTargets {
  WorldRequest& world;
  bool& unknown_starts;
  std::filesystem::path& model;
  std::string& goals;         // views or network
  std::string& localization;  // matching or odometry
  std::string& odometry_noise;
  std::string& lidar_noise;
  double& until;
  double& time_limit_s;
  double& visit_range_m;
  double& visit_fov_deg;
};

// Adds them to `command`. The targets must live until it has been parsed.
void add_run_options(CLI::App& command, const RunOptionTargets& targets);

}  // namespace ivfm::host
