#include "host/environment/ray_caster.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace ivfm::host {

namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

// Distance along the unit direction (dx, dy) at which a point at (px, py) relative to a circle's
// centre enters the circle; kNever when it does not or is moving away.
double enter_circle(double px, double py, double dx, double dy, double radius) {
  const double along = px * dx + py * dy;
  if (along >= 0) return kNever;  // moving away
  const double gap2 = px * px + py * py - radius * radius;
  if (gap2 <= 0) return 0;
  const double discriminant = along * along - gap2;
  return discriminant < 0 ? kNever : -along - std::sqrt(discriminant);
}

// Entry distance into the slab [low, high] of one axis, and exit.
std::pair<double, double> slab(double p, double d, double low, double high) {
  if (d == 0) {
    return p > low && p < high ? std::pair{-kNever, kNever} : std::pair{kNever, -kNever};
  }
  const double a = (low - p) / d, b = (high - p) / d;
  return {std::min(a, b), std::max(a, b)};
}

// Entry of a point into a box; kNever when it misses the box or moves out of it.
double enter_box(double px, double py, double dx, double dy, double x0, double y0, double x1,
                 double y1) {
  const auto [in_x, out_x] = slab(px, dx, x0, x1);
  const auto [in_y, out_y] = slab(py, dy, y0, y1);
  const double in = std::max(in_x, in_y), out = std::min(out_x, out_y);
  if (in >= out || out <= 0) return kNever;
  if (in >= 0) return in;
  return -in <= out ? 0 : kNever;  // inside: nearer to the entry means it is driving in
}

// A cell's clearance is at most one more than its neighbour's. Here for a row of `width` cells and
// the three neighbours of each in the row beside it.
void lower_by_row(const std::uint8_t* beside, std::uint8_t* row, std::int64_t width) {
  for (std::int64_t x = 0; x < width; ++x) {
    const std::uint8_t ends = beside[x - 1] < beside[x + 1] ? beside[x - 1] : beside[x + 1];
    const std::uint8_t least = ends < beside[x] ? ends : beside[x];
    const auto limit = static_cast<std::uint8_t>(least + (least < 255 ? 1 : 0));
    row[x] = row[x] < limit ? row[x] : limit;
  }
}

// The same along a row from `first` on, where `kBefore` (-1 or 1) says on which side of a cell the
// one before it lies. After the rows beside it hardly a cell is still too high, so many at once are
// looked at first: a quarter of the time that one after the other takes.
template <int kBefore>
void lower_along(std::uint8_t* first, std::int64_t width) {
  constexpr std::int64_t kAtOnce = 64;
  for (std::int64_t done = 0; done < width; done += kAtOnce) {
    const std::int64_t count = std::min(kAtOnce, width - done);
    std::uint8_t* const low = kBefore < 0 ? first + done : first - done - count + 1;
    std::uint8_t too_high = 0;
    for (std::int64_t i = 0; i < count; ++i) {
      const std::uint8_t beside = low[i + kBefore], here = low[i] > 1 ? low[i] : std::uint8_t{1};
      const auto limit = static_cast<std::uint8_t>(here - 1);
      too_high |= (limit > beside ? limit : beside) ^ beside;
    }
    if (too_high == 0) continue;
    std::uint8_t* cell = first - kBefore * done;
    for (std::int64_t i = 0; i < count; ++i, cell -= kBefore) {
      *cell = static_cast<std::uint8_t>(std::min<int>(*cell, cell[kBefore] + 1));
    }
  }
}

}  // namespace

double travel_until_box_um(Point from, Point to, std::int32_t radius_um, double x0, double y0,
                           double x1, double y1) {
  const double vx = static_cast<double>(to.x_um) - from.x_um;
  const double vy = static_cast<double>(to.y_um) - from.y_um;
  const double length = std::sqrt(vx * vx + vy * vy);
  if (length == 0) return 0;
  const double dx = vx / length, dy = vy / length;
  const double px = from.x_um, py = from.y_um, r = radius_um;
  double first = std::min(enter_box(px, py, dx, dy, x0 - r, y0, x1 + r, y1),
                          enter_box(px, py, dx, dy, x0, y0 - r, x1, y1 + r));
  for (const double cx : {x0, x1}) {
    for (const double cy : {y0, y1}) {
      first = std::min(first, enter_circle(px - cx, py - cy, dx, dy, r));
    }
  }
  return std::min(first, length);
}

