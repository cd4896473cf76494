// The eight symmetries of the square grid, on states, masks and actions together.
#pragma once

#include <span>

#include "host/trainer/observation.h"

namespace ivfm::host {

inline constexpr int kSymmetries = 8;

// Where policy cell `action` goes under symmetry `s` (0 = identity; bit 0 mirrors x, bit 1 mirrors
// y, bit 2 then swaps x and y). A bijection of [0, kActions).
int transformed_action(int s, int action);

// Moves every cell of `in` to its place under symmetry `s`.
State transformed(int s, const State& in);
ActionMask transformed(int s, const ActionMask& in);

}  // namespace ivfm::host
