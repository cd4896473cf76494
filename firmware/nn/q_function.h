// The state of a decision and the function that values every policy cell as a goal.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "firmware/nn/state_encoder.h"
#include "shared/status/status.h"

namespace ivfm {

// The two-channel i-VFM state, see state_encoder.h: the channels one after the other.
struct LocalState {
  PolicyGrid grid;
  std::array<std::uint16_t, 2 * kPolicyGridSize> channels;

  using Channel = std::span<std::uint16_t, kPolicyGridSize>;
  using ConstChannel = std::span<const std::uint16_t, kPolicyGridSize>;
  Channel ivfm() { return Channel(channels.data(), kPolicyGridSize); }
  Channel path() { return Channel(channels.data() + kPolicyGridSize, kPolicyGridSize); }
  ConstChannel ivfm() const { return ConstChannel(channels.data(), kPolicyGridSize); }
  ConstChannel path() const {
    return ConstChannel(channels.data() + kPolicyGridSize, kPolicyGridSize);
  }
};

// The onboard int8 network, or a float reference on the host.
class QFunction {
 public:
  // Writes kPolicyGridSize values in any common scale: the greatest is the best goal.
  // kUnavailable: no model is loaded; kInvalidArgument: wrong size.
  virtual Status evaluate(const LocalState& state, std::span<std::int32_t> q_values) = 0;
  // What 100 newly seen policy cells are worth in the values of the last evaluate(); 0: unknown.
  virtual std::int32_t unit() const { return 0; }

 protected:
  ~QFunction() = default;
};

}  // namespace ivfm
