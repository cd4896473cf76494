#include "host/quantizer/float_q_function.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace ivfm::host {

FloatQFunction::FloatQFunction(const FloatNetwork& network) : runner_(network) {
  if (network.state_kind != StateKind::kIvfm)
    throw std::invalid_argument("the network is not for the two-channel i-VFM state");
}

Status FloatQFunction::evaluate(const LocalState& state, std::span<std::int32_t> q_values) {
  if (q_values.size() != kPolicyGridSize) return Status::kInvalidArgument;
  const std::span<const float> values = runner_.run(state.channels);
  double largest = 1e-30;
  for (const float v : values) largest = std::max<double>(largest, std::abs(v));
  std::transform(values.begin(), values.end(), q_values.begin(), [largest](float v) {
    return static_cast<std::int32_t>(std::lround(v / largest * 0x1p30));
  });
  return Status::kOk;
}

}  // namespace ivfm::host
