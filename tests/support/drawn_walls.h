// Rooms drawn as straight walls, and how far a lidar sees in them.
#pragma once

#include <cmath>
#include <vector>

namespace ivfm {

struct Wall {
  double x0, y0, x1, y1;  // metres
};

// 5 m by 4 m with a box in it: every direction has its walls.
inline const std::vector<Wall> kRoom{{-2, -1.5, 3, -1.5}, {3, -1.5, 3, 2.5},  {3, 2.5, -2, 2.5},
                                     {-2, 2.5, -2, -1.5}, {1, 0.8, 1.7, 0.8}, {1, 0.8, 1, 1.6}};
// Two walls without an end in sight.
inline const std::vector<Wall> kCorridor{{-50, -1.02, 50, -1.02}, {-50, 0.91, 50, 0.91}};

// Distance in metres from (x, y) along the ray at `angle` radians to the nearest wall, 0 when there
// is none within 12 m.
inline double cast_m(const std::vector<Wall>& walls, double x, double y, double angle) {
  double nearest = 12;
  const double c = std::cos(angle), s = std::sin(angle);
  for (const Wall& w : walls) {
    const double ex = w.x1 - w.x0, ey = w.y1 - w.y0;
    const double cross = c * ey - s * ex;
    if (std::abs(cross) < 1e-12) continue;
    const double along = ((w.x0 - x) * ey - (w.y0 - y) * ex) / cross;
    const double part = ((w.x0 - x) * s - (w.y0 - y) * c) / cross;
    if (along > 0 && along < nearest && part >= 0 && part <= 1) nearest = along;
  }
  return nearest < 12 ? nearest : 0;
}

}  // namespace ivfm
