// How the learner learns, and what it is shown. Free of libtorch.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "host/trainer/observation.h"

namespace ivfm::host {

struct LearnerConfig {
  double learning_rate = 1e-3;
  double weight_decay = 1e-5;
  double gradient_clip = 10.0;  // largest norm of the gradient
  int batch = 64;               // states of a step
  // Weight of the error that a state's goals have in common, against the errors between them. What
  // lies outside of the local map changes the value of all goals alike, and no state shows it.
  double shared_weight = 0.1;
  double target_rate = 0.005;  // share of the online weights that enters the target every step
  bool double_q = true;        // the online network chooses the goal whose target value counts
  bool mask_target = true;     // goals out of reach are left out of a state's value
  bool symmetries = true;      // every sample is shown under a random symmetry
  bool bfloat16 = true;        // 16-bit arithmetic, 32-bit weights: twice as fast where supported
};

// A state with known values for some of its actions.
struct LabelledState {
  Observation observation;
  std::vector<std::int32_t> actions;
  std::vector<float> values;  // one an action
};

// Q values of observations: kActions for each, one after the other.
using QValues = std::function<std::vector<float>(std::span<const Observation* const>)>;
// The value of each observation: what the best goal in reach is worth, 0 where there is none.
using StateValues = std::function<std::vector<float>(std::span<const Observation* const>)>;

}  // namespace ivfm::host
