#include "host/trainer/collector.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "host/environment/parallel.h"

namespace ivfm::host {
namespace {

// A reachable goal, uniformly. Requires one.
int random_goal(const ActionMask& mask, ResumableRandom& random) {
  auto skip = static_cast<int>(random.below(static_cast<std::uint64_t>(mask.count())));
  for (int a = 0;; ++a)
    if (mask.test(a) && skip-- == 0) return a;
}

// Drives to goals of the whole map until the local map, then observed, is worth visiting again or
// the episode ends; at most a few times.
void drive_globally(ExplorationEnvironment& environment, int agent, const TrainerConfig& config,
                    Earning& earning) {
  constexpr int kMost = 3;
  for (int i = 0; !environment.is_done(); ++i) {
    environment.observe(agent);
    if (i == kMost || environment.local_map_is_worth_visiting(agent)) return;
    const Earning e = earning_of(environment.step_global(agent), environment, config);
    earning.reward += earning.discount * e.reward;
    earning.discount *= e.discount;
  }
}

}  // namespace

// What trying a goal in a copy of the episode came to.
struct Collector::Trial {
  int goal = 0;
  Earning earning;
  bool goes_on = false;  // `reached` has a value of its own
  Observation reached;
};

// One stream of episodes, with its own random numbers: results do not depend on threads.
struct Collector::Slot {
  Slot(const TrainerConfig& config, double share) : episodes(config, share) {}

  ExplorationSlot episodes;
  ResumableRandom random;
  std::unique_ptr<ExplorationEnvironment> copy;
  bool ready = false;
  Observation observation;
  std::vector<Trial> trials;
  double reward_sum = 0;
  int rewards = 0;
};

Collector::Collector(const TrainerConfig& config)
    : config_(config), state_kind_(state_kind_from_name(config.state).value()) {
  for (int i = 0; i < config.environments; ++i)
    slots_.push_back(std::make_unique<Slot>(config, (i + 0.5) / config.environments));
}

Collector::~Collector() = default;

void Collector::restart(ResumableRandom& random) {
  for (auto& slot : slots_) slot->random = ResumableRandom(random.next());
  for_each_index(slots_.size(), config_.threads,
                 [this](std::size_t i) { slots_[i]->episodes.begin(slots_[i]->random); });
}

// Brings a slot to a state with a local choice; false when that takes another round.
bool Collector::prepare(Slot& slot) {
  if (slot.episodes.is_over()) slot.episodes.begin(slot.random);
  ExplorationEnvironment& environment = slot.episodes.environment();
  const int agent = environment.next_agent();
  environment.observe(agent);
  slot.observation = observation_of(state_kind_, environment, agent);
  if (slot.observation.reachable.any() && environment.local_map_is_worth_visiting(agent))
    return true;
  environment.step_global(agent);
  return false;
}

std::vector<LabelledState> Collector::collect(const QValues& q_values,
                                              const StateValues& state_values, double epsilon) {
  for_each_index(slots_.size(), config_.threads,
                 [this](std::size_t i) { slots_[i]->ready = prepare(*slots_[i]); });
  std::vector<Slot*> ready;
  std::vector<const Observation*> observations;
  for (auto& slot : slots_) {
    if (!slot->ready) continue;
    ready.push_back(slot.get());
    observations.push_back(&slot->observation);
  }
  const std::vector<float> q = q_values(observations);
  for_each_index(ready.size(), config_.threads,
                 [&](std::size_t i) { explore(*ready[i], q.data() + i * kActions, epsilon); });
  const std::vector<float> values = values_of_trials(state_values);
  std::vector<LabelledState> out;
  const float* value = values.data();
  for (Slot* slot : ready) {
    LabelledState labelled{slot->observation, {}, {}};
    for (const Trial& t : slot->trials) {
      labelled.actions.push_back(t.goal);
      labelled.values.push_back(static_cast<float>(t.earning.reward) +
                                static_cast<float>(t.earning.discount) * *value++);
    }
    out.push_back(std::move(labelled));
  }
  return out;
}

// The values of what the ready slots' trials led to, in their order; 0 where nothing follows.
std::vector<float> Collector::values_of_trials(const StateValues& state_values) const {
  std::vector<const Observation*> reached;
  for (const auto& slot : slots_) {
    if (!slot->ready) continue;
    for (const Trial& t : slot->trials)
      if (t.goes_on) reached.push_back(&t.reached);
  }
  const std::vector<float> values = state_values(reached);
  std::vector<float> out;
  auto next = values.begin();
  for (const auto& slot : slots_) {
    if (!slot->ready) continue;
    for (const Trial& t : slot->trials) out.push_back(t.goes_on ? *next++ : 0.0f);
  }
  return out;
}

void Collector::explore(Slot& slot, const float* q, double epsilon) {
  ExplorationEnvironment& environment = slot.episodes.environment();
  const int agent = environment.next_agent();
  slot.trials.clear();
  for (int i = 0; i < config_.labels; ++i) {
    try_goal(slot, agent,
             i % 2 == 0 ? likely_goal(slot.observation, q, slot.random)
                        : random_goal(slot.observation.reachable, slot.random));
  }
  const int goal = slot.random.uniform() < epsilon
                       ? random_goal(slot.observation.reachable, slot.random)
                       : likely_goal(slot.observation, q, slot.random);
  bool is_local = false;
  const StepResult result = step_as_explorer(environment, agent, goal, is_local);
  if (!is_local) return;
  slot.reward_sum += earning_of(result, environment, config_).reward;
  ++slot.rewards;
}

void Collector::try_goal(Slot& slot, int agent, int goal) {
  if (slot.copy) {
    *slot.copy = slot.episodes.environment();
  } else {
    slot.copy = std::make_unique<ExplorationEnvironment>(slot.episodes.environment());
  }
  ExplorationEnvironment& copy = *slot.copy;
  Trial trial;
  trial.goal = goal;
  trial.earning = earning_of(copy.step(agent, goal), copy, config_);
  drive_globally(copy, agent, config_, trial.earning);
  trial.goes_on = !copy.is_done() && copy.totals().coverage() < kExploredShare;
  if (trial.goes_on) trial.reached = observation_of(state_kind_, copy, agent);
  slot.trials.push_back(trial);
}

// Drawn by the softmax of the Q values; the best goal at temperature 0.
int Collector::likely_goal(const Observation& observation, const float* q,
                           ResumableRandom& random) const {
  int best = -1;
  for (int a = 0; a < kActions; ++a)
    if (observation.reachable.test(a) && (best < 0 || q[a] > q[best])) best = a;
  if (config_.temperature <= 0) return best;
  std::vector<double> weights(kActions, 0.0);
  double sum = 0;
  for (std::size_t a = 0; a < kActions; ++a) {
    if (!observation.reachable.test(static_cast<int>(a))) continue;
    sum += weights[a] = std::exp((q[a] - q[best]) / config_.temperature);
  }
  double rest = random.uniform() * sum;
  for (std::size_t a = 0; a < kActions; ++a) {
    rest -= weights[a];
    if (weights[a] > 0 && rest < 0) return static_cast<int>(a);
  }
  return best;
}

double Collector::take_mean_reward() {
  double sum = 0;
  int count = 0;
  for (auto& slot : slots_) {
    sum += std::exchange(slot->reward_sum, 0);
    count += std::exchange(slot->rewards, 0);
  }
  return count == 0 ? std::nan("") : sum / count;
}

}  // namespace ivfm::host
