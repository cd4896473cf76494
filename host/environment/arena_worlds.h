// The paper's arenas: 1x, 2x and the two dividers, as random scenarios.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "host/environment/random.h"
#include "host/environment/scenario.h"

namespace ivfm::host {

enum class ArenaKind : std::uint8_t { k1x, k2x, kDivider, kDividerReleased };

// Measures of method.md, "The paper's arena world", in micrometres. All are whole truth cells.
namespace arena {
inline constexpr std::int32_t kCellUm = 5'000;  // of the truth bitmap
inline constexpr std::int32_t kColumnUm = 100'000;
inline constexpr std::int32_t kColumnGapUm = 80'000;  // between columns
inline constexpr std::int32_t kWallGapUm = 160'000;   // between a column and a wall
inline constexpr std::int32_t kRobotRadiusUm = 64'000;
inline constexpr std::int32_t kTargetUm = 44'000;  // side of the cube
}  // namespace arena

// "1x", "2x", "divider", "divider-released"; nothing for any other name.
std::optional<ArenaKind> arena_from_name(std::string_view name);
std::string_view name_of(ArenaKind kind);

// Side of the square arena in micrometres; the arena is centred on the map frame's origin.
std::int32_t side_um(ArenaKind kind);

// An axis-aligned box in micrometres, centred on the arena's middle like the map frame.
struct Box {
  std::int32_t x0_um = 0, y0_um = 0, x1_um = 0, y1_um = 0;
  constexpr bool operator==(const Box&) const = default;
};

// The obstacles of a random arena: 1 to 25 columns (1x), 1 to 50 (2x), or one strip.
std::vector<Box> random_obstacles(ArenaKind kind, Random& random);

// A random arena with `agents` robots that touch nothing and a target that overlaps no obstacle.
// The same seed gives the same scenario everywhere. Throws std::invalid_argument when `agents` is
// not 1 .. 32.
Scenario random_arena(ArenaKind kind, int agents, std::uint64_t seed);

// The same with a target at every place at once: wherever it overlaps no obstacle, 50 mm apart.
Scenario with_target_everywhere(Scenario arena);

}  // namespace ivfm::host
