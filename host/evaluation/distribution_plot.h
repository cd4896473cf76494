// How many episodes were over after so many steps: one curve a policy, as SVG.
#pragma once

#include <span>
#include <string>

#include "host/evaluation/comparison.h"

namespace ivfm::host {

// The share of found episodes over the steps, on a logarithmic axis; a curve that ends below 1
// shows episodes that were not found. At most eight outcomes, each with an episode.
std::string distribution_svg(const std::string& title, std::span<const Outcome> outcomes);

}  // namespace ivfm::host
