// Runs episodes of one policy in one world on several threads and processes; the result does not
// depend on how many.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "host/environment/exploration_environment.h"
#include "host/evaluation/episode_metrics.h"
#include "host/evaluation/episode_store.h"
#include "host/evaluation/policies/exploration_policy.h"
#include "host/evaluation/process_group.h"

namespace ivfm::host {

// A world to judge in: how robots sense and move there, and how an episode begins.
struct EvaluationWorld {
  std::string name;
  EnvironmentConfig config;
  std::function<Scenario(int agents, std::uint64_t seed)> scenario;
  bool is_map = false;   // explored to a share of its area, instead of searched for a target
  std::string identity;  // name, options and content: what an episode here depends on
};

struct WorldOptions {
  std::string name = "1x";
  std::optional<double> resolution_m;    // of a bare image
  std::optional<double> until;           // share of the explorable area, maps only
  std::optional<double> sensor_range_m;  // maps only
  // Maps only: within what a cell counts as seen; what the sensor sees where it is not said.
  std::optional<double> visit_range_m, visit_fov_deg;
  std::optional<double> fov_deg;  // maps only
  bool network_decides = false;   // maps only: alone, as in arenas (ExplorerConfig)
  std::optional<Pose> start;      // of the first robot, maps only
  bool every_place = false;       // arenas only: a target at every place at once
  bool walls_known = false;       // arenas only
  bool count_last_view = false;   // arenas only: count every view as a visit
  bool reroute = false;           // arenas only: drive around what is seen to block the way
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

// What an episode depends on besides its number: program, world, policy, model, team and seed.
// Holds no comma and no line break. Throws std::runtime_error when the model cannot be read.
std::string key_of(const EvaluationRequest& request);

struct EvaluationResult {
  std::vector<EpisodeMetrics> episodes;  // in the order of their numbers
  std::int64_t decisions = 0;
  double busy_s = 0;  // wall time, summed over threads
};

// Called after each action.
using ActionObserver =
    std::function<void(const ExplorationEnvironment&, int agent, const StepResult&)>;

// Plays one episode by its number. `env` has the world's configuration, `policy` is the request's.
EpisodeRecord play_episode(const EvaluationRequest& request, ExplorationEnvironment& env,
                           ExplorationPolicy& policy, int episode,
                           const ActionObserver& observe = {});

// Plays what `store` does not hold yet, the processes of `group` side by side, and adds it there.
// `progress` is called with the number of finished episodes. The first process answers the result,
// the others an empty one. Throws what make_policy() and random worlds throw.
EvaluationResult evaluate(const EvaluationRequest& request, EpisodeStore& store,
                          ProcessGroup& group, const std::function<void(int)>& progress = {});
// The same on this process alone, keeping nothing.
EvaluationResult evaluate(const EvaluationRequest& request,
                          const std::function<void(int)>& progress = {});

}  // namespace ivfm::host
