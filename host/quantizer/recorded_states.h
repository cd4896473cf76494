// States that a policy meets, for quantizing it and for judging how well that went.
#pragma once

#include <cstdint>
#include <vector>

#include "firmware/nn/q_function.h"

namespace ivfm::host {

struct RecordedStates {
  std::vector<std::uint16_t> states;  // one after the other, each: channels * 1024 values
  std::vector<std::uint8_t> masks;    // 1024 a state: which policy cells could be goals
};

// Plays fresh episodes with `q` and records `count` states in which it chose a goal: half in the 1x
// arena, a sixth each in 2x, divider and generated buildings, there every tenth one. Two-channel
// states only.
RecordedStates record_states(QFunction& q, int count, std::uint64_t seed);

}  // namespace ivfm::host
