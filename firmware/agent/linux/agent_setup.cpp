#include "firmware/agent/linux/agent_setup.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ivfm {

namespace {

constexpr double kAccelerationM_s2 = 2;
constexpr double kBrakingM_s2 = 5;
constexpr double kBrakingTimeS = 0.06;

std::uint32_t to_counts(double counts) {
  return static_cast<std::uint32_t>(std::lround(std::clamp(counts, 1.0, 4e9)));
}

std::int32_t to_um(double metres) { return static_cast<std::int32_t>(std::lround(metres * 1e6)); }

// The supervisor keeps this much more than the robot's radius free: lidar noise, old scans.
constexpr std::int32_t kSafetyMarginUm = 30'000;
constexpr std::int32_t kMinMatchedCellUm = 40'000;

ExplorerConfig explorer_config(const AgentOptions& options, std::int32_t cell_um) {
  ExplorerConfig config = ExplorerConfig::lidar(to_um(options.visit_range_m), cell_um);
  if (options.visit_fov_deg < 360) {
    config.fusion.footprint.half_angle = BinaryAngle::from_degrees(options.visit_fov_deg / 2).raw();
  }
  if (options.goals == GoalsChoice::kNetwork) config.let_network_decide();
  // Distances between cells are those of their middles: an obstacle's edge and the robot may both
  // be half a cell nearer; the follower's deviations come on top.
  config.robot_radius_um = to_um(options.robot_radius_m) + cell_um + cell_um / 2;
  config.paths.tight_radius_um = to_um(options.robot_radius_m) + cell_um;
  config.fusion.mapping_range_um = std::max(to_um(options.visit_range_m), kLidarMappingRangeUm);
  config.fusion.doubt_changes = true;
  config.min_goal_distance_um = config.robot_radius_um;
  config.return_to_start = options.return_home;
  return config;
}

}  // namespace

AgentConfig make_agent_config(const AgentOptions& options, std::int32_t cell_um,
                              std::uint32_t epoch, std::uint64_t boot) {
  AgentConfig config;
  config.explorer = explorer_config(options, cell_um);
  config.wheels.geometry.track_um = to_um(options.wheel_base_m);
  config.wheels.geometry.wheel_circumference_um =
      to_um(2 * std::numbers::pi * options.wheel_radius_m);
  config.wheels.geometry.counts_per_turn = static_cast<std::int32_t>(options.counts_per_rev);
  // The drives' ramps in encoder counts; the wheels stand within 100 ms of a zero setpoint, also
  // from the largest speed, and the supervisor counts on less than that.
  const double counts_per_m =
      static_cast<double>(options.counts_per_rev) / (2 * std::numbers::pi * options.wheel_radius_m);
  const double braking_m_s2 = std::max(kBrakingM_s2, options.max_speed_m_s / kBrakingTimeS);
  config.wheels.drive.acceleration = to_counts(kAccelerationM_s2 * counts_per_m);
  config.wheels.drive.deceleration = to_counts(braking_m_s2 * counts_per_m);
  config.wheels.drive.quick_stop_deceleration = to_counts(1.5 * braking_m_s2 * counts_per_m);
  config.supervisor.braking_um_s2 = to_um(0.6 * braking_m_s2);
  const double rim_m_s = options.max_turn_rad_s * options.wheel_base_m / 2;
  config.wheels.max_wheel_um_s = to_um(options.max_speed_m_s + rim_m_s);
  config.follower.max_speed_um_s = to_um(options.max_speed_m_s);
  config.follower.max_turn_mrad_s =
      static_cast<std::int32_t>(std::lround(options.max_turn_rad_s * 1000));
  config.supervisor.robot_radius_um = to_um(options.robot_radius_m) + kSafetyMarginUm;
  config.supervisor.max_speed_um_s = config.follower.max_speed_um_s;
  config.supervisor.max_turn_mrad_s = config.follower.max_turn_mrad_s;
  config.others.robot_radius_um = to_um(options.robot_radius_m);
  config.others.max_speed_um_s = config.follower.max_speed_um_s;
  config.link.robot = static_cast<std::uint16_t>(options.robot_id);
  config.link.epoch = epoch;
  config.link.boot = boot;
  config.link.bytes_per_second = static_cast<std::uint32_t>(options.radio_rate);
  // Cells finer than the lidar's noise (profile paper) cannot be matched against.
  config.localization.matching =
      options.localization == LocalizationChoice::kMatching && cell_um >= kMinMatchedCellUm;
  config.start = {{to_um(options.start_x_m), to_um(options.start_y_m)},
                  BinaryAngle::from_degrees(options.start_heading_deg)};
  config.rough_start = options.rough_start;
  config.unknown_start = options.unknown_start;
  config.max_action_travel_um = to_um(options.visit_range_m / 2);
  if (options.goals == GoalsChoice::kNetwork) {
    config.keeps_goals = true;
    config.view_spacing_um = to_um(0.06 * 4 * options.visit_range_m);  // as the paper's camera
  }
  if (const auto target = parse_place(options.target)) {
    config.target = Point{to_um((*target)[0]), to_um((*target)[1])};
  }
  return config;
}

}  // namespace ivfm
