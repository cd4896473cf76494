#include "host/trainer/collector.h"

#include <algorithm>
#include <cmath>

namespace ivfm::host {
namespace {

// A reachable action, uniformly. Requires one.
int random_action(const ActionMask& mask, ResumableRandom& random) {
  auto skip = static_cast<int>(random.below(static_cast<std::uint64_t>(mask.count())));
  for (int a = 0;; ++a)
    if (mask.test(a) && skip-- == 0) return a;
}

int best_action(const Observation& observation, const float* q) {
  int best = -1;
  for (int a = 0; a < kActions; ++a)
    if (observation.reachable.test(a) && (best < 0 || q[a] > q[best])) best = a;
  return best;
}

// Drives to goals of the whole map until the local map is worth visiting again or the episode
// ends; at most a few, for agents that have nothing to do.
void drive_globally(ExplorationEnvironment& environment, const TrainerConfig& config,
                    Earning& earning) {
  for (int i = 0; i < 3 && !environment.is_done(); ++i) {
    environment.observe(0);
    if (environment.local_map_is_worth_visiting(0)) return;
    const Earning e = earning_of(environment.step_global(0), environment, config);
    earning.reward += earning.discount * e.reward;
    earning.discount *= e.discount;
  }
}

}  // namespace

Collector::Collector(const TrainerConfig& config, ReplayBuffer& replay)
    : config_(config), replay_(replay) {
  for (int i = 0; i < config.environments; ++i) slots_.push_back(std::make_unique<Slot>(config));
}

void Collector::restart(ResumableRandom& random) {
  for (auto& slot : slots_) {
    slot->episodes.begin(random);
    slot->pending.assign(static_cast<std::size_t>(slot->episodes.environment().agents()), {});
  }
}

// Brings a slot to a state with a local choice; false when that takes another round.
bool Collector::prepare(Slot& slot, ResumableRandom& random) {
  if (slot.episodes.is_over()) {
    finish_episode(slot);
    slot.episodes.begin(random);
    slot.pending.assign(static_cast<std::size_t>(slot.episodes.environment().agents()), {});
  }
  ExplorationEnvironment& environment = slot.episodes.environment();
  const int agent = environment.next_agent();
  environment.observe(agent);
  const auto& mask = environment.goal_mask(agent);
  const bool has_goal = std::find(mask.begin(), mask.end(), 1) != mask.end();
  if (has_goal && environment.local_map_is_worth_visiting(agent)) return true;
  const StepResult result = environment.step_global(agent);
  earn(slot, agent, earning_of(result, environment, config_), false);
  return false;
}

void Collector::emit(const Pending& pending, ObservationId to) {
  if (!replay_.holds(pending.from)) return;
  replay_.add(Transition{pending.from, to, pending.action, static_cast<float>(pending.reward),
                         static_cast<float>(pending.discount)});
}

void Collector::earn(Slot& slot, int agent, const Earning& earning, bool is_local) {
  for (Pending& p : slot.pending[static_cast<std::size_t>(agent)]) {
    p.reward += p.discount * earning.reward;
    p.discount *= earning.discount;
    p.age += is_local ? 1 : 0;
  }
}

void Collector::finish_episode(Slot& slot) {
  ExplorationEnvironment& environment = slot.episodes.environment();
  for (int agent = 0; agent < environment.agents(); ++agent) {
    auto& pending = slot.pending[static_cast<std::size_t>(agent)];
    if (pending.empty()) continue;
    ObservationId end = kNoObservation;
    if (!slot.episodes.is_explored()) {
      environment.observe(agent);
      end = replay_.add(observation_of(environment, agent));
    }
    for (const Pending& p : pending) emit(p, end);
    pending.clear();
  }
}

int Collector::choose(const Observation& observation, const float* q, double epsilon,
                      ResumableRandom& random) const {
  if (random.uniform() < epsilon) return random_action(observation.reachable, random);
  const int best = best_action(observation, q);
  if (config_.temperature <= 0) return best;
  std::vector<double> weights(kActions, 0.0);
  double sum = 0;
  for (int a = 0; a < kActions; ++a) {
    if (!observation.reachable.test(a)) continue;
    sum += weights[static_cast<std::size_t>(a)] = std::exp((q[a] - q[best]) / config_.temperature);
  }
  double rest = random.uniform() * sum;
  for (int a = 0; a < kActions; ++a) {
    rest -= weights[static_cast<std::size_t>(a)];
    if (weights[static_cast<std::size_t>(a)] > 0 && rest < 0) return a;
  }
  return best;
}

int Collector::collect(const QValues& q_values, double epsilon, ResumableRandom& random) {
  std::vector<Slot*> ready;
  std::vector<Observation> observations;
  std::vector<const Observation*> pointers;
  for (auto& slot : slots_)
    if (prepare(*slot, random)) ready.push_back(slot.get());
  for (Slot* slot : ready) {
    ExplorationEnvironment& environment = slot->episodes.environment();
    observations.push_back(observation_of(environment, environment.next_agent()));
  }
  for (const Observation& o : observations) pointers.push_back(&o);
  if (ready.empty()) return 0;
  const std::vector<float> q = q_values(pointers);
  auto actions = static_cast<int>(ready.size());
  for (std::size_t i = 0; i < ready.size(); ++i) {
    ExplorationEnvironment& environment = ready[i]->episodes.environment();
    const int agent = environment.next_agent();
    const float* values = q.data() + i * kActions;
    auto& pending = ready[i]->pending[static_cast<std::size_t>(agent)];
    const ObservationId id = replay_.add(observations[i]);
    while (!pending.empty() && pending.front().age >= config_.n_step) {
      emit(pending.front(), id);
      pending.pop_front();
    }
    if (environment.agents() == 1 && random.uniform() < config_.branch_chance)
      actions += branch(*ready[i], agent, id, values, random);
    const int action = choose(observations[i], values, epsilon, random);
    bool is_local = false;
    const StepResult result = step_as_explorer(environment, agent, action, is_local);
    if (is_local) pending.push_back({id, action});
    const Earning earning = earning_of(result, environment, config_);
    reward_sum_ += earning.reward;
    ++rewards_;
    earn(*ready[i], agent, earning, is_local);
  }
  return actions;
}

// Tries other actions in copies of the episode: more samples of the same state for little work.
int Collector::branch(Slot& slot, int agent, ObservationId from, const float* q,
                      ResumableRandom& random) {
  const Observation observation = replay_.observation(from);
  ExplorationEnvironment copy = slot.episodes.environment();
  for (int i = 0; i < config_.branches; ++i) {
    if (i > 0) copy = slot.episodes.environment();
    const int action = choose(observation, q, i % 2 == 0 ? 0.0 : 1.0, random);
    Earning earning = earning_of(copy.step(agent, action), copy, config_);
    drive_globally(copy, config_, earning);
    ObservationId to = kNoObservation;
    if (!copy.is_done() && copy.totals().coverage() < 0.97) {
      copy.observe(agent);
      to = replay_.add(observation_of(copy, agent));
    }
    emit({from, action, earning.reward, earning.discount, 1}, to);
  }
  return config_.branches;
}

std::vector<LabelledState> Collector::label_states(int count, int labels, ResumableRandom& random,
                                                   const std::function<bool(int)>& keep_going) {
  std::vector<LabelledState> out;
  while (static_cast<int>(out.size()) < count && keep_going(static_cast<int>(out.size()))) {
    for (auto& slot : slots_) {
      if (!prepare(*slot, random)) continue;
      ExplorationEnvironment& environment = slot->episodes.environment();
      const int agent = environment.next_agent();
      LabelledState sample{observation_of(environment, agent), {}, {}};
      ExplorationEnvironment copy = environment;
      for (int i = 0; i < labels; ++i) {
        if (i > 0) copy = environment;
        const int action = random_action(sample.observation.reachable, random);
        const StepResult result = copy.step(agent, action);
        sample.actions.push_back(action);
        sample.values.push_back(static_cast<float>(earning_of(result, copy, config_).reward));
      }
      const auto best = std::max_element(sample.values.begin(), sample.values.end());
      const int greedy = sample.actions[static_cast<std::size_t>(best - sample.values.begin())];
      const bool explore = random.uniform() < config_.epsilon_start;
      bool is_local = false;
      step_as_explorer(environment, agent,
                       explore ? random_action(sample.observation.reachable, random) : greedy,
                       is_local);
      out.push_back(std::move(sample));
    }
  }
  for (auto& slot : slots_)
    for (auto& pending : slot->pending) pending.clear();
  return out;
}

double Collector::take_mean_reward() {
  const double mean = rewards_ == 0 ? std::nan("") : reward_sum_ / rewards_;
  reward_sum_ = 0;
  rewards_ = 0;
  return mean;
}

}  // namespace ivfm::host
