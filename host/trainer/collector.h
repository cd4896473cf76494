// Fills the replay buffer: many episodes side by side, one batched network pass a round.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <vector>

#include "host/trainer/exploration_slot.h"
#include "host/trainer/replay_buffer.h"

namespace ivfm::host {

class Collector {
 public:
  Collector(const TrainerConfig& config, ReplayBuffer& replay);

  // Forgets the running episodes and begins new ones.
  void restart(ResumableRandom& random);
  // One action of every slot. `epsilon`: share of uniformly random goals. Returns local actions
  // taken, actions tried in copies included.
  int collect(const QValues& q_values, double epsilon, ResumableRandom& random);
  // States labelled with the reward of some of their actions, found by trying them in copies. The
  // robot goes on with the best of these goals, or a random one.
  std::vector<LabelledState> label_states(int count, int labels, ResumableRandom& random,
                                          const std::function<bool(int)>& keep_going);

  // Mean reward of the local actions since the last call.
  double take_mean_reward();

 private:
  // An action whose n-step return is still growing.
  struct Pending {
    ObservationId from = kNoObservation;
    int action = 0;
    double reward = 0;
    double discount = 1;
    int age = 0;
  };
  struct Slot {
    explicit Slot(const TrainerConfig& config) : episodes(config) {}
    ExplorationSlot episodes;
    std::vector<std::deque<Pending>> pending;  // by agent
  };

  bool prepare(Slot& slot, ResumableRandom& random);
  void finish_episode(Slot& slot);
  void earn(Slot& slot, int agent, const Earning& earning, bool is_local);
  void emit(const Pending& pending, ObservationId to);
  int choose(const Observation& observation, const float* q, double epsilon,
             ResumableRandom& random) const;
  int branch(Slot& slot, int agent, ObservationId from, const float* q, ResumableRandom& random);

  const TrainerConfig& config_;
  ReplayBuffer& replay_;
  std::vector<std::unique_ptr<Slot>> slots_;
  double reward_sum_ = 0;
  int rewards_ = 0;
};

}  // namespace ivfm::host
