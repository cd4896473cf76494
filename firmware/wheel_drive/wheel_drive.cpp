#include "firmware/wheel_drive/wheel_drive.h"

#include <algorithm>

namespace ivfm {

using cia402::Goal;
using cia402::State;

namespace {

constexpr int kMaxFramesPerStep = 256;  // a babbling node must not hold the loop

// Negation that maps the smallest value to itself, as a wrapping counter does.
constexpr std::int32_t reversed_if(bool reversed, std::int32_t counts) {
  return reversed ? static_cast<std::int32_t>(0u - static_cast<std::uint32_t>(counts)) : counts;
}

Cia402DriveConfig with_node(Cia402DriveConfig config, std::uint8_t node_id) {
  config.node_id = node_id;
  return config;
}

}  // namespace

WheelDrive::WheelDrive(const WheelDriveConfig& config, CanBus& bus)
    : config_(config),
      bus_(bus),
      kinematics_(config.geometry, config.max_wheel_um_s),
      drives_{Cia402Drive(with_node(config.drive, config.left_node_id)),
              Cia402Drive(with_node(config.drive, config.right_node_id))} {}

void WheelDrive::set_velocity(const Velocity& velocity) {
  setpoint_ = velocity;
  setpoint_renewed_ = true;
  quick_stop_ = false;
}

void WheelDrive::quick_stop() {
  setpoint_ = {};
  quick_stop_ = true;
}

void WheelDrive::step(TimeUs now_us) {
  if (!started_) {
    started_ = true;
    next_cycle_us_ = next_heartbeat_us_ = now_us;
  }
  receive_all(now_us);
  for (Cia402Drive& drive : drives_) drive.step(now_us, bus_);
  publish_positions();
  choose_goal(now_us);
  if (now_us >= next_heartbeat_us_) {
    next_heartbeat_us_ = now_us + config_.heartbeat_period_us;
    send(canopen::heartbeat_frame(config_.drive.master_node_id, canopen::NmtState::kOperational));
  }
  if (now_us >= next_cycle_us_) send_cycle(now_us);
}

void WheelDrive::receive_all(TimeUs now_us) {
  for (int i = 0; i < kMaxFramesPerStep; ++i) {
    const Result<CanFrame> frame = bus_.receive();
    if (!frame.ok()) {
      if (frame.status() != Status::kEmpty) ++counters_.bus_failures;
      return;
    }
    ++counters_.frames_received;
    const bool taken =
        drives_[kLeft].on_frame(*frame, now_us) || drives_[kRight].on_frame(*frame, now_us);
    if (!taken) ++counters_.frames_ignored;
  }
}

// Only positions that answer the same SYNC form a pair: else turning would seem to wobble.
void WheelDrive::publish_positions() {
  const Cia402Drive& left = drives_[kLeft];
  const Cia402Drive& right = drives_[kRight];
  if (!left.has_position() || !right.has_position()) {
    positions_.valid = false;
    return;
  }
  if (std::min(left.position_us(), right.position_us()) < last_sync_us_) return;
  positions_ = {reversed_if(config_.left_reversed, left.position()),
                reversed_if(config_.right_reversed, right.position()),
                std::max(left.position_us(), right.position_us()), true};
}

bool WheelDrive::healthy(TimeUs now_us) const {
  return std::all_of(drives_.begin(), drives_.end(), [now_us](const Cia402Drive& drive) {
    return drive.fresh(now_us) && !drive.faulted();
  });
}

bool WheelDrive::enabled(TimeUs now_us) const {
  return healthy(now_us) && drives_[kLeft].state() == State::kOperationEnabled &&
         drives_[kRight].state() == State::kOperationEnabled;
}

// Both drives operate, or both stop: one wheel alone would swing the robot round.
void WheelDrive::choose_goal(TimeUs now_us) {
  const bool was_enabled = both_enabled_;
  both_enabled_ = enabled(now_us);
  const bool dropped_out = was_enabled && !both_enabled_;
  if (dropped_out && !quick_stop_) ++counters_.common_stops;
  // A faulted drive is brought back by goal kOperate while its partner stays stopped.
  const bool may_operate = healthy(now_us) && !quick_stop_;
  const Goal before = goal_;
  goal_ = may_operate && !dropped_out ? Goal::kOperate : Goal::kQuickStop;
  if (goal_ == Goal::kQuickStop && before != goal_) next_cycle_us_ = now_us;  // at once
  if (setpoint_renewed_) {
    setpoint_renewed_ = false;
    setpoint_us_ = now_us;
  }
  if (now_us - setpoint_us_ > config_.setpoint_timeout_us) setpoint_ = {};
}

void WheelDrive::send_cycle(TimeUs now_us) {
  next_cycle_us_ += config_.period_us;
  if (next_cycle_us_ <= now_us) next_cycle_us_ = now_us + config_.period_us;
  const WheelSpeeds speeds = both_enabled_ ? kinematics_.wheel_speeds(setpoint_) : WheelSpeeds{};
  const std::array<std::int32_t, 2> targets = {reversed_if(config_.left_reversed, speeds.left),
                                               reversed_if(config_.right_reversed, speeds.right)};
  for (const Side side : {kLeft, kRight}) {
    Cia402Drive& drive = drives_[side];
    if (!drive.running()) continue;
    const bool repair = drive.state() == State::kFault && !quick_stop_;
    send(drive.next_rpdo(repair ? Goal::kOperate : goal_, targets[side], now_us));
  }
  send(canopen::sync_frame());
  last_sync_us_ = now_us;
}

void WheelDrive::send(const CanFrame& frame) {
  if (!ok(bus_.send(frame))) ++counters_.send_failures;
}

Velocity WheelDrive::measured_velocity() const {
  return kinematics_.body_velocity(
      {reversed_if(config_.left_reversed, drives_[kLeft].velocity()),
       reversed_if(config_.right_reversed, drives_[kRight].velocity())});
}

}  // namespace ivfm
