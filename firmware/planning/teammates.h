// Where the other robots of the team are: what one of them is nearer to is better left to it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/mapping/shortest_path_map.h"

namespace ivfm {

class Teammates {
 public:
  static constexpr std::size_t kMost = 8;
  static constexpr std::int32_t kWhole = 256;

  // Of more than kMost the first ones.
  void set(std::span<const Cell> places);
  std::span<const Cell> places() const { return std::span(places_).first(size_); }

  // How much of what there is at `goal` counts for a robot that drives there at a cost of
  // `path_cost` (see ShortestPathMap), in 256ths: all of it where no teammate is nearer, else as
  // much less as the way of the nearest is shorter, were nothing in its way. To both ways
  // `detour` is added, so nothing is left altogether to a teammate, which may have other plans.
  std::int32_t share_left(Cell goal, std::int32_t path_cost, std::int32_t detour) const;

 private:
  std::array<Cell, kMost> places_{};
  std::size_t size_ = 0;
};

}  // namespace ivfm
