// Which part of a world a robot can get to, on a grid of map cells.
#pragma once

#include <cstdint>
#include <vector>

#include "host/environment/ray_caster.h"
#include "shared/geometry/grid_frame.h"

namespace ivfm::host {

// The cells of `frame` on whose middle a disc of `radius_um` touches nothing and that are connected
// to `start` through such cells (four neighbours); 1 = yes, in the order of `frame`. The start
// itself always counts. Radius 0: the free area connected to `start`.
std::vector<std::uint8_t> reachable_centers(const RayCaster& rays, const GridFrame& frame,
                                            Cell start, std::int32_t radius_um);

// `cells` and every cell whose middle lies within `radius_um` of the middle of one of them.
std::vector<std::uint8_t> dilated(const std::vector<std::uint8_t>& cells, const GridFrame& frame,
                                  std::int32_t radius_um);

// The cells of a grid of `cell_um` that cover the world.
CellRect extent_of(const World& world, std::int32_t cell_um);

}  // namespace ivfm::host
