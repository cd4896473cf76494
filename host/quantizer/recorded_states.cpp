#include "host/quantizer/recorded_states.h"

#include <utility>

#include "host/environment/arena_worlds.h"
#include "host/environment/building_worlds.h"
#include "host/environment/exploration_environment.h"
#include "host/environment/random.h"

namespace ivfm::host {

namespace {

// Knows whether the policy was asked since the last look.
class NotedFunction final : public QFunction {
 public:
  explicit NotedFunction(QFunction& q) : q_(q) {}
  Status evaluate(const LocalState& state, std::span<std::int32_t> q_values) override {
    asked_ = true;
    return q_.evaluate(state, q_values);
  }
  bool take_asked() { return std::exchange(asked_, false); }

 private:
  QFunction& q_;
  bool asked_ = false;
};

using Draw = Scenario (*)(std::uint64_t seed);

// Plays until `wanted` states that the policy was asked about are there; records every `every`-th
// one, of the first 400 actions of an episode.
void record_world(QFunction& q, const EnvironmentConfig& config, Draw draw, int every, int wanted,
                  std::uint64_t seed, RecordedStates& out) {
  NotedFunction noted(q);
  ExplorationEnvironment env(config);
  for (std::uint64_t episode = 0; wanted > 0; ++episode) {
    env.reset(draw(Random(seed, episode).next()));
    for (int action = 0; action < 400 && wanted > 0 && !env.is_done(); ++action) {
      const Decision decision = env.decide(0, noted);
      if (noted.take_asked() && action % every == 0) {
        const LocalState& state = env.state(0);
        out.states.insert(out.states.end(), state.channels.begin(), state.channels.end());
        out.masks.insert(out.masks.end(), env.goal_mask(0).begin(), env.goal_mask(0).end());
        --wanted;
      }
      env.step_decision(0, decision);
    }
  }
}

}  // namespace

RecordedStates record_states(QFunction& q, int count, std::uint64_t seed) {
  const auto arena = EnvironmentConfig::arena(), building = EnvironmentConfig::building();
  const int sixth = count / 6;
  RecordedStates out;
  record_world(
      q, arena, [](std::uint64_t s) { return random_arena(ArenaKind::k1x, 1, s); }, 1,
      count - 3 * sixth, Random(seed, 0).next(), out);
  record_world(
      q, arena, [](std::uint64_t s) { return random_arena(ArenaKind::k2x, 1, s); }, 1, sixth,
      Random(seed, 1).next(), out);
  record_world(
      q, arena, [](std::uint64_t s) { return random_arena(ArenaKind::kDivider, 1, s); }, 1, sixth,
      Random(seed, 2).next(), out);
  record_world(
      q, building, [](std::uint64_t s) { return random_building({}, 1, s); }, 10, sixth,
      Random(seed, 3).next(), out);
  return out;
}

}  // namespace ivfm::host
