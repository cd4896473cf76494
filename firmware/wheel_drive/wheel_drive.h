// The robot's wheels: two CiA 402 drives on one CAN bus, driven and watched together.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/hal/can_bus.h"
#include "firmware/hal/clock.h"
#include "firmware/wheel_drive/cia402_drive.h"
#include "firmware/wheel_drive/diff_drive_kinematics.h"

namespace ivfm {

struct WheelDriveConfig {
  WheelGeometry geometry;
  std::int32_t max_wheel_um_s = 500'000;  // limit of each wheel over the ground
  bool left_reversed = false;             // counting up rolls the left wheel backward
  bool right_reversed = false;
  std::uint8_t left_node_id = 1;
  std::uint8_t right_node_id = 2;
  Cia402DriveConfig drive;               // of both; node ids are taken from above
  TimeUs period_us = 20'000;             // SYNC and RPDOs
  TimeUs heartbeat_period_us = 50'000;   // the master's own
  TimeUs setpoint_timeout_us = 250'000;  // a velocity that is not renewed ends
};

class WheelDrive {
 public:
  enum Side : std::uint8_t { kLeft = 0, kRight = 1 };

  // Encoder positions of one SYNC, in counts that grow forward and wrap around.
  struct Positions {
    std::int32_t left = 0;
    std::int32_t right = 0;
    TimeUs measured_us = 0;  // when the later of both came
    bool valid = false;      // false until both drives have reported once since they (re)started
  };

  struct Counters {
    std::uint32_t frames_received = 0;
    std::uint32_t frames_ignored = 0;  // of other nodes
    std::uint32_t send_failures = 0;   // PDO, SYNC or heartbeat not taken by the bus
    std::uint32_t bus_failures = 0;    // receive answered kUnavailable or kIoError
    std::uint32_t common_stops = 0;    // a drive dropped out while both were enabled
  };

  // `bus` must outlive this object.
  WheelDrive(const WheelDriveConfig& config, CanBus& bus);

  // Receives, boots and watches the drives, and sends what is due. Call at least every 10 ms.
  void step(TimeUs now_us);

  // Drives with `velocity`, within the wheels' limit; acts while both drives are enabled; ends
  // after the setpoint timeout. Releases a quick stop.
  void set_velocity(const Velocity& velocity);
  // Brakes on the profile deceleration and holds; releases a quick stop.
  void stop() { set_velocity(Velocity{}); }
  // Brakes on the quick stop ramp, then no torque; holds until set_velocity() or stop().
  void quick_stop();

  // The last pair that both drives sent for one SYNC.
  const Positions& positions() const { return positions_; }
  // Its age; the largest time when there is none.
  TimeUs positions_age_us(TimeUs now_us) const {
    return positions_.valid ? now_us - positions_.measured_us : ~TimeUs{0};
  }
  // The velocity the drives report.
  Velocity measured_velocity() const;

  // Both drives run, report in time and have no fault (they may be stopped).
  bool healthy(TimeUs now_us) const;
  // Healthy and both in operation enabled: velocities act.
  bool enabled(TimeUs now_us) const;
  const Cia402Drive& drive(Side side) const { return drives_[side]; }
  cia402::State drive_state(Side side) const { return drives_[side].state(); }
  const Counters& counters() const { return counters_; }
  const DiffDriveKinematics& kinematics() const { return kinematics_; }

 private:
  void receive_all(TimeUs now_us);
  void publish_positions();
  void choose_goal(TimeUs now_us);
  void send_cycle(TimeUs now_us);
  void send(const CanFrame& frame);

  WheelDriveConfig config_;
  CanBus& bus_;
  DiffDriveKinematics kinematics_;
  std::array<Cia402Drive, 2> drives_;
  Velocity setpoint_;
  bool setpoint_renewed_ = false;
  TimeUs setpoint_us_ = 0;
  bool quick_stop_ = false;
  cia402::Goal goal_ = cia402::Goal::kQuickStop;
  bool both_enabled_ = false;
  bool started_ = false;
  TimeUs next_cycle_us_ = 0;
  TimeUs next_heartbeat_us_ = 0;
  TimeUs last_sync_us_ = 0;
  Positions positions_;
  Counters counters_;
};

}  // namespace ivfm
