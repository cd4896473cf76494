#include "host/simulator/mrpt_lidar.h"

#include <mrpt/maps/COccupancyGridMap2D.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace ivfm::host {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr float kFreeProbability = 0.99f;
constexpr float kFreeThreshold = 0.4f;
// MRPT 2.5.8 walks a ray in steps of this share of a cell, with components rounded to 1/1024 cell:
// a quarter keeps an edge within 0.6 cm (5 cm cells) and the direction within 0.12 degrees.
constexpr double kStepInCells = 0.25;

}  // namespace

struct MrptLidar::Grid {
  mrpt::maps::COccupancyGridMap2D map;
  double origin_x_m = 0;  // MRPT's grid has its corner at (0, 0): its limits are only floats
  double origin_y_m = 0;
};

LidarModel LidarModel::preset(const std::string& name) {
  if (name == "mild") return {};
  if (name == "none") return {.noise_m = 0, .noise_share = 0, .dropout = 0};
  throw std::invalid_argument("lidar noise '" + name + "' is unknown: use none or mild");
}

MrptLidar::MrptLidar(const World& world, const LidarModel& model, std::uint64_t seed)
    : grid_(std::make_unique<Grid>()), model_(model), random_(seed) {
  mrpt::maps::COccupancyGridMap2D::RAYTRACE_STEP_SIZE_IN_CELL_UNITS = kStepInCells;
  const float cell_m = static_cast<float>(world.cell_um) / 1e6f;
  grid_->origin_x_m = world.origin.x_um / 1e6;
  grid_->origin_y_m = world.origin.y_um / 1e6;
  grid_->map.setSize(0, cell_m * static_cast<float>(world.width), 0,
                     cell_m * static_cast<float>(world.height), cell_m);
  take_world(world);
}

MrptLidar::~MrptLidar() = default;

void MrptLidar::take_world(const World& world) {
  for (int y = 0; y < world.height; ++y) {
    for (int x = 0; x < world.width; ++x) {
      const bool occupied = world.occupied[static_cast<std::size_t>(y) * world.width + x];
      grid_->map.setCell(x, y, occupied ? 1 - kFreeProbability : kFreeProbability);
    }
  }
}

double MrptLidar::true_range_m(const TruePose& robot, double bearing_rad,
                               std::span<const TruePose> others, double other_radius_m) const {
  const double angle = robot.heading_rad + bearing_rad;
  float range = 0;
  bool valid = false;
  // MRPT 2.5.8 counts steps against the largest range as if each were a whole cell.
  grid_->map.simulateScanRay(robot.x_m - grid_->origin_x_m, robot.y_m - grid_->origin_y_m, angle,
                             range, valid, model_.max_range_m / kStepInCells, kFreeThreshold);
  const double half_step_m = kStepInCells * grid_->map.getResolution() / 2;
  double nearest = valid ? std::max(0.0, range - half_step_m) : kInfinity;
  for (const TruePose& other : others) {
    nearest = std::min(nearest, ray_to_disc_m(robot.x_m, robot.y_m, angle, other, other_radius_m));
  }
  return nearest;
}

LidarSample MrptLidar::measure(const TruePose& robot, double bearing_rad,
                               std::span<const TruePose> others, double other_radius_m) {
  const double true_range = true_range_m(robot, bearing_rad, others, other_radius_m);
  std::normal_distribution<double> normal;
  const double error = normal(random_) * (model_.noise_m + model_.noise_share * true_range);
  const bool dropped = static_cast<double>(random_() >> 11) * 0x1p-53 < model_.dropout;
  if (dropped || true_range < model_.min_range_m || true_range > model_.max_range_m) return {};
  const double measured_mm = std::clamp((true_range + error) * 1000, 1.0, 16383.0);
  // The device's quality falls with range; its scale is not documented.
  const auto quality = static_cast<std::uint8_t>(47 - std::lround(32 * true_range / 12));
  return {static_cast<std::uint16_t>(std::lround(measured_mm)), quality};
}

void MrptLidar::measure(const TruePose& robot, std::span<ScanPoint> beams,
                        std::span<const TruePose> others, double other_radius_m) {
  for (ScanPoint& beam : beams) {
    const LidarSample sample = measure(robot, beam.bearing.radians(), others, other_radius_m);
    beam.range_mm = sample.range_mm;
    beam.quality = sample.quality;
    beam.echo = sample.range_mm > 0 ? Echo::kHit : Echo::kNothing;
  }
}

}  // namespace ivfm::host
