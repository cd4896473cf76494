// Runs episodes of one policy in one world on several threads; the result does not depend on them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "host/environment/exploration_environment.h"
#include "host/evaluation/episode_metrics.h"

namespace ivfm::host {

// A world to judge in: how robots sense and move there, and how an episode begins.
struct EvaluationWorld {
  std::string name;
  EnvironmentConfig config;
  std::function<Scenario(int agents, std::uint64_t seed)> scenario;
  bool is_map = false;  // explored to a share of its area, instead of searched for a target
};

struct WorldOptions {
  std::string name = "1x";
  std::optional<double> resolution_m;    // of a bare image
  std::optional<double> until;           // share of the explorable area, maps only
  std::optional<double> sensor_range_m;  // maps only
  std::optional<double> fov_deg;         // maps only
  std::optional<Pose> start;             // of the first robot, maps only
  bool walls_known = false;              // arenas only
  bool count_last_view = false;          // arenas only: count every view as a visit
  bool reroute = false;                  // arenas only: drive around what is seen to block the way
};

// Throws std::invalid_argument for names and options that cannot be used (the message says what
// would be right), std::runtime_error for files that cannot.
EvaluationWorld make_world(const WorldOptions& options);

struct EvaluationRequest {
  EvaluationWorld world;
  std::string policy = "qnet";
  std::filesystem::path model;
  std::string state = "ivfm";
  int agents = 1;
  int episodes = 200;
  std::uint64_t seed = 1;
  int threads = 1;
};

struct EvaluationResult {
  std::vector<EpisodeMetrics> episodes;  // in the order of their numbers
  std::int64_t decisions = 0;
  double busy_s = 0;  // wall time, summed over threads
};

// `progress` is called with the number of finished episodes, from any one thread at a time.
// Throws what make_policy() and random worlds throw.
EvaluationResult evaluate(const EvaluationRequest& request,
                          const std::function<void(int)>& progress = {});

}  // namespace ivfm::host