RayCaster::RayCaster(std::shared_ptr<const World> world) : world_(std::move(world)) {
  if (!world_ || world_->cell_um <= 0 || world_->width <= 0 || world_->height <= 0) {
    throw std::invalid_argument("the world is empty: it needs at least one cell");
  }
  const auto cells =
      static_cast<std::size_t>(world_->width) * static_cast<std::size_t>(world_->height);
  if (world_->occupied.size() != cells) {
    throw std::invalid_argument("the world's bitmap does not match its width and height");
  }
  build_clearance();
}

// Two passes of the chessboard distance transform (Rosenfeld and Pfaltz 1966), saturating at 255.
// In each row first what comes from the row before, for all cells at once, then along the row.
void RayCaster::build_clearance() {
  const std::int64_t w = world_->width, h = world_->height;
  stride_ = w + 2;
  clearance_.assign(static_cast<std::size_t>(stride_ * (h + 2)), 0);
  for (std::int64_t y = 0; y < h; ++y) {
    const std::uint8_t* source = &world_->occupied[static_cast<std::size_t>(y * w)];
    std::uint8_t* row = &clearance_[padded_index(0, y)];
    for (std::int64_t x = 0; x < w; ++x) row[x] = source[x] != 0 ? 0 : 255;
    lower_by_row(row - stride_, row, w);
    lower_along<-1>(row, w);
  }
  for (std::int64_t y = h - 1; y >= 0; --y) {
    std::uint8_t* row = &clearance_[padded_index(0, y)];
    lower_by_row(row + stride_, row, w);
    lower_along<1>(row + w - 1, w);
  }
}

// Follows the unit direction (dx, dy) cell by cell (Amanatides and Woo 1987); where the clearance
// allows, strides over several cells at once.
double RayCaster::trace(Point from, double dx, double dy, double max_um) const {
  const double cell = world_->cell_um, inverse_cell = 1.0 / cell;
  const double x = static_cast<double>(from.x_um) - world_->origin.x_um;
  const double y = static_cast<double>(from.y_um) - world_->origin.y_um;
  if (x < 0 || y < 0) return 0;
  auto cx = static_cast<std::int64_t>(x * inverse_cell);
  auto cy = static_cast<std::int64_t>(y * inverse_cell);
  if (cx >= world_->width || cy >= world_->height) return 0;
  const int step_x = dx < 0 ? -1 : 1, step_y = dy < 0 ? -1 : 1;
  const double inverse_dx = dx == 0 ? kNever : 1.0 / dx, inverse_dy = dy == 0 ? kNever : 1.0 / dy;
  // A stride this many times the clearance cannot leave the clear square, rounding included.
  const double stride = 0.999 * cell / std::max(std::abs(dx), std::abs(dy));
  double t = 0;
  while (t <= max_um) {
    const std::uint8_t clear = clearance_[padded_index(cx, cy)];
    if (clear == 0) return t;
    if (clear > 1) {
      t += (clear - 1) * stride;
      cx = static_cast<std::int64_t>((x + t * dx) * inverse_cell);  // inside: never below 0
      cy = static_cast<std::int64_t>((y + t * dy) * inverse_cell);
      continue;
    }
    const double edge_x = static_cast<double>(cx + (step_x > 0)) * cell;
    const double edge_y = static_cast<double>(cy + (step_y > 0)) * cell;
    const double tx = dx == 0 ? kNever : (edge_x - x) * inverse_dx;
    const double ty = dy == 0 ? kNever : (edge_y - y) * inverse_dy;
    if (tx < ty) {
      cx += step_x;
      t = tx;
    } else {
      cy += step_y;
      t = ty;
    }
  }
  return kNever;
}

std::int32_t RayCaster::cast_um(Point from, BinaryAngle bearing, std::int32_t max_um) const {
  const double hit = trace(from, cos_q30(bearing) * 0x1p-30, sin_q30(bearing) * 0x1p-30, max_um);
  return hit < max_um ? static_cast<std::int32_t>(hit) : max_um;
}

bool RayCaster::line_of_sight(Point from, Point to) const {
  const double vx = static_cast<double>(to.x_um) - from.x_um;
  const double vy = static_cast<double>(to.y_um) - from.y_um;
  const double length = std::sqrt(vx * vx + vy * vy);
  if (length == 0) return !world_->is_occupied(from);
  return trace(from, vx / length, vy / length, length) > length;
}

