// Geometry queries on a world's bitmap: rays, lines of sight, and where a disc touches something.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "host/environment/world.h"
#include "shared/geometry/binary_angle.h"
#include "shared/geometry/pose.h"

namespace ivfm::host {

// Exact on the bitmap: cells are squares and a ray ends on the first occupied square's edge. Keeps
// a clearance map (Chebyshev distance to the nearest occupied cell), so that a ray crosses open
// space in a few strides.
class RayCaster {
 public:
  // Throws std::invalid_argument when the bitmap is empty or its size does not match its sides.
  explicit RayCaster(std::shared_ptr<const World> world);

  // Distance from `from` along `bearing` to the first occupied cell; `max_um` when there is none
  // up to there. 0 inside an obstacle.
  std::int32_t cast_um(Point from, BinaryAngle bearing, std::int32_t max_um) const;

  // Nothing occupied on the segment between the points, ends included.
  bool line_of_sight(Point from, Point to) const;

  // A disc of `radius_um` at `center` touches no occupied cell.
  bool disc_is_free(Point center, std::int32_t radius_um) const;

  // The point of an occupied cell that lies nearest to `center`, if one is within `radius_um`.
  std::optional<Point> nearest_obstacle(Point center, std::int32_t radius_um) const;

  // How far a disc of `radius_um` moves from `from` straight towards `to` before it touches an
  // occupied cell; the whole distance when it does not. Leaving a contact is allowed: only cells
  // that come nearer stop it.
  double free_travel_um(Point from, Point to, std::int32_t radius_um) const;

  const World& world() const { return *world_; }

 private:
  std::size_t padded_index(std::int64_t cx, std::int64_t cy) const {
    return static_cast<std::size_t>((cy + 1) * stride_ + cx + 1);
  }
  double trace(Point from, double dx, double dy, double max_um) const;
  void build_clearance();

  std::shared_ptr<const World> world_;
  std::int64_t stride_ = 0;
  // (width + 2) x (height + 2): 0 on occupied cells and on the border around the bitmap.
  std::vector<std::uint8_t> clearance_;
};

// How far a disc of `radius_um` moves from `from` straight towards `to` before it touches the box
// [x0, x1] x [y0, y1] (micrometres); the whole distance when it does not, or when it moves away.
double travel_until_box_um(Point from, Point to, std::int32_t radius_um, double x0, double y0,
                           double x1, double y1);

}  // namespace ivfm::host
