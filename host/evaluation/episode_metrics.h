// The metrics of an episode and their mean and spread over many (method.md, "Metrics").
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host/environment/exploration_environment.h"

namespace ivfm::host {

// Shares of the explorable area at which the metres driven so far are noted.
inline constexpr std::array<double, 4> kMilestones = {0.50, 0.90, 0.95, 0.99};

struct EpisodeMetrics {
  std::uint64_t seed = 0;
  bool found = false;        // the target, or, without one, the wanted share of the area
  double rer = 0;            // mean over explored cells of (visits - 1)
  std::optional<double> pe;  // explored pixels of 1/128 local map a local map width driven
  double steps = 0;          // actions, summed over agents
  double makespan = 0;       // actions of the busiest agent
  double overlap = 0;        // explored cells that two agents or more saw
  double coverage = 0;
  double distance_m = 0;  // summed over agents
  double bandwidth_paper_mib = 0;
  std::optional<double> wire_bytes;  // of every datagram, where they were sent
  double sim_time_s = 0;             // of the busiest agent, at 240 simulation steps a second
  double collisions = 0;
  std::array<std::optional<double>, kMilestones.size()> milestone_m{};

  bool operator==(const EpisodeMetrics&) const = default;
};

// Width of the local map in metres: PE counts areas and lengths relative to it. 1 m in the paper.
double local_map_width_m(const EnvironmentConfig& config);

// `sim_steps`: of each agent. `state_channels`: 2 (i-VFM) or 4 (VFM), for the paper's bandwidth.
EpisodeMetrics measured(const ExplorationEnvironment& env, std::span<const std::int64_t> sim_steps,
                        int state_channels);

// The mean over all places of the target of the measures when each came into view. What is not in
// proportion to the way so far (bytes on the wire, milestones) is left out.
class MeasuresOfEveryPlace {
 public:
  // `now`: after the action in which `places` of them came into view.
  void add(const EpisodeMetrics& now, int places);
  // `places`: of the scenario. Found: all but a hundredth of them came into view.
  EpisodeMetrics mean(int places) const;

 private:
  EpisodeMetrics sum_;
  double pe_ = 0;
  int places_ = 0;
};

struct MeanStd {
  double mean = 0, std = 0;  // population standard deviation
  std::size_t count = 0;
};

MeanStd mean_std(std::span<const double> values);

// A metric by its name in JSON and CSV.
struct NamedMetric {
  const char* name;
  std::optional<double> (*of)(const EpisodeMetrics&);
};

std::span<const NamedMetric> metrics();
// What map files add: travel_m and the metres driven at the milestones (t50_m ... t99_m).
std::span<const NamedMetric> milestone_metrics();

// Over the found episodes; empty count when there is none.
MeanStd summarized(const NamedMetric& metric, std::span<const EpisodeMetrics> episodes);

}  // namespace ivfm::host