bool RayCaster::disc_is_free(Point center, std::int32_t radius_um) const {
  const double cell = world_->cell_um;
  const double x = static_cast<double>(center.x_um) - world_->origin.x_um;
  const double y = static_cast<double>(center.y_um) - world_->origin.y_um;
  if (x < 0 || y < 0 || x >= cell * world_->width || y >= cell * world_->height) return false;
  const std::size_t middle =
      padded_index(static_cast<std::int64_t>(x / cell), static_cast<std::int64_t>(y / cell));
  if ((clearance_[middle] - 1) * cell > radius_um) return true;
  return !nearest_obstacle(center, radius_um).has_value();
}

std::optional<Point> RayCaster::nearest_obstacle(Point center, std::int32_t radius_um) const {
  const double cell = world_->cell_um, r = radius_um;
  const double x = static_cast<double>(center.x_um) - world_->origin.x_um;
  const double y = static_cast<double>(center.y_um) - world_->origin.y_um;
  const auto cell_of = [&](double v, std::int32_t cells) {  // the border counts as one cell
    return std::clamp<std::int64_t>(static_cast<std::int64_t>(std::floor(v / cell)), -1, cells);
  };
  double nearest2 = r * r;
  std::optional<Point> nearest;
  for (std::int64_t cy = cell_of(y - r, world_->height); cy <= cell_of(y + r, world_->height);
       ++cy) {
    const double low_y = static_cast<double>(cy) * cell;
    const double near_y = std::clamp(y, low_y, low_y + cell);
    for (std::int64_t cx = cell_of(x - r, world_->width); cx <= cell_of(x + r, world_->width);
         ++cx) {
      if (clearance_[padded_index(cx, cy)] != 0) continue;
      const double low_x = static_cast<double>(cx) * cell;
      const double near_x = std::clamp(x, low_x, low_x + cell);
      const double gap2 = (near_x - x) * (near_x - x) + (near_y - y) * (near_y - y);
      if (gap2 >= nearest2) continue;
      nearest2 = gap2;
      nearest = Point{static_cast<std::int32_t>(std::floor(near_x)) + world_->origin.x_um,
                      static_cast<std::int32_t>(std::floor(near_y)) + world_->origin.y_um};
    }
  }
  return nearest;
}

double RayCaster::free_travel_um(Point from, Point to, std::int32_t radius_um) const {
  const double vx = static_cast<double>(to.x_um) - from.x_um;
  const double vy = static_cast<double>(to.y_um) - from.y_um;
  double travel = std::sqrt(vx * vx + vy * vy);
  const std::int64_t cell = world_->cell_um, ox = world_->origin.x_um, oy = world_->origin.y_um;
  const auto cell_below = [cell](std::int64_t v) { return (v >= 0 ? v : v - cell + 1) / cell; };
  // Cells that the moving disc can touch; one ring of the world outside counts as occupied.
  const std::int64_t x0 = std::max<std::int64_t>(
      cell_below(std::min(from.x_um, to.x_um) - std::int64_t{radius_um} - ox), -1);
  const std::int64_t y0 = std::max<std::int64_t>(
      cell_below(std::min(from.y_um, to.y_um) - std::int64_t{radius_um} - oy), -1);
  const std::int64_t x1 = std::min<std::int64_t>(
      cell_below(std::max(from.x_um, to.x_um) + std::int64_t{radius_um} - ox), world_->width);
  const std::int64_t y1 = std::min<std::int64_t>(
      cell_below(std::max(from.y_um, to.y_um) + std::int64_t{radius_um} - oy), world_->height);
  for (std::int64_t cy = y0; cy <= y1; ++cy) {
    for (std::int64_t cx = x0; cx <= x1; ++cx) {
      const std::size_t index = padded_index(cx, cy);
      if (clearance_[index] != 0) continue;
      const bool is_inner = cx > 0 && cy > 0 && cx + 1 < world_->width && cy + 1 < world_->height &&
                            clearance_[index - 1] == 0 && clearance_[index + 1] == 0 &&
                            clearance_[index - static_cast<std::size_t>(stride_)] == 0 &&
                            clearance_[index + static_cast<std::size_t>(stride_)] == 0;
      if (is_inner) continue;  // its neighbours are touched first
      const auto low_x = static_cast<double>(ox + cx * cell);
      const auto low_y = static_cast<double>(oy + cy * cell);
      const auto side = static_cast<double>(cell);
      travel = std::min(travel, travel_until_box_um(from, to, radius_um, low_x, low_y, low_x + side,
                                                    low_y + side));
    }
  }
  return travel;
}

}  // namespace ivfm::host
