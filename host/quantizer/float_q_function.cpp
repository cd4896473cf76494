#include "host/quantizer/float_q_function.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace ivfm::host {

FloatQFunction::FloatQFunction(const FloatNetwork& network, Encoder encoder)
    : runner_(network), encoder_(std::move(encoder)) {
  if (network.state_kind != StateKind::kIvfm && !encoder_)
    throw std::invalid_argument("the network is not for the two-channel i-VFM state");
  input_.resize(network.inputs.size() * kPolicyGridSize);
}

Status FloatQFunction::evaluate(const LocalState& state, std::span<std::int32_t> q_values) {
  if (q_values.size() != kPolicyGridSize) return Status::kInvalidArgument;
  if (encoder_) encoder_(state, input_);
  const std::span<const float> values =
      encoder_ ? runner_.run(input_) : runner_.run(state.channels);
  double largest = 1;
  for (const float v : values) largest = std::max<double>(largest, std::abs(v));
  std::transform(values.begin(), values.end(), q_values.begin(), [largest](float v) {
    return static_cast<std::int32_t>(std::lround(v / largest * 0x1p30));
  });
  unit_ = static_cast<std::int32_t>(0x1p30 / largest);
  return Status::kOk;
}

}  // namespace ivfm::host
