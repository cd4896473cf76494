#include "host/environment/network_state.h"

#include <algorithm>

namespace ivfm::host {

namespace {

using Channel = std::span<std::uint16_t, kPolicyGridSize>;

constexpr std::uint32_t kWhole = 49152;        // a share of 1
constexpr std::uint32_t kVisit = kWhole / 16;  // one visit
constexpr std::uint32_t kNeverSeen = kIvfmOfVisits[0];

Channel channel(std::span<std::uint16_t> out, std::size_t index) {
  return Channel(out.data() + index * kPolicyGridSize, kPolicyGridSize);
}

// Means over the map cells of each policy cell.
void encode_vfm(const Explorer& explorer, const Pose& pose, std::span<std::uint16_t> out) {
  const PolicyGrid& grid = explorer.state().grid;
  const ExplorationMap& map = explorer.map();
  const MapLayers& layers = map.layers();
  const std::int64_t radius = explorer.config().robot_radius_um;
  const auto area = static_cast<std::uint32_t>(grid.pool * grid.pool);
  for (int i = 0; i < kPolicyGridSize; ++i) {
    const CellRect block = grid.block(i);
    std::uint32_t robot = 0, obstacles = 0, visits = 0;
    for (std::int32_t y = block.y; y < block.top(); ++y) {
      for (std::int32_t x = block.x; x < block.right(); ++x) {
        const Cell c{x, y};
        const Point center = map.frame().center_of(c);
        robot += squared_distance_um2(center, pose.position) <= radius * radius ? 1 : 0;
        if (!map.frame().contains(c)) continue;
        const std::size_t at = map.frame().index_of(c);
        obstacles += map.is_obstacle(c) ? 1 : 0;
        visits += std::min<std::uint32_t>(16, layers.own_visits[at] + layers.peer_visits[at]);
      }
    }
    const auto cell = static_cast<std::size_t>(i);
    channel(out, 0)[cell] = static_cast<std::uint16_t>(robot * kWhole / area);
    channel(out, 1)[cell] = static_cast<std::uint16_t>(obstacles * kWhole / area);
    channel(out, 2)[cell] = static_cast<std::uint16_t>(visits * kVisit / area);
  }
  std::ranges::copy(explorer.state().path(), channel(out, 3).begin());
}

std::uint16_t folded(std::uint32_t ivfm, std::uint32_t distance) {
  if (distance == kPathUnreachable) return static_cast<std::uint16_t>(ivfm);
  constexpr std::uint32_t kFurthest = 65 * 256, kNearest = 3 << 12;
  const std::uint32_t closeness = kNearest - kNearest / 256 * distance / (kFurthest / 256);
  const std::uint32_t seen = std::max(ivfm, kNeverSeen) - kNeverSeen;
  return static_cast<std::uint16_t>(kNeverSeen + seen / 2 + closeness);
}

}  // namespace

void encode_network_state(StateKind kind, const Explorer& explorer, const Pose& pose,
                          std::span<std::uint16_t> out) {
  const LocalState& state = explorer.state();
  if (kind == StateKind::kVfm) return encode_vfm(explorer, pose, out);
  if (kind == StateKind::kIvfm) {
    std::ranges::copy(state.channels, out.begin());
    return;
  }
  std::ranges::transform(state.ivfm(), state.path(), out.begin(), folded);
}

std::optional<StateKind> state_kind_from_name(std::string_view name) {
  if (name == "ivfm") return StateKind::kIvfm;
  if (name == "vfm") return StateKind::kVfm;
  if (name == "folded") return StateKind::kFoldedIvfm;
  return std::nullopt;
}

}  // namespace ivfm::host
