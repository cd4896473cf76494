#include "host/simulator/robot_body.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace ivfm::host {

TruePose to_true_pose(const Pose& pose) {
  return {pose.position.x_um / 1e6, pose.position.y_um / 1e6, pose.heading.radians()};
}

OdometryNoise OdometryNoise::preset(const std::string& name) {
  if (name == "none") return {};
  if (name == "mild") {
    return {.radius_error = 0.0001, .wheel_base_error = 0.001, .slip_m_per_sqrt_m = 0.0005};
  }
  if (name == "turtlebot") {
    return {.radius_error = 0.0005, .wheel_base_error = 0.01, .slip_m_per_sqrt_m = 0.0015};
  }
  if (name == "harsh") {
    return {.radius_error = 0.002, .wheel_base_error = 0.03, .slip_m_per_sqrt_m = 0.004};
  }
  throw std::invalid_argument("odometry noise '" + name +
                              "' is unknown: use none, mild, turtlebot or harsh");
}

RobotBody::RobotBody(const BodyShape& shape, const TruePose& start, const OdometryNoise& noise,
                     std::uint64_t seed)
    : shape_(shape), pose_(start), slip_m_per_sqrt_m_(noise.slip_m_per_sqrt_m), random_(seed) {
  std::normal_distribution<double> normal;
  left_scale_ += noise.radius_error * normal(random_);
  right_scale_ += noise.radius_error * normal(random_);
  shape_.wheel_base_m *= 1 + noise.wheel_base_error * normal(random_);
}

void RobotBody::roll_to(double left_counts, double right_counts, double metres_per_count,
                        const World& world, std::span<const TruePose> others) {
  const double left_m = (left_counts - left_counts_) * metres_per_count;
  const double right_m = (right_counts - right_counts_) * metres_per_count;
  left_counts_ = left_counts;
  right_counts_ = right_counts;
  roll(left_m, right_m, world, others);
}

void RobotBody::roll(double left_m, double right_m, const World& world,
                     std::span<const TruePose> others) {
  std::normal_distribution<double> normal;
  const auto with_slip = [&](double rolled_m, double scale) {
    if (slip_m_per_sqrt_m_ == 0 || rolled_m == 0) return rolled_m * scale;
    return rolled_m * scale + slip_m_per_sqrt_m_ * std::sqrt(std::abs(rolled_m)) * normal(random_);
  };
  const double left = left_grip_ * with_slip(left_m, left_scale_);
  const double right = right_grip_ * with_slip(right_m, right_scale_);
  const double forward = (left + right) / 2;
  const double turn = (right - left) / shape_.wheel_base_m;
  // The exact arc: its chord points half the turn off the old heading.
  const double half = turn / 2;
  const double chord = std::abs(half) < 1e-9 ? forward : forward * std::sin(half) / half;
  TruePose next = pose_;
  next.x_m += chord * std::cos(pose_.heading_rad + half);
  next.y_m += chord * std::sin(pose_.heading_rad + half);
  next.heading_rad = std::remainder(pose_.heading_rad + turn, 2 * M_PI);
  if (forward != 0 && is_blocked(next, world, others)) {
    if (!in_contact_) ++collisions_;
    in_contact_ = true;
    pose_.heading_rad = next.heading_rad;  // a disc can always turn
    return;
  }
  if (forward != 0) in_contact_ = false;
  travelled_m_ += std::abs(chord);
  pose_ = next;
}

bool RobotBody::is_blocked(const TruePose& next, const World& world,
                           std::span<const TruePose> others) const {
  if (disc_touches_obstacle(world, next.x_m, next.y_m, shape_.radius_m)) return true;
  return std::any_of(others.begin(), others.end(), [&](const TruePose& other) {
    const double gap = std::hypot(next.x_m - other.x_m, next.y_m - other.y_m);
    const double old_gap = std::hypot(pose_.x_m - other.x_m, pose_.y_m - other.y_m);
    return gap < 2 * shape_.radius_m && gap < old_gap;
  });
}

bool disc_touches_obstacle(const World& world, double x_m, double y_m, double radius_m) {
  const double cell_m = world.cell_um / 1e6;
  // In cells from the world's lower left corner.
  const double x = (x_m - world.origin.x_um / 1e6) / cell_m;
  const double y = (y_m - world.origin.y_um / 1e6) / cell_m;
  const double radius = radius_m / cell_m;
  for (auto row = static_cast<int>(std::floor(y - radius)); row <= std::floor(y + radius); ++row) {
    for (auto column = static_cast<int>(std::floor(x - radius)); column <= std::floor(x + radius);
         ++column) {
      const bool outside = row < 0 || column < 0 || row >= world.height || column >= world.width;
      if (!outside && !world.occupied[static_cast<std::size_t>(row) * world.width + column]) {
        continue;
      }
      const double dx = x - std::clamp(x, double(column), double(column + 1));
      const double dy = y - std::clamp(y, double(row), double(row + 1));
      if (dx * dx + dy * dy < radius * radius) return true;
    }
  }
  return false;
}

double ray_to_disc_m(double x_m, double y_m, double angle_rad, const TruePose& disc,
                     double radius_m) {
  const double dx = disc.x_m - x_m, dy = disc.y_m - y_m;
  const double gap_squared = dx * dx + dy * dy - radius_m * radius_m;
  if (gap_squared <= 0) return 0;
  const double along = dx * std::cos(angle_rad) + dy * std::sin(angle_rad);
  const double root = along * along - gap_squared;
  if (along <= 0 || root < 0) return std::numeric_limits<double>::infinity();
  return along - std::sqrt(root);
}

}  // namespace ivfm::host
