// Plays many episodes side by side and values the goals of every state that they meet.
#pragma once

#include <memory>
#include <vector>

#include "host/trainer/exploration_slot.h"
#include "host/trainer/learner_config.h"

namespace ivfm::host {

class Collector {
 public:
  explicit Collector(const TrainerConfig& config);
  ~Collector();

  // Forgets the running episodes and begins new ones.
  void restart(ResumableRandom& random);

  // One action of every episode's next robot. Each state that they meet comes back with goals that
  // were tried in copies of the episode: half of them likely choices of the network, half drawn
  // from all in reach. A goal's value is its reward and, discounted, `state_values` of the state it
  // leads to. The robots go on with a likely choice, or, with probability `epsilon`, any goal.
  std::vector<LabelledState> collect(const QValues& q_values, const StateValues& state_values,
                                     double epsilon);

  // Mean reward of the robots' own actions since the last call.
  double take_mean_reward();

 private:
  struct Trial;
  struct Slot;

  bool prepare(Slot& slot);
  void explore(Slot& slot, const float* q, double epsilon);
  void try_goal(Slot& slot, int agent, int goal);
  int likely_goal(const Observation& observation, const float* q, ResumableRandom& random) const;
  std::vector<float> values_of_trials(const StateValues& state_values) const;

  const TrainerConfig& config_;
  StateKind state_kind_;
  std::vector<std::unique_ptr<Slot>> slots_;
};

}  // namespace ivfm::host
