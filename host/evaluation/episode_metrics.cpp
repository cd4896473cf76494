#include "host/evaluation/episode_metrics.h"

#include <algorithm>
#include <cmath>

namespace ivfm::host {

namespace {

constexpr double kLocalMapPixels = 128;  // across the local map, in the paper
constexpr double kSimStepsPerSecond = 240;
constexpr double kPoseBytes = 6;  // x, y, theta as float16, with each rectangle

constexpr std::array<NamedMetric, 11> kMetrics = {{
    {"rer", [](const EpisodeMetrics& e) { return std::optional(e.rer); }},
    {"pe", [](const EpisodeMetrics& e) { return e.pe; }},
    {"steps", [](const EpisodeMetrics& e) { return std::optional(e.steps); }},
    {"makespan", [](const EpisodeMetrics& e) { return std::optional(e.makespan); }},
    {"overlap", [](const EpisodeMetrics& e) { return std::optional(e.overlap); }},
    {"coverage", [](const EpisodeMetrics& e) { return std::optional(e.coverage); }},
    {"distance_m", [](const EpisodeMetrics& e) { return std::optional(e.distance_m); }},
    {"bandwidth_paper_mib",
     [](const EpisodeMetrics& e) { return std::optional(e.bandwidth_paper_mib); }},
    {"wire_bytes", [](const EpisodeMetrics& e) { return e.wire_bytes; }},
    {"sim_time_s", [](const EpisodeMetrics& e) { return std::optional(e.sim_time_s); }},
    {"collisions", [](const EpisodeMetrics& e) { return std::optional(e.collisions); }},
}};

constexpr std::array<NamedMetric, kMilestones.size() + 1> kMilestoneMetrics = {{
    {"travel_m", [](const EpisodeMetrics& e) { return std::optional(e.distance_m); }},
    {"t50_m", [](const EpisodeMetrics& e) { return e.milestone_m[0]; }},
    {"t90_m", [](const EpisodeMetrics& e) { return e.milestone_m[1]; }},
    {"t95_m", [](const EpisodeMetrics& e) { return e.milestone_m[2]; }},
    {"t99_m", [](const EpisodeMetrics& e) { return e.milestone_m[3]; }},
}};

// What has a value at every moment of an episode.
constexpr auto kMeasuresOfThePast = {
    &EpisodeMetrics::rer,        &EpisodeMetrics::steps,      &EpisodeMetrics::makespan,
    &EpisodeMetrics::overlap,    &EpisodeMetrics::coverage,   &EpisodeMetrics::distance_m,
    &EpisodeMetrics::sim_time_s, &EpisodeMetrics::collisions, &EpisodeMetrics::bandwidth_paper_mib};

double ratio(double a, double b) { return b > 0 ? a / b : 0; }

}  // namespace

double local_map_width_m(const EnvironmentConfig& config) {
  return 1e-6 * config.explorer.local_map_um(config.cell_um);
}

EpisodeMetrics measured(const ExplorationEnvironment& env, std::span<const std::int64_t> sim_steps,
                        int state_channels) {
  const EpisodeTotals& totals = env.totals();
  const double width_m = local_map_width_m(env.config());
  const double pixel_m = width_m / kLocalMapPixels;
  const double cell_m = 1e-6 * env.config().cell_um;
  const double pixels_per_cell = cell_m * cell_m / (pixel_m * pixel_m);
  EpisodeMetrics m;
  m.found = env.scenario().target ? totals.found : totals.coverage() >= env.config().until_coverage;
  const auto explored = static_cast<double>(totals.explored_cells);
  m.rer = ratio(static_cast<double>(totals.visits) - explored, explored);
  m.distance_m = totals.total_distance_m();
  if (m.distance_m > 0) m.pe = explored * pixels_per_cell / (m.distance_m / width_m);
  m.steps = totals.total_actions();
  m.makespan = *std::max_element(totals.actions.begin(), totals.actions.end());
  m.overlap = ratio(static_cast<double>(totals.shared_cells), explored);
  m.coverage = totals.coverage();
  m.sim_time_s = static_cast<double>(*std::max_element(sim_steps.begin(), sim_steps.end())) /
                 kSimStepsPerSecond;
  m.collisions = static_cast<double>(totals.collisions);
  const double state_bytes = 2.0 * state_channels * kLocalMapPixels * kLocalMapPixels;
  const double rectangle_pixels =
      static_cast<double>(totals.visit_mbr_cells + totals.obstacle_mbr_cells) * pixels_per_cell;
  m.bandwidth_paper_mib =
      (m.steps * (state_bytes + 2 * kPoseBytes) + rectangle_pixels) / (1024.0 * 1024.0);
  return m;
}

void MeasuresOfEveryPlace::add(const EpisodeMetrics& now, int places) {
  for (const auto measure : kMeasuresOfThePast) sum_.*measure += now.*measure * places;
  pe_ += now.pe.value_or(0) * places;
  places_ += places;
}

EpisodeMetrics MeasuresOfEveryPlace::mean(int places) const {
  EpisodeMetrics mean = sum_;
  const double n = std::max(1, places_);
  for (const auto measure : kMeasuresOfThePast) mean.*measure /= n;
  mean.pe = pe_ / n;
  mean.found = places_ * 100 >= places * 99;
  return mean;
}

MeanStd mean_std(std::span<const double> values) {
  MeanStd result;
  result.count = values.size();
  if (values.empty()) return result;
  const auto n = static_cast<double>(values.size());
  for (const double v : values) result.mean += v / n;
  double variance = 0;
  for (const double v : values) variance += (v - result.mean) * (v - result.mean) / n;
  result.std = std::sqrt(variance);
  return result;
}

std::span<const NamedMetric> metrics() { return kMetrics; }

std::span<const NamedMetric> milestone_metrics() { return kMilestoneMetrics; }

MeanStd summarized(const NamedMetric& metric, std::span<const EpisodeMetrics> episodes) {
  std::vector<double> values;
  for (const EpisodeMetrics& episode : episodes) {
    const auto value = metric.of(episode);
    if (episode.found && value) values.push_back(*value);
  }
  return mean_std(values);
}

}  // namespace ivfm::host
