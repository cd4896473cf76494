#include "firmware/wheel_drive/cia402_drive.h"

#include <algorithm>

namespace ivfm {

using canopen::NmtCommand;
using canopen::NmtState;
using cia402::Goal;
using cia402::State;

namespace {

constexpr std::uint8_t kSdoAttempts = 3;
constexpr TimeUs kStartRetryUs = 100'000;           // between NMT start commands
constexpr TimeUs kStartTimeoutUs = 1'000'000;       // then the drive is reset
constexpr TimeUs kSilentPdoTimeoutUs = 1'000'000;   // heartbeats but no TPDOs: reset
constexpr TimeUs kResetPulseUs = 200'000;           // fault reset bit held before it is dropped
constexpr TimeUs kQuickStopPatienceUs = 2'000'000;  // drives that stay in quick stop active
constexpr TimeUs kStableUs = 5'000'000;             // running so long forgives earlier faults

// Appends to a list of SDO writes.
class WriteList {
 public:
  explicit WriteList(std::array<SdoWrite, kMaxDriveWrites>& writes) : writes_(writes) {}
  void add(canopen::ObjectKey key, std::uint8_t size, std::uint32_t value, bool optional = false) {
    writes_[count_++] = {key, size, value, optional};
  }
  // A PDO's remapping in the order of CiA 301 section 7.5.2.36: invalid, no entries, entries,
  // count, transmission type, valid.
  void add_pdo(std::uint16_t communication, std::uint16_t mapping, std::uint32_t cob_id,
               std::span<const std::uint32_t> entries) {
    add({communication, 1}, 4, cob_id | canopen::kPdoInvalid);
    add({mapping, 0}, 1, 0);
    for (std::size_t i = 0; i < entries.size(); ++i) {
      add({mapping, static_cast<std::uint8_t>(i + 1)}, 4, entries[i]);
    }
    add({mapping, 0}, 1, static_cast<std::uint32_t>(entries.size()));
    add({communication, 2}, 1, 1);  // on every SYNC
    add({communication, 1}, 4, cob_id);
  }
  std::size_t count() const { return count_; }

