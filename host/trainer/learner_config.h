// How the learner learns, and what it is shown when it imitates. Free of libtorch.
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
  int siblings = 1;             // tried actions of a state that are learned together
  double target_rate = 0.005;   // share of the online weights that enters the target every step
  bool double_q = true;         // the online network chooses the target's action
  bool mask_target = true;      // goals out of reach are left out of the target's maximum
  bool symmetries = true;       // every sample is shown under a random symmetry
};

// A state with known values for some or all of its actions.
struct LabelledState {
  Observation observation;
  std::vector<std::int32_t> actions;
  std::vector<float> values;  // one an action
};

// Q values of observations: kActions for each, one after the other.
using QValues = std::function<std::vector<float>(std::span<const Observation* const>)>;

}  // namespace ivfm::host
