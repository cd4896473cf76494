// One stream of random training episodes: worlds drawn from the mix, one robot's action at a time.
#pragma once

#include <memory>
#include <optional>

#include "host/environment/exploration_environment.h"
#include "host/environment/network_state.h"
#include "host/trainer/observation.h"
#include "host/trainer/resumable_random.h"
#include "host/trainer/trainer_config.h"

namespace ivfm::host {

// What the trainer keeps of a state. After ExplorationEnvironment::observe().
Observation observation_of(StateKind kind, const ExplorationEnvironment& environment, int agent);

// The reward of an action in units of RewardConfig, and the discount of what follows.
struct Earning {
  double reward = 0;
  double discount = 1;
};
Earning earning_of(const StepResult& result, const ExplorationEnvironment& environment,
                   const TrainerConfig& config);

// Lets the firmware's explorer decide with `policy_cell` as its network's best goal: the explorer
// may still prefer a goal of the whole map. Then drives there. `is_local` answers which it was.
StepResult step_as_explorer(ExplorationEnvironment& environment, int agent, int policy_cell,
                            bool& is_local);

// Explored to this share, nothing worthwhile is left: what follows has no value.
inline constexpr double kExploredShare = 0.97;

class ExplorationSlot {
 public:
  // All episodes of a slot are in one kind of world: the one that holds the place `share`, from 0
  // to 1, when the shares of config.worlds lie side by side.
  ExplorationSlot(const TrainerConfig& config, double share);

  // Starts a new episode.
  void begin(ResumableRandom& random);

  ExplorationEnvironment& environment() { return *environment_; }
  // The episode ended, or is to be cut off here, so that states of every coverage are met equally.
  bool is_over() const {
    return environment_->is_done() || environment_->totals().coverage() >= cut_off_coverage_;
  }

 private:
  void begin_arena(int agents, ResumableRandom& random);
  void begin_building(int agents, ResumableRandom& random);
  EnvironmentConfig building_config(ResumableRandom& random) const;

  const TrainerConfig& config_;
  std::unique_ptr<ExplorationEnvironment> environment_;
  std::size_t kind_ = 0;
  double cut_off_coverage_ = 1;
};

}  // namespace ivfm::host
