// The float network as the explorer's Q function: policy `qnet-float`.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "firmware/nn/q_function.h"
#include "host/quantizer/float_network.h"

namespace ivfm::host {

class FloatQFunction final : public QFunction {
 public:
  // Writes the state that the network expects, for the state that is to be judged.
  using Encoder = std::function<void(const LocalState&, std::span<std::uint16_t>)>;

  // Throws std::invalid_argument when the network is malformed, or not for the two-channel state
  // and there is no encoder.
  explicit FloatQFunction(const FloatNetwork& network, Encoder encoder = {});
  // Values are scaled so that the largest one in size, or 1 where none is larger, is 2^30.
  // kInvalidArgument: wrong size.
  Status evaluate(const LocalState& state, std::span<std::int32_t> q_values) override;
  std::int32_t unit() const override { return unit_; }

 private:
  FloatRunner runner_;
  Encoder encoder_;
  std::vector<std::uint16_t> input_;
  std::int32_t unit_ = 0;
};

}  // namespace ivfm::host
