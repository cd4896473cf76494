#include "host/trainer/symmetry.h"

#include <utility>

namespace ivfm::host {

int transformed_action(int s, int action) {
  int x = action % kGridSide, y = action / kGridSide;
  if (s & 1) x = kGridSide - 1 - x;
  if (s & 2) y = kGridSide - 1 - y;
  if (s & 4) std::swap(x, y);
  return y * kGridSide + x;
}

State transformed(int s, const State& in) {
  State out;
  for (int cell = 0; cell < kActions; ++cell) {
    const auto to = static_cast<std::size_t>(transformed_action(s, cell));
    for (std::size_t c = 0; c < kMostChannels; ++c)
      out[c * kActions + to] = in[c * kActions + static_cast<std::size_t>(cell)];
  }
  return out;
}

ActionMask transformed(int s, const ActionMask& in) {
  ActionMask out;
  for (int cell = 0; cell < kActions; ++cell)
    if (in.test(cell)) out.set(transformed_action(s, cell));
  return out;
}

}  // namespace ivfm::host
