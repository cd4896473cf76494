#include "host/simulator/world_region.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <random>
#include <stdexcept>
#include <string>

namespace ivfm::host {
namespace {

// Cells of `passable` connected over edges to cell `start`.
std::vector<std::uint8_t> flood(const World& world, const std::vector<std::uint8_t>& passable,
                                std::size_t start) {
  std::vector<std::uint8_t> reached(passable.size(), 0);
  if (!passable[start]) return reached;
  std::vector<std::size_t> open{start};
  reached[start] = 1;
  const auto width = static_cast<std::size_t>(world.width);
  const auto visit = [&](std::size_t cell) {
    if (!passable[cell] || reached[cell]) return;
    reached[cell] = 1;
    open.push_back(cell);
  };
  while (!open.empty()) {
    const std::size_t cell = open.back();
    open.pop_back();
    if (cell % width > 0) visit(cell - 1);
    if (cell % width + 1 < width) visit(cell + 1);
    if (cell >= width) visit(cell - width);
    if (cell + width < passable.size()) visit(cell + width);
  }
  return reached;
}

// The index of the cell that holds `p`; the number of cells when `p` is outside.
std::size_t index_at(const World& world, Point p) {
  const std::int64_t dx = std::int64_t{p.x_um} - world.origin.x_um;
  const std::int64_t dy = std::int64_t{p.y_um} - world.origin.y_um;
  if (dx < 0 || dy < 0) return world.occupied.size();
  const std::int64_t x = dx / world.cell_um, y = dy / world.cell_um;
  if (x >= world.width || y >= world.height) return world.occupied.size();
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(world.width) +
         static_cast<std::size_t>(x);
}

std::vector<std::uint8_t> flood_from(const World& world, const std::vector<std::uint8_t>& passable,
                                     Point start) {
  const std::size_t cell = index_at(world, start);
  if (cell >= passable.size()) return std::vector<std::uint8_t>(passable.size(), 0);
  return flood(world, passable, cell);
}

// The largest connected part of `passable`, as cell indices in ascending order.
std::vector<std::size_t> largest_part(const World& world, std::vector<std::uint8_t> passable) {
  std::vector<std::size_t> best;
  for (std::size_t cell = 0; cell < passable.size(); ++cell) {
    if (!passable[cell]) continue;
    const std::vector<std::uint8_t> part = flood(world, passable, cell);
    std::vector<std::size_t> cells;
    for (std::size_t i = cell; i < part.size(); ++i) {
      if (!part[i]) continue;
      cells.push_back(i);
      passable[i] = 0;
    }
    if (cells.size() > best.size()) best = std::move(cells);
  }
  return best;
}

}  // namespace

std::vector<std::uint8_t> cells_with_clearance(const World& world, std::int32_t radius_um) {
  // A border of obstacles, because everything outside the bitmap is occupied.
  cv::Mat space(world.height + 2, world.width + 2, CV_8U, cv::Scalar(0));
  for (std::int32_t y = 0; y < world.height; ++y) {
    for (std::int32_t x = 0; x < world.width; ++x) {
      const auto index = static_cast<std::size_t>(y) * static_cast<std::size_t>(world.width) +
                         static_cast<std::size_t>(x);
      space.at<std::uint8_t>(y + 1, x + 1) = world.occupied[index] ? 0 : 255;
    }
  }
  cv::Mat distance;  // to the nearest obstacle cell's centre, in cells
  cv::distanceTransform(space, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  const auto needed = static_cast<float>(radius_um) / static_cast<float>(world.cell_um) + 0.5f;
  std::vector<std::uint8_t> clear(world.occupied.size());
  for (std::size_t i = 0; i < clear.size(); ++i) {
    const auto x = static_cast<int>(i % static_cast<std::size_t>(world.width));
    const auto y = static_cast<int>(i / static_cast<std::size_t>(world.width));
    clear[i] = distance.at<float>(y + 1, x + 1) > needed ? 1 : 0;
  }
  return clear;
}

std::vector<std::uint8_t> reachable_cells(const World& world, Point start, std::int32_t radius_um) {
  return flood_from(world, cells_with_clearance(world, radius_um), start);
}

std::vector<std::uint8_t> visible_region(const World& world, Point start) {
  std::vector<std::uint8_t> free(world.occupied.size());
  std::transform(world.occupied.begin(), world.occupied.end(), free.begin(),
                 [](std::uint8_t occupied) { return occupied ? 0 : 1; });
  return flood_from(world, free, start);
}

Point cell_center(const World& world, std::int32_t column, std::int32_t row) {
  return {world.origin.x_um + column * world.cell_um + world.cell_um / 2,
          world.origin.y_um + row * world.cell_um + world.cell_um / 2};
}

std::vector<Pose> random_start_poses(const World& world, int count, std::int32_t radius_um,
                                     std::uint64_t seed) {
  if (count < 1 || count > 64) throw std::runtime_error("the number of robots must be 1 to 64");
  constexpr std::int32_t kMarginUm = 100'000;
  constexpr std::int64_t kApartUm = 500'000;
  const std::vector<std::size_t> cells =
      largest_part(world, cells_with_clearance(world, radius_um + kMarginUm));
  std::mt19937_64 random(seed);  // its output is fixed by the C++ standard
  std::vector<Pose> poses;
  for (int attempt = 0; attempt < 10'000 && !cells.empty(); ++attempt) {
    const std::size_t cell = cells[random() % cells.size()];
    const auto width = static_cast<std::size_t>(world.width);
    const Point place = cell_center(world, static_cast<std::int32_t>(cell % width),
                                    static_cast<std::int32_t>(cell / width));
    const BinaryAngle heading(static_cast<std::uint16_t>(random() & 0xffffu));
    const bool apart = std::all_of(poses.begin(), poses.end(), [&](const Pose& other) {
      return squared_distance_um2(place, other.position) >= kApartUm * kApartUm;
    });
    if (apart) poses.push_back({place, heading});
    if (static_cast<int>(poses.size()) == count) return poses;
  }
  throw std::runtime_error("world " + world.name + " has no room for " + std::to_string(count) +
                           " robots at least 0.5 m apart");
}

}  // namespace ivfm::host
