// The float network as the explorer's Q function: policy `qnet-float`.
#pragma once

#include "firmware/nn/q_function.h"
#include "host/quantizer/float_network.h"

namespace ivfm::host {

class FloatQFunction final : public QFunction {
 public:
  // Throws std::invalid_argument when the network is malformed or not for the two-channel state.
  explicit FloatQFunction(const FloatNetwork& network);
  // Values are scaled so that the largest one in size is 2^30. kInvalidArgument: wrong size.
  Status evaluate(const LocalState& state, std::span<std::int32_t> q_values) override;

 private:
  FloatRunner runner_;
};

}  // namespace ivfm::host
