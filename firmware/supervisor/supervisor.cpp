#include "firmware/supervisor/supervisor.h"

#include <algorithm>
#include <cstdlib>

#include "firmware/supervisor/obstacle_guard.h"
#include "shared/geometry/integer_sqrt.h"

namespace ivfm {
namespace {

// Below this the robot stands, as far as odometry can tell.
constexpr std::int32_t kStandingUm_s = 5'000;
// A speed allowed by an obstacle that is slower than this is none.
constexpr std::int32_t kCreepUm_s = 5'000;
// How far obstacles matter at all.
constexpr std::int32_t kHorizonMm = 2'000;

bool is_mission(RobotEvent event) {
  return event == RobotEvent::kExplore || event == RobotEvent::kReturn ||
         event == RobotEvent::kMapExplored || event == RobotEvent::kTargetFound ||
         event == RobotEvent::kHome;
}

}  // namespace

Velocity Supervisor::gate(const Velocity& setpoint, const SupervisorInputs& inputs, TimeUs now_us) {
  reasons_ = {};
  find_faults(inputs, now_us);
  remember_near_hits(inputs);
  advance(inputs, now_us);
  if (!may_move()) {
    braking_ = false;
    return {};
  }
  return limit_by_obstacles(limit_to_range(setpoint), inputs);
}

Status Supervisor::request(RobotEvent event) {
  if (event == RobotEvent::kStop || event == RobotEvent::kStart) {
    mission_ = RobotEvent::kHome;
    return apply(event) ? Status::kOk : Status::kRefused;
  }
  if (!is_mission(event)) return Status::kInvalidArgument;
  if (state_ == RobotState::kStopped) return Status::kRefused;
  const bool waits = state_ == RobotState::kBoot || state_ == RobotState::kFault;
  if (!waits && !apply(event)) return Status::kRefused;
  mission_ = event;
  return Status::kOk;
}

void Supervisor::find_faults(const SupervisorInputs& inputs, TimeUs now_us) {
  const bool time_went_back = now_us < last_call_us_;
  last_call_us_ = now_us;
  reasons_.set(StopReason::kLidarStale,
               inputs.scan == nullptr || inputs.lidar_age_us > config_.lidar_max_age_us);
  reasons_.set(StopReason::kOdometryStale, inputs.odometry_age_us > config_.odometry_max_age_us);
  reasons_.set(StopReason::kDriveLost, !inputs.drives_operational);
  reasons_.set(StopReason::kLost, inputs.lost);
  reasons_.set(StopReason::kInternalError, inputs.internal_error || time_went_back);
  const bool was_well = well_;
  well_ = reasons_.none();
  if (well_ && !was_well) well_since_us_ = now_us;
  reasons_.set(StopReason::kStopCommand, inputs.stop_requested);
}

// A scan is new when its age is smaller than at the last call.
void Supervisor::remember_near_hits(const SupervisorInputs& inputs) {
  const bool new_scan = inputs.scan != nullptr && inputs.lidar_age_us < last_lidar_age_us_;
  last_lidar_age_us_ = inputs.lidar_age_us;
  if (new_scan) blind_zone_.update(*inputs.scan, inputs.pose_at_scan);
}

void Supervisor::advance(const SupervisorInputs& inputs, TimeUs now_us) {
  if (inputs.stop_requested) {
    request(RobotEvent::kStop);
  }
  // While devices are still starting up their silence is no fault; an internal error always is.
  const bool booting = state_ == RobotState::kBoot && !reasons_.has(StopReason::kInternalError);
  if (!well_ && !booting) {
    const RobotState before = state_;
    apply(RobotEvent::kFault);
    if (state_ == RobotState::kFault && before != RobotState::kFault) ++fault_count_;
  }
  const bool recovered = well_ && now_us - well_since_us_ >= config_.recovery_us;
  if (state_ == RobotState::kBoot && recovered) apply(RobotEvent::kDevicesReady);
  if (state_ == RobotState::kFault && recovered) apply(RobotEvent::kFaultCleared);
  if (state_ == RobotState::kReady && mission_ != RobotEvent::kHome) apply(mission_);
}

bool Supervisor::apply(RobotEvent event) {
  if (!supervisor_table::is_listed(state_, event)) return false;
  state_ = supervisor_table::next_state(state_, event);
  return true;
}

Velocity Supervisor::limit_to_range(const Velocity& setpoint) {
  const Velocity limited{
      std::clamp(setpoint.v_um_s, -config_.max_speed_um_s, config_.max_speed_um_s),
      std::clamp(setpoint.omega_mrad_s, -config_.max_turn_mrad_s, config_.max_turn_mrad_s)};
  reasons_.set(StopReason::kLimited, limited != setpoint);
  return limited;
}

// Brakes hard when the robot could no longer keep half of its clearance, and lets it approach no
// faster than it can gently stop at the full one. Turning on the spot always passes: it is a disc.
Velocity Supervisor::limit_by_obstacles(const Velocity& setpoint, const SupervisorInputs& inputs) {
  const std::int32_t radius_mm = (config_.robot_radius_um - config_.side_tolerance_um) / 1000;
  const Obstacles obstacles{*inputs.scan, inputs.pose_at_scan, blind_zone_.points()};
  const auto free_along = [&](const Velocity& motion, std::int32_t clearance_um) {
    const std::int32_t free_mm =
        free_travel_mm(obstacles, inputs.pose, motion, radius_mm, kHorizonMm);
    return std::max<std::int32_t>(0, free_mm - (config_.side_tolerance_um + clearance_um) / 1000);
  };
  const std::int32_t safe_measured =
      safe_speed_um_s(free_along(inputs.measured, config_.clearance_um / 2), config_.braking_um_s2);
  const std::int32_t speed = std::abs(inputs.measured.v_um_s);
  if (speed < kStandingUm_s) {
    braking_ = false;
  } else if (speed > safe_measured) {
    braking_ = true;
  }
  if (setpoint.v_um_s == 0 && !braking_) return setpoint;
  const std::int32_t allowed =
      safe_speed_um_s(free_along(setpoint, config_.clearance_um), config_.slowing_um_s2);
  if (braking_ || allowed < kCreepUm_s) {
    reasons_.set(StopReason::kObstacle);
    return {};
  }
  if (std::abs(setpoint.v_um_s) <= allowed) return setpoint;
  reasons_.set(StopReason::kSlowedByObstacle);
  // The same arc, slower.
  const auto slower = [&](std::int32_t value) {
    return static_cast<std::int32_t>(std::int64_t{value} * allowed / std::abs(setpoint.v_um_s));
  };
  return {slower(setpoint.v_um_s), slower(setpoint.omega_mrad_s)};
}

// The largest v with v * reaction + v^2 / (2 * deceleration) <= free travel.
std::int32_t Supervisor::safe_speed_um_s(std::int32_t free_mm,
                                         std::int32_t deceleration_um_s2) const {
  const std::int64_t loss = std::int64_t{deceleration_um_s2} * config_.reaction_us / 1'000'000;
  const std::int64_t square = loss * loss + 2000 * std::int64_t{deceleration_um_s2} * free_mm;
  return static_cast<std::int32_t>(integer_sqrt(static_cast<std::uint64_t>(square)) - loss);
}

}  // namespace ivfm
