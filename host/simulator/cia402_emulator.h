// A CiA 402 wheel drive in software: CANopen slave, object dictionary, profile velocity, encoder.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "firmware/hal/can_bus.h"
#include "firmware/hal/clock.h"
#include "firmware/wheel_drive/canopen.h"
#include "firmware/wheel_drive/cia402.h"

namespace ivfm::host {

// CiA 301 section 7.4.7.1, the EDS's DataType.
enum class ObjectType : std::uint16_t {
  kInteger8 = 0x02,
  kInteger16 = 0x03,
  kInteger32 = 0x04,
  kUnsigned8 = 0x05,
  kUnsigned16 = 0x06,
  kUnsigned32 = 0x07,
};
constexpr std::uint8_t size_of(ObjectType type) {
  if (type == ObjectType::kInteger8 || type == ObjectType::kUnsigned8) return 1;
  return type == ObjectType::kInteger16 || type == ObjectType::kUnsigned16 ? 2 : 4;
}

enum class ObjectAccess : std::uint8_t { kConst, kReadOnly, kReadWrite };

// One entry of the dictionary as the EDS describes it.
struct ObjectEntry {
  canopen::ObjectKey key;
  std::string_view name;
  ObjectType type;
  ObjectAccess access;
  bool mappable;
  std::uint32_t default_value;
  bool plus_node_id = false;  // the default is default_value + node id
};

// Every object of the drive, ordered by index and sub-index.
std::span<const ObjectEntry> drive_dictionary();

struct Cia402EmulatorConfig {
  std::uint8_t node_id = 1;
  double max_speed = 60'000;          // counts/s the motor can do
  double coast_deceleration = 8'000;  // counts/s^2 without torque
  TimeUs boot_time_us = 20'000;       // from reset to the boot-up message
};

// One drive. Frames go in by receive() and come out by transmit(); step() moves its time on.
class Cia402Emulator {
 public:
  struct Counters {
    std::uint32_t syncs = 0;
    std::uint32_t rpdos = 0;
    std::uint32_t sdo_requests = 0;
    std::uint32_t sdo_aborts = 0;
    std::uint32_t heartbeat_losses = 0;
    std::uint32_t boots = 0;
  };

  explicit Cia402Emulator(const Cia402EmulatorConfig& config);

  // A frame of the bus. Frames for others are ignored.
  void receive(const CanFrame& frame, TimeUs now_us);
  // Moves motor, heartbeats and time-outs on to `now_us` (never back).
  void step(TimeUs now_us);
  // The next frame the drive wants to send.
  std::optional<CanFrame> transmit();

  // The shaft. Speeds in counts/s, positive as the encoder counts.
  double wheel_speed() const { return speed_; }
  // What the wheel does on the ground: less than it turns by the slip.
  double ground_speed() const { return speed_ * (1.0 - slip_); }
  // Ground distance in counts since construction, unbounded.
  double ground_position() const { return ground_position_; }
  std::int32_t encoder_position() const;

  // 0: none; 0.1: the ground sees 90 % of the wheel's motion; negative: pushed along.
  void set_slip(double slip) { slip_ = slip; }
  // The wheel cannot turn (a jammed gear).
  void set_blocked(bool blocked) { blocked_ = blocked; }

  // Faults on demand.
  void set_silent(bool silent);                // neither sends nor hears; the motor runs on
  void raise_fault(std::uint16_t error_code);  // EMCY, fault reaction, fault
  void send_emergency(std::uint16_t error_code, std::uint8_t error_register);  // nothing else
  void power_cycle(TimeUs now_us);  // loses configuration and encoder position

  std::uint8_t node_id() const { return config_.node_id; }
  canopen::NmtState nmt_state() const { return nmt_; }
  cia402::State state() const { return state_; }
  std::uint16_t statusword() const;
  const Counters& counters() const { return counters_; }
  // The value of an object, 0 if there is none.
  std::uint32_t object(canopen::ObjectKey key) const;

 private:
  struct Cell {
    const ObjectEntry* entry;
    std::uint32_t value;
  };

  void queue(const CanFrame& frame);
  Cell* find(canopen::ObjectKey key);
  const Cell* find(canopen::ObjectKey key) const;
  bool index_exists(std::uint16_t index) const;
  std::uint32_t read_value(const Cell& cell) const;
  void store(canopen::ObjectKey key, std::uint32_t value);
  void set_defaults(std::uint16_t first_index, std::uint16_t last_index);

  void on_nmt(const CanFrame& frame);
  void reset(bool application);
  void on_sdo(const CanFrame& frame);
  void sdo_upload(canopen::ObjectKey key);
  void sdo_download(const CanFrame& frame, canopen::ObjectKey key);
  std::uint32_t write(canopen::ObjectKey key, std::uint32_t value);
  std::uint32_t check_write(const Cell& cell, std::uint32_t value) const;
  std::uint32_t check_mapping(canopen::ObjectKey key, std::uint32_t value) const;
  void abort(canopen::ObjectKey key, std::uint32_t code);

  bool pdo_valid(std::uint16_t communication, std::uint16_t* id) const;
  std::uint32_t mapped_bits(std::uint16_t mapping) const;
  void on_rpdo(const CanFrame& frame);
  void apply_rpdo(const CanFrame& frame);
  void on_sync();
  void send_tpdo(std::uint16_t communication, std::uint16_t mapping);
  void on_master_heartbeat(const CanFrame& frame);
  void step_heartbeats(TimeUs now_us);

  void on_controlword(std::uint16_t controlword);
  void lose_connection();
  void enter(cia402::State state);
  void step_motor(double seconds);
  double wanted_speed(double& ramp) const;
  void finish_stop();

  Cia402EmulatorConfig config_;
  std::vector<Cell> cells_;
  std::deque<CanFrame> out_;
  Counters counters_;

  TimeUs now_us_ = 0;
  bool started_ = false;
  bool silent_ = false;
  bool booting_ = true;
  TimeUs boot_at_us_ = 0;
  canopen::NmtState nmt_ = canopen::NmtState::kBootUp;
  TimeUs next_heartbeat_us_ = 0;
  bool master_watched_ = false;  // its first heartbeat came
  bool master_lost_ = false;
  TimeUs master_deadline_us_ = 0;
  std::optional<CanFrame> pending_rpdo_;
  std::array<std::uint8_t, 2> sync_counts_{};

  cia402::State state_ = cia402::State::kNotReadyToSwitchOn;
  std::uint16_t controlword_ = 0;
  std::uint16_t error_code_ = 0;
  std::uint8_t error_register_ = 0;
  double speed_ = 0;
  double position_ = 0;  // encoder counts, unbounded
  double ground_position_ = 0;
  double slip_ = 0;
  bool blocked_ = false;
};

// Connects drives with the bus they share: frames in, time on, frames out.
class DriveGroup {
 public:
  // `bus` and the drives must outlive this object.
  DriveGroup(CanBus& bus, std::vector<Cia402Emulator*> drives)
      : bus_(bus), drives_(std::move(drives)) {}
  // Call every few milliseconds. What the bus does not take is lost, and counted.
  void step(TimeUs now_us);
  std::uint32_t lost_frames() const { return lost_frames_; }

 private:
  CanBus& bus_;
  std::vector<Cia402Emulator*> drives_;
  std::uint32_t lost_frames_ = 0;
};

}  // namespace ivfm::host
