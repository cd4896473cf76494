// The gate every wheel setpoint passes: stands still unless all is known to be well.
#pragma once

#include <cstdint>

#include "firmware/hal/clock.h"
#include "firmware/lidar/scan.h"
#include "firmware/supervisor/blind_zone.h"
#include "firmware/supervisor/supervisor_table.h"
#include "shared/geometry/pose.h"
#include "shared/geometry/velocity.h"
#include "shared/status/status.h"

namespace ivfm {

// Why the gate held back or changed a setpoint; a set of these goes into telemetry.
enum class StopReason : std::uint16_t {
  kLidarStale = 1 << 0,
  kOdometryStale = 1 << 1,
  kDriveLost = 1 << 2,
  kStopCommand = 1 << 3,
  kInternalError = 1 << 4,
  kObstacle = 1 << 5,          // an obstacle inside the stopping distance: no driving towards it
  kSlowedByObstacle = 1 << 6,  // an obstacle ahead: slower, still moving
  kLost = 1 << 7,              // the robot does not know where it is
  kLimited = 1 << 8,           // the setpoint was beyond the largest speed or turn rate
};

// A set of StopReason.
class StopReasons {
 public:
  constexpr void set(StopReason reason, bool on = true) {
    const auto bit = static_cast<unsigned>(reason);
    bits_ = static_cast<std::uint16_t>(on ? bits_ | bit : bits_ & ~bit);
  }
  constexpr bool has(StopReason reason) const { return bits_ & static_cast<unsigned>(reason); }
  constexpr bool none() const { return bits_ == 0; }
  constexpr std::uint16_t bits() const { return bits_; }

 private:
  std::uint16_t bits_ = 0;
};

// An age that says that nothing has come yet.
inline constexpr std::uint32_t kNeverUs = UINT32_MAX;

struct SupervisorConfig {
  // A revolution of an RPLIDAR A1 takes 182 ms at 5.5 Hz; this is 2.5 of them.
  std::uint32_t lidar_max_age_us = 455'000;
  std::uint32_t odometry_max_age_us = 100'000;
  // Causes have to be gone for this long before the wheels may turn again.
  std::uint32_t recovery_us = 500'000;
  std::int32_t robot_radius_um = 105'000;
  // Hits that reach less than this into the side of the robot's corridor are lidar noise.
  std::int32_t side_tolerance_um = 5'000;
  // Nearer hits the lidar does not report (0.15 m, with a margin): they are remembered.
  std::int32_t lidar_blind_um = 170'000;
  // Kept free between the robot and an obstacle ahead, at standstill.
  std::int32_t clearance_um = 30'000;
  std::int32_t max_speed_um_s = 500'000;
  std::int32_t max_turn_mrad_s = 3'000;
  // From a hit to the wheels' first reaction: the scan's age at most, one period of the loop.
  std::uint32_t reaction_us = 200'000;
  // What the wheels can brake with (um/s^2), and the gentler value for approaching an obstacle.
  std::int32_t braking_um_s2 = 3'000'000;
  std::int32_t slowing_um_s2 = 500'000;
};

// What the rest of the agent knows at the moment of the call.
struct SupervisorInputs {
  std::uint32_t lidar_age_us = kNeverUs;     // since the last complete revolution
  std::uint32_t odometry_age_us = kNeverUs;  // since the older one of the wheels' last positions
  bool drives_operational = false;           // both answer and are in the state operation enabled
  bool stop_requested = false;               // a person, the server or the process' end wants it
  bool lost = false;                         // the scans contradict the map, see Localization
  bool internal_error = false;               // a part of the agent reported a broken invariant
  const Scan* scan = nullptr;                // the last complete revolution, null before the first
  Pose pose_at_scan;                         // of the robot, at the end of that revolution
  Pose pose;                                 // of the robot now, in the same frame
  Velocity measured;                         // by odometry
};

class Supervisor {
 public:
  explicit Supervisor(const SupervisorConfig& config)
      : config_(config), blind_zone_(config.lidar_blind_um) {}

  // What may go to the wheels instead of `setpoint`. Call it once a control period, also when the
  // setpoint is zero. `now_us` must not go back; when it does, that is an internal error.
  Velocity gate(const Velocity& setpoint, const SupervisorInputs& inputs, TimeUs now_us);

  // The mission's and the operator's events: kExplore, kReturn, kMapExplored, kTargetFound, kHome,
  // kStop, kStart. A mission given while the robot is in fault or boot starts as soon as it is
  // ready. kRefused: not possible in this state; kInvalidArgument: an event of the supervisor's
  // own.
  Status request(RobotEvent event);
  // The map frame has moved by `moved` (T_new_old), and so has what lies too near to be seen.
  void re_express(const Pose& moved) { blind_zone_.re_express(moved); }

  RobotState state() const { return state_; }
  bool may_move() const { return supervisor_table::motion_in(state_) == Motion::kDrive; }
  // Of the last call of gate().
  StopReasons reasons() const { return reasons_; }
  // How often a fault has begun since construction.
  std::uint32_t fault_count() const { return fault_count_; }

 private:
  void find_faults(const SupervisorInputs& inputs, TimeUs now_us);
  bool has_fault() const;
  void remember_near_hits(const SupervisorInputs& inputs);
  void advance(const SupervisorInputs& inputs, TimeUs now_us);
  bool apply(RobotEvent event);
  Velocity limit_to_range(const Velocity& setpoint);
  Velocity limit_by_obstacles(const Velocity& setpoint, const SupervisorInputs& inputs);
  std::int32_t safe_speed_um_s(std::int32_t free_mm, std::int32_t deceleration_um_s2) const;

  SupervisorConfig config_;
  BlindZone blind_zone_;
  std::uint32_t last_lidar_age_us_ = kNeverUs;
  RobotState state_ = RobotState::kBoot;
  StopReasons reasons_;
  // What to go on with from kReady: the last mission event.
  RobotEvent mission_ = RobotEvent::kHome;
  bool braking_ = false;      // for an obstacle, until the robot stands
  bool well_ = false;         // no cause of a fault at the last call
  TimeUs well_since_us_ = 0;  // valid when well_
  TimeUs last_call_us_ = 0;
  std::uint32_t fault_count_ = 0;
};

}  // namespace ivfm