 private:
  std::array<SdoWrite, kMaxDriveWrites>& writes_;
  std::size_t count_ = 0;
};

// A PDO mapping entry: index, sub-index, length in bits.
constexpr std::uint32_t mapped(canopen::ObjectKey key, std::uint32_t bits) {
  return (static_cast<std::uint32_t>(key.index) << 16) |
         (static_cast<std::uint32_t>(key.sub) << 8) | bits;
}

}  // namespace

std::size_t drive_configuration(const Cia402DriveConfig& config,
                                std::array<SdoWrite, kMaxDriveWrites>& writes) {
  WriteList list(writes);
  const std::uint32_t node = config.node_id;
  // The drive watches the master: 1016h.01h = node << 16 | ms.
  list.add({0x1016, 1}, 4,
           (std::uint32_t{config.master_node_id} << 16) | config.master_heartbeat_timeout_ms);
  list.add({0x1017, 0}, 2, config.heartbeat_period_ms);
  list.add(cia402::kAbortConnectionOption, 2, 3, true);  // master lost: quick stop
  list.add(cia402::kQuickStopOption, 2, 2);              // quick stop ramp, then switch on disabled
  list.add(cia402::kFaultReactionOption, 2, 2, true);    // fault: quick stop ramp
  list.add(cia402::kModeOfOperation, 1, cia402::kProfileVelocityMode);
  list.add(cia402::kProfileAcceleration, 4, config.acceleration);
  list.add(cia402::kProfileDeceleration, 4, config.deceleration);
  list.add(cia402::kQuickStopDeceleration, 4, config.quick_stop_deceleration, true);
  list.add(cia402::kTargetVelocity, 4, 0);
  const std::array<std::uint32_t, 2> rpdo1 = {mapped(cia402::kControlword, 16),
                                              mapped(cia402::kTargetVelocity, 32)};
  const std::array<std::uint32_t, 2> tpdo1 = {mapped(cia402::kStatusword, 16),
                                              mapped(cia402::kVelocityActual, 32)};
  const std::array<std::uint32_t, 1> tpdo2 = {mapped(cia402::kPositionActual, 32)};
  list.add_pdo(0x1400, 0x1600, canopen::kRpdo1Base + node, rpdo1);
  list.add_pdo(0x1800, 0x1a00, canopen::kPdoNoRemoteRequest | (canopen::kTpdo1Base + node), tpdo1);
  list.add_pdo(0x1801, 0x1a01, canopen::kPdoNoRemoteRequest | (canopen::kTpdo2Base + node), tpdo2);
  // A drive's own further PDOs only cost bus time.
  list.add({0x1802, 1}, 4, canopen::kPdoInvalid | (canopen::kTpdo3Base + node), true);
  list.add({0x1803, 1}, 4, canopen::kPdoInvalid | (canopen::kTpdo4Base + node), true);
  return list.count();
}

Cia402Drive::Cia402Drive(const Cia402DriveConfig& config)
    : config_(config),
      node_(config.node_id, config.sdo_timeout_us),
      backoff_us_(config.min_backoff_us) {
  write_count_ = drive_configuration(config_, writes_);
}

bool Cia402Drive::on_frame(const CanFrame& frame, TimeUs now_us) {
  if (frame.id == canopen::kTpdo1Base + config_.node_id) {
    on_tpdo1(frame, now_us);
  } else if (frame.id == canopen::kTpdo2Base + config_.node_id) {
    on_tpdo2(frame, now_us);
  } else {
    return node_.on_frame(frame, now_us);
  }
  return true;
}

void Cia402Drive::on_tpdo1(const CanFrame& frame, TimeUs now_us) {
  if (frame.remote || frame.size != 6) {
    ++counters_.malformed_pdos;
    return;
  }
  if (!running()) return;  // of an older configuration
  const State before = state();
  statusword_ = canopen::get_u16(frame, 0);
  velocity_ = canopen::get_i32(frame, 2);
  if (!has_status_ || state() != before) state_since_us_ = now_us;
  has_status_ = true;
  status_us_ = now_us;
  watch_fault(now_us);
}

void Cia402Drive::on_tpdo2(const CanFrame& frame, TimeUs now_us) {
  if (frame.remote || frame.size != 4) {
    ++counters_.malformed_pdos;
    return;
  }
  if (!running()) return;
  position_ = canopen::get_i32(frame, 0);
  has_position_ = true;
  position_us_ = now_us;
}

// Counts faults and sets when each may be reset: the pause doubles while faults keep coming.
void Cia402Drive::watch_fault(TimeUs now_us) {
  if (state() == State::kOperationEnabled && now_us - state_since_us_ >= kStableUs) {
    backoff_us_ = config_.min_backoff_us;
  }
  const bool fault = faulted();
  if (fault && !in_fault_) {
    ++counters_.faults;
    fault_reset_us_ = now_us + backoff_us_;
    backoff_us_ = std::min(2 * backoff_us_, config_.max_backoff_us);
    reset_edge_sent_ = false;
  }
  in_fault_ = fault;
}

void Cia402Drive::enter_absent(TimeUs now_us) {
  phase_ = Phase::kAbsent;
  phase_since_us_ = now_us;
  retry_us_ = now_us;
  node_.sdo().cancel();
  has_status_ = has_position_ = was_stale_ = false;
  statusword_ = 0;
  in_fault_ = false;
}

void Cia402Drive::enter_configuring(TimeUs now_us) {
  enter_absent(now_us);
  phase_ = Phase::kConfiguring;
  item_ = 0;
  attempts_ = 0;
}

void Cia402Drive::step(TimeUs now_us, CanBus& bus) {
  if (node_.take_boot_up()) enter_configuring(now_us);  // fresh from a reset: nothing is set
  switch (phase_) {
    case Phase::kAbsent: step_absent(now_us, bus); break;
    case Phase::kConfiguring: step_configuring(now_us, bus); break;
    case Phase::kStarting: step_starting(now_us, bus); break;
    case Phase::kRunning: step_running(now_us); break;
    case Phase::kRejected:
      if (now_us >= retry_us_) enter_absent(now_us);
      break;
  }
}

void Cia402Drive::step_absent(TimeUs now_us, CanBus& bus) {
  if (now_us < retry_us_) return;
  if (!ok(node_.send_nmt(NmtCommand::kResetCommunication, bus))) return;
  ++counters_.resets_sent;
  retry_us_ = now_us + config_.reset_retry_us;
}

void Cia402Drive::request_item() {
  if (item_ == 0) {
    (void)node_.sdo().upload({0x1000, 0});
  } else {
    const SdoWrite& write = writes_[item_ - 1];
    (void)node_.sdo().download(write.key, write.size, write.value);
  }
}

void Cia402Drive::step_configuring(TimeUs now_us, CanBus& bus) {
  SdoClient& sdo = node_.sdo();
  if (sdo.state() == SdoClient::State::kDone) {
    configured_item(sdo.status(), now_us);
    if (phase_ != Phase::kConfiguring) return;
  }
  if (!sdo.busy()) request_item();
  sdo.step(now_us, bus);
}

// Judges the transfer that ended and moves on to the next item.
void Cia402Drive::configured_item(Status status, TimeUs now_us) {
  SdoClient& sdo = node_.sdo();
  sdo.cancel();
  if (status == Status::kTimeout && ++attempts_ < kSdoAttempts) return;  // the same once more
  attempts_ = 0;
  const bool wrong_device =
      item_ == 0 && ok(status) && (sdo.value() & 0xffffu) != cia402::kDeviceProfile;
  const bool optional = item_ > 0 && writes_[item_ - 1].optional && status == Status::kRefused;
  if (status == Status::kRefused) last_abort_code_ = sdo.abort_code();
  if (wrong_device || (!ok(status) && !optional)) {
    ++counters_.sdo_failures;
    reject(now_us);
    return;
  }
  if (item_++ < write_count_) return;
  ++counters_.configurations;
  phase_ = Phase::kStarting;
  phase_since_us_ = now_us;
  retry_us_ = now_us;
}

void Cia402Drive::reject(TimeUs now_us) {
  phase_ = Phase::kRejected;
  phase_since_us_ = now_us;
  retry_us_ = now_us + backoff_us_;
  backoff_us_ = std::min(2 * backoff_us_, config_.max_backoff_us);
}

void Cia402Drive::step_starting(TimeUs now_us, CanBus& bus) {
  node_.sdo().step(now_us, bus);
  if (node_.nmt_state() == NmtState::kOperational && node_.last_heartbeat_us() > phase_since_us_) {
    phase_ = Phase::kRunning;
    phase_since_us_ = state_since_us_ = now_us;
    was_stale_ = false;
    return;
  }
  if (now_us - phase_since_us_ > kStartTimeoutUs) {
    ++counters_.losses;
    enter_absent(now_us);
  } else if (now_us >= retry_us_ && ok(node_.send_nmt(NmtCommand::kStart, bus))) {
    retry_us_ = now_us + kStartRetryUs;
  }
}

void Cia402Drive::step_running(TimeUs now_us) {
  if (now_us - node_.last_heartbeat_us() > config_.heartbeat_timeout_us) {
    ++counters_.losses;
    enter_absent(now_us);
    return;
  }
  if (node_.nmt_state() !=
      NmtState::kOperational) {  // it left by itself; its set-up is still there
    phase_ = Phase::kStarting;
    phase_since_us_ = retry_us_ = now_us;
    has_status_ = has_position_ = false;
    statusword_ = 0;
    return;
  }
  if (fresh(now_us)) {
    was_stale_ = false;
    return;
  }
  const TimeUs last = has_status_ ? std::min(status_us_, position_us_) : phase_since_us_;
  const TimeUs silent_us = now_us - std::max(last, phase_since_us_);
  if (!was_stale_ && silent_us > config_.stale_timeout_us) {
    was_stale_ = true;
    ++counters_.stale_periods;
  }
  if (silent_us > kSilentPdoTimeoutUs) {
    ++counters_.losses;
    enter_absent(now_us);
  }
}

// Bit 7 must rise, so the word is 0 until the pause is over, then 80h until the fault is gone; a
// reset that does not help is repeated after another, longer pause.
std::uint16_t Cia402Drive::fault_controlword(TimeUs now_us) {
  if (now_us < fault_reset_us_) return 0;
  if (!reset_edge_sent_) {
    reset_edge_sent_ = true;
    ++counters_.fault_resets;
  }
  if (now_us - fault_reset_us_ > kResetPulseUs) {
    reset_edge_sent_ = false;
    fault_reset_us_ = now_us + backoff_us_;
    backoff_us_ = std::min(2 * backoff_us_, config_.max_backoff_us);
    return 0;
  }
  return cia402::kControlFaultReset;
}

CanFrame Cia402Drive::next_rpdo(Goal goal, std::int32_t target_velocity, TimeUs now_us) {
  std::uint16_t controlword = cia402::controlword_of(cia402::next_command(state(), goal));
  if (!fresh(now_us))
    controlword = cia402::controlword_of(cia402::Command::kQuickStop);
  else if (state() == State::kFault)
    controlword = fault_controlword(now_us);
  else if (state() == State::kQuickStopActive && goal == Goal::kOperate &&
           now_us - state_since_us_ > kQuickStopPatienceUs)
    controlword = 0;  // transition 12
  const bool follows =
      fresh(now_us) && goal == Goal::kOperate && state() == State::kOperationEnabled;
  CanFrame frame{.id = static_cast<std::uint16_t>(canopen::kRpdo1Base + config_.node_id),
                 .size = 6};
  canopen::put_u16(frame, 0, controlword);
  canopen::put_u32(frame, 2, follows ? static_cast<std::uint32_t>(target_velocity) : 0);
  return frame;
}

}  // namespace ivfm
