// The states that networks are compared on: the paper's two, and one of a single channel.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "firmware/nn/model_format.h"
#include "firmware/planning/explorer.h"

namespace ivfm::host {

// Writes channels_of(kind) * kPolicyGridSize values for the explorer's last observed state:
// - kIvfm: i-VFM and path, as on board (LocalState);
// - kVfm, the paper's baseline: the share of each policy cell that the robot covers, the share that
//   is a known obstacle, the visits (their mean, saturated at 16; 1 is 3072), and the path.
//   Shares are of 49152;
// - kFoldedIvfm, which the paper names as future work: the path folded into the i-VFM. A cell in
//   reach has 5 + (i-VFM - 5) / 2 + 3 (1 - distance / 65 policy cells) in Q12, one out of reach its
//   i-VFM: what is blocked stays highest, and what is unseen and out of reach lowest.
// `pose`: where it was observed. Requires out.size() to be right.
void encode_network_state(StateKind kind, const Explorer& explorer, const Pose& pose,
                          std::span<std::uint16_t> out);

// "ivfm", "vfm" or "folded"; no value for anything else.
std::optional<StateKind> state_kind_from_name(std::string_view name);

}  // namespace ivfm::host
