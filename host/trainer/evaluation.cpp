#include "host/trainer/evaluation.h"

#include <algorithm>
#include <memory>

#include "host/environment/parallel.h"
#include "host/trainer/exploration_slot.h"

namespace ivfm::host {
namespace {

constexpr double kPaperPixelsPerM2 = 128.0 * 128.0;

using Episodes = std::vector<std::unique_ptr<ExplorationEnvironment>>;

// Plays all episodes to their end, one action of each a round.
void play(const Policy& policy, const Episodes& episodes) {
  std::vector<ExplorationEnvironment*> running;
  for (const auto& episode : episodes) running.push_back(episode.get());
  while (!running.empty()) {
    std::vector<Observation> observations(running.size());
    for_each_index(running.size(), policy.threads, [&](std::size_t i) {
      ExplorationEnvironment& e = *running[i];
      e.observe(e.next_agent());
      observations[i] = observation_of(policy.state_kind, e, e.next_agent());
    });
    std::vector<const Observation*> pointers;
    for (const Observation& o : observations) pointers.push_back(&o);
    const std::vector<int> actions = policy.choose(pointers);
    for_each_index(running.size(), policy.threads, [&](std::size_t i) {
      bool is_local = false;
      step_as_explorer(*running[i], running[i]->next_agent(), actions[i], is_local);
    });
    std::erase_if(running, [](const ExplorationEnvironment* e) { return e->is_done(); });
  }
}

void add(const ExplorationEnvironment& episode, bool reached, Evaluation& sum) {
  const EpisodeTotals& t = episode.totals();
  ++sum.episodes;
  if (!reached) {
    ++sum.not_found;
    return;
  }
  const double explored = std::max(1.0, static_cast<double>(t.explored_cells));
  const double cell_m = episode.config().cell_um * 1e-6;
  sum.steps += t.total_actions();
  sum.re_exploration_rate += static_cast<double>(t.visits) / explored - 1;
  sum.pixels_per_metre +=
      explored * cell_m * cell_m * kPaperPixelsPerM2 / std::max(0.01, t.total_distance_m());
  sum.distance_m += t.total_distance_m();
  sum.coverage += t.coverage();
  sum.collisions += static_cast<double>(t.collisions);
}

Evaluation mean_of(Evaluation sum) {
  const double n = std::max(1, sum.episodes - sum.not_found);
  for (double* value : {&sum.steps, &sum.re_exploration_rate, &sum.pixels_per_metre,
                        &sum.distance_m, &sum.coverage, &sum.collisions})
    *value /= n;
  return sum;
}

}  // namespace

Evaluation evaluate_arena(const Policy& policy, ArenaKind kind, int agents, int episodes, int cap) {
  EnvironmentConfig config = EnvironmentConfig::arena();
  config.max_actions_per_agent = cap;
  Episodes running;
  for (int i = 0; i < episodes; ++i) {
    running.push_back(std::make_unique<ExplorationEnvironment>(config));
    running.back()->reset(
        random_arena(kind, agents, kValidationSeeds + static_cast<std::uint64_t>(i)));
  }
  play(policy, running);
  Evaluation sum;
  for (const auto& episode : running) add(*episode, episode->totals().found, sum);
  return mean_of(sum);
}

}  // namespace ivfm::host
