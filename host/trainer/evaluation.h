// The training side's own judgement: greedy episodes on validation seeds, many side by side.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "host/environment/arena_worlds.h"
#include "host/environment/exploration_environment.h"
#include "host/environment/network_state.h"
#include "host/trainer/observation.h"

namespace ivfm::host {

// Validation worlds have seeds from here on; training draws below 900,000, judged seeds begin at
// 1,000,000.
inline constexpr std::uint64_t kValidationSeeds = 950'000;

// Means over episodes: steps, RER, PE, distance and coverage over those that found their target
// (with no target: all).
struct Evaluation {
  int episodes = 0;
  int not_found = 0;
  double steps = 0;
  double re_exploration_rate = 0;  // RER of method.md
  double pixels_per_metre = 0;     // PE of method.md
  double distance_m = 0;
  double coverage = 0;
  double collisions = 0;
};

// Picks an action for each observation of one kind of state, -1 for none.
struct Policy {
  StateKind state_kind = StateKind::kIvfm;
  std::function<std::vector<int>(std::span<const Observation* const>)> choose;
  int threads = 1;  // that the episodes run on
};

// Episodes in arenas of `kind` with `agents` robots and a target, at most `cap` actions per agent.
Evaluation evaluate_arena(const Policy& policy, ArenaKind kind, int agents, int episodes, int cap);

}  // namespace ivfm::host
