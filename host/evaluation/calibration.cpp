#include "host/evaluation/calibration.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <map>

#include "host/environment/arena_worlds.h"
#include "host/environment/random.h"
#include "host/evaluation/episode_metrics.h"
#include "host/evaluation/policies/simple_policies.h"

namespace ivfm::host {

namespace {

constexpr double kReleasedEpisodes = 34;
constexpr double kReleasedActions = kReleasedEpisodes * 145.9;
constexpr std::array<int, 6> kGrowthActions = {1, 5, 10, 20, 40, 80};

// What was measured of the released simulator: mean and standard deviation (negative: unknown) and
// over how many samples.
struct Reference {
  const char* quantity;
  double mean, deviation, samples;
};

constexpr std::array<Reference, 18> kReferences = {{
    {"steps", 145.9, 178.6, kReleasedEpisodes},
    {"RER", 2.963, 2.644, kReleasedEpisodes},
    {"PE, pixels per metre", 3105, 1569, kReleasedEpisodes},
    {"coverage", 0.505, 0.293, kReleasedEpisodes},
    {"path driven per action, m", 0.259, 0.168, kReleasedActions},
    {"newly seen pixels per action", 457, -1, kReleasedActions},
    {"seen pixels per action", 2358, -1, kReleasedActions},
    {"simulation steps per action", 289, -1, kReleasedActions},
    {"views per action", 5.3, -1, kReleasedActions},
    {"views counted as visits", 4.3, -1, kReleasedActions},
    {"actions that end in a collision, %", 19.5, 39.6, kReleasedActions},
    {"actions that add no visit, %", 15.8, 36.5, kReleasedActions},
    {"explored pixels after 1 action", 2105, -1, kReleasedEpisodes},
    {"explored pixels after 5 actions", 8278, -1, kReleasedEpisodes},
    {"explored pixels after 10 actions", 13735, -1, kReleasedEpisodes},
    {"explored pixels after 20 actions", 21098, -1, kReleasedEpisodes},
    {"explored pixels after 40 actions", 34241, -1, kReleasedEpisodes},
    {"explored pixels after 80 actions", 56998, -1, kReleasedEpisodes},
}};

using Samples = std::map<std::string, std::vector<double>>;

void add_action(const StepResult& r, double pixels_per_cell, Samples& samples) {
  const double seen = r.newly_seen_cells + r.re_seen_cells;
  samples["path driven per action, m"].push_back(r.distance_m);
  samples["newly seen pixels per action"].push_back(r.newly_seen_cells * pixels_per_cell);
  samples["seen pixels per action"].push_back(seen * pixels_per_cell);
  samples["simulation steps per action"].push_back(r.sim_steps);
  samples["views per action"].push_back(r.views);
  samples["views counted as visits"].push_back(r.views - 1);
  samples["actions that end in a collision, %"].push_back(r.collided ? 100 : 0);
  samples["actions that add no visit, %"].push_back(seen == 0 ? 100 : 0);
}

void play(ExplorationEnvironment& env, std::uint64_t seed, Samples& samples) {
  ReleasedRandomPolicy policy;
  policy.start_episode(Random(seed, 1).next());
  env.reset(random_arena(ArenaKind::k1x, 1, seed));
  const double cell_pixels = env.config().cell_um * 128e-6;
  std::int64_t sim_steps = 0;
  for (int actions = 1; !env.is_done(); ++actions) {
    const StepResult result = policy.act(env, 0);
    sim_steps += result.sim_steps;
    add_action(result, cell_pixels * cell_pixels, samples);
    for (const int n : kGrowthActions) {
      if (actions != n) continue;
      const std::string name =
          "explored pixels after " + std::to_string(n) + (n == 1 ? " action" : " actions");
      samples[name].push_back(static_cast<double>(env.totals().explored_cells) * cell_pixels *
                              cell_pixels);
    }
  }
  const EpisodeMetrics m = measured(env, {{sim_steps}}, 2);
  if (!m.found) return;
  samples["steps"].push_back(m.steps);
  samples["RER"].push_back(m.rer);
  if (m.pe) samples["PE, pixels per metre"].push_back(*m.pe);
  samples["coverage"].push_back(m.coverage);
}

double standard_error(double deviation, double samples) {
  return samples > 0 ? deviation / std::sqrt(samples) : 0;
}

}  // namespace

double CalibrationRow::z() const {
  if (released_error <= 0) return 0;
  return (ours - released) / std::hypot(released_error, ours_error);
}

std::vector<CalibrationRow> calibrate(int episodes, std::uint64_t seed,
                                      const std::function<void(int)>& progress) {
  EnvironmentConfig config = EnvironmentConfig::arena();
  config.walls_known = true;  // as the released code's planner knows them
  config.feels_contact = false;
  config.explorer.robot_radius_um = arena::kRobotRadiusUm;
  ExplorationEnvironment env(config);
  Samples samples;
  for (int i = 0; i < episodes; ++i) {
    play(env, Random(seed, static_cast<std::uint64_t>(i)).next(), samples);
    if (progress) progress(i + 1);
  }
  std::vector<CalibrationRow> rows;
  for (const Reference& reference : kReferences) {
    const std::vector<double>& values = samples[reference.quantity];
    const MeanStd ours = mean_std(values);
    rows.push_back({reference.quantity, reference.mean,
                    standard_error(std::max(0.0, reference.deviation), reference.samples),
                    ours.mean, standard_error(ours.std, static_cast<double>(values.size()))});
  }
  return rows;
}

std::string to_text(const std::vector<CalibrationRow>& rows) {
  std::string text =
      "random policy of the released code, 1x arena, one robot: mean (standard error)\n";
  char line[160];
  std::snprintf(line, sizeof line, "%-36s %20s %20s %8s\n", "", "released simulator", "ours", "z");
  text += line;
  for (const CalibrationRow& row : rows) {
    char released[40], ours[40], z[16] = "";
    std::snprintf(released, sizeof released, row.released_error > 0 ? "%.4g (%.2g)" : "%.4g",
                  row.released, row.released_error);
    std::snprintf(ours, sizeof ours, "%.4g (%.2g)", row.ours, row.ours_error);
    if (row.released_error > 0) std::snprintf(z, sizeof z, "%+.1f", row.z());
    std::snprintf(line, sizeof line, "%-36s %20s %20s %8s\n", row.quantity.c_str(), released, ours,
                  z);
    text += line;
  }
  return text;
}

}  // namespace ivfm::host
