// The master's end of one CiA 402 drive: boot, configuration, state machine, PDOs, recovery.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "firmware/hal/can_bus.h"
#include "firmware/hal/clock.h"
#include "firmware/wheel_drive/canopen_node.h"
#include "firmware/wheel_drive/cia402.h"

namespace ivfm {

// What is written to a drive and how patient the master is. Accelerations in counts/s^2.
struct Cia402DriveConfig {
  std::uint8_t node_id = 1;                         // 1 .. 126
  std::uint8_t master_node_id = 127;                // identifier of the master's own heartbeat
  std::uint16_t heartbeat_period_ms = 100;          // the drive's (1017h)
  std::uint16_t master_heartbeat_timeout_ms = 150;  // the drive stops by itself after it (1016h)
  std::uint32_t acceleration = 20'000;              // 6083h, 1.0 m/s^2 with the default wheel
  std::uint32_t deceleration = 40'000;              // 6084h, 2.0 m/s^2
  std::uint32_t quick_stop_deceleration = 80'000;   // 6085h, 4.0 m/s^2
  TimeUs heartbeat_timeout_us = 350'000;            // no heartbeat for so long: the drive is lost
  TimeUs stale_timeout_us = 60'000;                 // no TPDO for so long: its state is unknown
  TimeUs sdo_timeout_us = 200'000;
  TimeUs reset_retry_us = 3'000'000;  // between attempts to wake an absent drive
  TimeUs min_backoff_us = 100'000;    // before a fault reset; doubles up to
  TimeUs max_backoff_us = 5'000'000;
};

// One write of the configuration, in order.
struct SdoWrite {
  canopen::ObjectKey key;
  std::uint8_t size = 0;  // bytes
  std::uint32_t value = 0;
  bool optional = false;  // a drive without this object is still good
};
inline constexpr std::size_t kMaxDriveWrites = 40;

// The configuration of a drive as SDO writes; returns how many. Profile velocity mode, heartbeats
// both ways, RPDO1 = controlword + target velocity, TPDO1 = statusword + actual velocity, TPDO2 =
// actual position, all on every SYNC.
std::size_t drive_configuration(const Cia402DriveConfig& config,
                                std::array<SdoWrite, kMaxDriveWrites>& writes);

class Cia402Drive {
 public:
  enum class Phase : std::uint8_t {
    kAbsent,       // reset communication sent, waiting for the boot-up message
    kConfiguring,  // SDO writes
    kStarting,     // NMT start sent, waiting for the operational state
    kRunning,      // PDOs flow
    kRejected,     // not a CiA 402 drive, or it refused its configuration; tried again later
  };

  struct Counters {
    std::uint32_t resets_sent = 0;     // NMT reset communication
    std::uint32_t configurations = 0;  // completed
    std::uint32_t sdo_failures = 0;    // timeouts and aborts of needed objects
    std::uint32_t losses = 0;          // heartbeat timeouts
    std::uint32_t stale_periods = 0;   // TPDOs stopped coming
    std::uint32_t faults = 0;
    std::uint32_t fault_resets = 0;
    std::uint32_t malformed_pdos = 0;
  };

  Cia402Drive() = default;
  explicit Cia402Drive(const Cia402DriveConfig& config);

  // Takes every frame of this node; false for others.
  bool on_frame(const CanFrame& frame, TimeUs now_us);
  // Boots, configures, watches and recovers the drive; sends NMT and SDO frames.
  void step(TimeUs now_us, CanBus& bus);
  // The RPDO1 (controlword, target velocity in counts/s) toward `goal`; call once a period while
  // running(). The target is forced to 0 unless the drive is in operation enabled.
  CanFrame next_rpdo(cia402::Goal goal, std::int32_t target_velocity, TimeUs now_us);

  Phase phase() const { return phase_; }
  bool running() const { return phase_ == Phase::kRunning; }
  // TPDOs are younger than the stale timeout.
  bool fresh(TimeUs now_us) const {
    return running() && has_status_ && has_position_ &&
           now_us - status_us_ <= config_.stale_timeout_us &&
           now_us - position_us_ <= config_.stale_timeout_us;
  }
  bool faulted() const {
    return state() == cia402::State::kFault || state() == cia402::State::kFaultReactionActive;
  }
  cia402::State state() const { return cia402::state_of(statusword_); }
  std::uint16_t statusword() const { return statusword_; }
  std::int32_t velocity() const { return velocity_; }  // counts/s
  std::int32_t position() const { return position_; }  // counts, wraps
  TimeUs position_us() const { return position_us_; }  // when it came
  bool has_position() const { return has_position_; }
  std::uint32_t last_abort_code() const { return last_abort_code_; }
  const CanopenNode& node() const { return node_; }
  const Counters& counters() const { return counters_; }

 private:
  void on_tpdo1(const CanFrame& frame, TimeUs now_us);
  void on_tpdo2(const CanFrame& frame, TimeUs now_us);
  void watch_fault(TimeUs now_us);
  void enter_absent(TimeUs now_us);
  void enter_configuring(TimeUs now_us);
  void step_absent(TimeUs now_us, CanBus& bus);
  void step_configuring(TimeUs now_us, CanBus& bus);
  void configured_item(Status status, TimeUs now_us);
  void request_item();
  void reject(TimeUs now_us);
  void step_starting(TimeUs now_us, CanBus& bus);
  void step_running(TimeUs now_us);
  std::uint16_t fault_controlword(TimeUs now_us);

  Cia402DriveConfig config_;
  CanopenNode node_;
  std::array<SdoWrite, kMaxDriveWrites> writes_{};
  std::size_t write_count_ = 0;

  Phase phase_ = Phase::kAbsent;
  TimeUs phase_since_us_ = 0;
  TimeUs retry_us_ = 0;        // next NMT command or attempt of this phase
  std::size_t item_ = 0;       // 0: identification; n: writes_[n - 1]
  std::uint8_t attempts_ = 0;  // of this item
  std::uint32_t last_abort_code_ = 0;

  bool has_status_ = false;
  bool has_position_ = false;
  bool was_stale_ = false;
  std::uint16_t statusword_ = 0;
  std::int32_t velocity_ = 0;
  std::int32_t position_ = 0;
  TimeUs status_us_ = 0;
  TimeUs position_us_ = 0;
  TimeUs state_since_us_ = 0;

  bool in_fault_ = false;
  TimeUs backoff_us_ = 0;
  TimeUs fault_reset_us_ = 0;  // when the reset edge may be given
  bool reset_edge_sent_ = false;
  Counters counters_;
};

}  // namespace ivfm
