// The layers of the map that robots share.
#pragma once

#include <cstddef>
#include <cstdint>

namespace ivfm {

enum class Layer : std::uint8_t {
  kVisits = 0,     // counts 0..255, saturating: actions in which the robot saw the cell
  kObstacles = 1,  // 0 or 1: the robot holds the cell to be occupied
};

inline constexpr std::size_t kLayerCount = 2;

}  // namespace ivfm
