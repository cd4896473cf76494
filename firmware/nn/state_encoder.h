// The network's two-channel state: the integrated visit frequency map (i-VFM) and the path map.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/geometry/grid_frame.h"
#include "shared/status/status.h"

namespace ivfm {

// Side of the policy grid: what the network sees and where it can send the robot.
inline constexpr int kPolicyCells = 32;
inline constexpr int kPolicyGridSize = kPolicyCells * kPolicyCells;
inline constexpr int kMaxPool = 16;

// The policy grid on the map: `pool` x `pool` map cells a policy cell, stored row by row from the
// lowest row, x to the east. The robot's map cell is the lower left one of policy cell (16, 16).
struct PolicyGrid {
  Cell origin;   // the lower left map cell of policy cell (0, 0)
  int pool = 1;  // 1 .. kMaxPool

  static constexpr PolicyGrid centred_on(Cell robot, int pool) {
    return {{robot.x - kPolicyCells / 2 * pool, robot.y - kPolicyCells / 2 * pool}, pool};
  }
  constexpr CellRect window() const {
    return {origin.x, origin.y, kPolicyCells * pool, kPolicyCells * pool};
  }
  // The map cells of policy cell `index` (0 .. kPolicyGridSize - 1).
  constexpr CellRect block(int index) const {
    return {origin.x + index % kPolicyCells * pool, origin.y + index / kPolicyCells * pool, pool,
            pool};
  }
  // The policy cell that holds `cell`, or -1 when the grid does not reach there.
  constexpr int index_of(Cell cell) const {
    if (!window().contains(cell)) return -1;
    return (cell.y - origin.y) / pool * kPolicyCells + (cell.x - origin.x) / pool;
  }
};

// i-VFM values in Q12: lambda * sigma(visits) with lambda = 10; lambda + epsilon, epsilon = 2, for
// obstacles and the robot (paper, section "Integrated Visit Frequency Maps").
inline constexpr int kIvfmLambda = 10;
inline constexpr int kIvfmEpsilon = 2;
inline constexpr std::uint16_t kIvfmBlocked = (kIvfmLambda + kIvfmEpsilon) << 12;  // 49152

namespace detail {

// exp(-x) for x >= 0 by exp(-x) = (exp(-x / 1024))^1024; only ever run by the compiler.
consteval double decaying_exponential(double x) {
  const double t = -x / 1024;
  double term = 1, power = 1;
  for (int n = 1; n < 20; ++n) power += (term *= t / n);
  for (int n = 0; n < 10; ++n) power *= power;
  return power;
}

consteval auto make_ivfm_table() {
  std::array<std::uint16_t, 256> table{};
  for (std::size_t v = 0; v < table.size(); ++v) {
    const double sigma = 1 / (1 + decaying_exponential(static_cast<double>(v)));
    table[v] = static_cast<std::uint16_t>(kIvfmLambda * 4096 * sigma + 0.5);
  }
  return table;
}

}  // namespace detail

// lambda * sigma(v) in Q12 of a free cell seen in v actions; v saturates at 255.
inline constexpr std::array<std::uint16_t, 256> kIvfmOfVisits = detail::make_ivfm_table();

// What the encoder reads of the map; the spans hold frame.size() cells in the order of GridFrame.
struct VisitView {
  GridFrame frame;
  std::span<const std::uint8_t> own_visits;
  std::span<const std::uint8_t> peer_visits;
  std::span<const std::uint8_t> flags;
  std::uint8_t obstacle_mask =
      0xff;  // a cell is a known obstacle when (flags & obstacle_mask) != 0
};

// Writes the i-VFM channel (Q12, kPolicyGridSize values): the mean over each policy cell's map
// cells, rounded to nearest. Cells whose centre lies within `robot_radius_um` of `robot` belong to
// the robot. Cells outside the map's window count as free and never visited.
// kInvalidArgument: a span's size or `grid.pool` is wrong, or `robot_radius_um` is negative.
Status encode_ivfm(const VisitView& view, const PolicyGrid& grid, Point robot,
                   std::int32_t robot_radius_um, std::span<std::uint16_t> out);

// The path channel: 1/256 policy cells, saturated at 64 policy cells.
inline constexpr std::uint16_t kPathSaturation = 64 * 256;
inline constexpr std::uint16_t kPathUnreachable = 65535;

// Distances from the robot over the map, one value a map cell.
struct PathView {
  GridFrame frame;
  std::span<const std::uint16_t> cost;
  std::uint16_t units_per_cell = 1;    // cost of one map cell's side, at most 4096
  std::uint16_t unreachable = 0xffff;  // costs from here on mean "cannot be reached"
};

// Writes the path channel (kPolicyGridSize values): the distance to the nearest reachable map cell
// of each policy cell. Cells outside the map's window are unreachable.
// kInvalidArgument: a span's size, `grid.pool` or `units_per_cell` is wrong.
Status encode_path(const PathView& view, const PolicyGrid& grid, std::span<std::uint16_t> out);

}  // namespace ivfm
