#include "host/simulator/cia402_emulator.h"

#include <algorithm>
#include <cmath>

namespace ivfm::host {

using canopen::NmtCommand;
using canopen::NmtState;
using canopen::ObjectKey;
using cia402::Command;
using cia402::State;

namespace {

constexpr auto kU8 = ObjectType::kUnsigned8;
constexpr auto kU16 = ObjectType::kUnsigned16;
constexpr auto kU32 = ObjectType::kUnsigned32;
constexpr auto kI8 = ObjectType::kInteger8;
constexpr auto kI16 = ObjectType::kInteger16;
constexpr auto kI32 = ObjectType::kInteger32;
constexpr auto kConst = ObjectAccess::kConst;
constexpr auto kRo = ObjectAccess::kReadOnly;
constexpr auto kRw = ObjectAccess::kReadWrite;

constexpr std::uint8_t kRegisterGeneric = 0x01;        // error register 1001h, bit 0
constexpr std::uint8_t kRegisterCommunication = 0x10;  // bit 4
constexpr std::uint16_t kErrorHeartbeat = 0x8130;      // life guard or heartbeat error
constexpr std::uint8_t kMappingSlots = 4;

// The order matters: by index, then sub-index. ivfm_drive.eds says the same; a test compares them.
constexpr ObjectEntry kDictionary[] = {
    {{0x1000, 0}, "Device type", kU32, kRo, false, 0x00020192},
    {{0x1001, 0}, "Error register", kU8, kRo, true, 0},
    {{0x1005, 0}, "COB-ID SYNC message", kU32, kRw, false, 0x80},
    {{0x1014, 0}, "COB-ID EMCY", kU32, kRo, false, 0x80, true},
    {{0x1016, 0}, "Highest sub-index supported", kU8, kConst, false, 1},
    {{0x1016, 1}, "Consumer heartbeat time 1", kU32, kRw, false, 0},
    {{0x1017, 0}, "Producer heartbeat time", kU16, kRw, false, 0},
    {{0x1018, 0}, "Highest sub-index supported", kU8, kConst, false, 4},
    {{0x1018, 1}, "Vendor-ID", kU32, kRo, false, 0},
    {{0x1018, 2}, "Product code", kU32, kRo, false, 0x4956464d},
    {{0x1018, 3}, "Revision number", kU32, kRo, false, 0x00010000},
    {{0x1018, 4}, "Serial number", kU32, kRo, false, 0},
    {{0x1029, 0}, "Highest sub-index supported", kU8, kConst, false, 1},
    {{0x1029, 1}, "Communication error", kU8, kRw, false, 0},
    {{0x1400, 0}, "Highest sub-index supported", kU8, kConst, false, 2},
    {{0x1400, 1}, "COB-ID used by RPDO", kU32, kRw, false, 0x200, true},
    {{0x1400, 2}, "Transmission type", kU8, kRw, false, 255},
    {{0x1600, 0}, "Number of mapped objects", kU8, kRw, false, 1},
    {{0x1600, 1}, "Mapped object 1", kU32, kRw, false, 0x60400010},
    {{0x1600, 2}, "Mapped object 2", kU32, kRw, false, 0},
    {{0x1600, 3}, "Mapped object 3", kU32, kRw, false, 0},
    {{0x1600, 4}, "Mapped object 4", kU32, kRw, false, 0},
    {{0x1800, 0}, "Highest sub-index supported", kU8, kConst, false, 2},
    {{0x1800, 1}, "COB-ID used by TPDO", kU32, kRw, false, 0x40000180, true},
    {{0x1800, 2}, "Transmission type", kU8, kRw, false, 1},
    {{0x1801, 0}, "Highest sub-index supported", kU8, kConst, false, 2},
    {{0x1801, 1}, "COB-ID used by TPDO", kU32, kRw, false, 0xc0000280, true},
    {{0x1801, 2}, "Transmission type", kU8, kRw, false, 1},
    {{0x1a00, 0}, "Number of mapped objects", kU8, kRw, false, 1},
    {{0x1a00, 1}, "Mapped object 1", kU32, kRw, false, 0x60410010},
    {{0x1a00, 2}, "Mapped object 2", kU32, kRw, false, 0},
    {{0x1a00, 3}, "Mapped object 3", kU32, kRw, false, 0},
    {{0x1a00, 4}, "Mapped object 4", kU32, kRw, false, 0},
    {{0x1a01, 0}, "Number of mapped objects", kU8, kRw, false, 1},
    {{0x1a01, 1}, "Mapped object 1", kU32, kRw, false, 0x60640020},
    {{0x1a01, 2}, "Mapped object 2", kU32, kRw, false, 0},
    {{0x1a01, 3}, "Mapped object 3", kU32, kRw, false, 0},
    {{0x1a01, 4}, "Mapped object 4", kU32, kRw, false, 0},
    {{0x6007, 0}, "Abort connection option code", kI16, kRw, false, 1},
    {{0x603f, 0}, "Error code", kU16, kRo, true, 0},
    {{0x6040, 0}, "Controlword", kU16, kRw, true, 0},
    {{0x6041, 0}, "Statusword", kU16, kRo, true, 0},
    {{0x605a, 0}, "Quick stop option code", kI16, kRw, false, 2},
    {{0x605e, 0}, "Fault reaction option code", kI16, kRw, false, 2},
    {{0x6060, 0}, "Modes of operation", kI8, kRw, true, 0},
    {{0x6061, 0}, "Modes of operation display", kI8, kRo, true, 0},
    {{0x6064, 0}, "Position actual value", kI32, kRo, true, 0},
    {{0x606c, 0}, "Velocity actual value", kI32, kRo, true, 0},
    {{0x6083, 0}, "Profile acceleration", kU32, kRw, false, 10000},
    {{0x6084, 0}, "Profile deceleration", kU32, kRw, false, 10000},
    {{0x6085, 0}, "Quick stop deceleration", kU32, kRw, false, 50000},
    {{0x60ff, 0}, "Target velocity", kI32, kRw, true, 0},
    {{0x6502, 0}, "Supported drive modes", kU32, kRo, false, 0x00000004},
};

constexpr bool is_mapping(std::uint16_t index) {
  return index == 0x1600 || index == 0x1a00 || index == 0x1a01;
}
constexpr std::uint16_t communication_of(std::uint16_t mapping) {
  return static_cast<std::uint16_t>(mapping - 0x200);
}

// A signed object's value from its dictionary bits.
std::int16_t as_i16(std::uint32_t value) {
  return static_cast<std::int16_t>(static_cast<std::uint16_t>(value & 0xffffu));
}

// Moves `value` toward `target` by at most `step`.
double approach(double value, double target, double step) {
  return value < target ? std::min(value + step, target) : std::max(value - step, target);
}

}  // namespace

std::span<const ObjectEntry> drive_dictionary() { return kDictionary; }

Cia402Emulator::Cia402Emulator(const Cia402EmulatorConfig& config) : config_(config) {
  for (const ObjectEntry& entry : kDictionary) cells_.push_back({&entry, 0});
  set_defaults(0x1000, 0xffff);
}

// ---- Object dictionary ----

Cia402Emulator::Cell* Cia402Emulator::find(ObjectKey key) {
  const auto cell = std::find_if(cells_.begin(), cells_.end(),
                                 [&](const Cell& c) { return c.entry->key == key; });
  return cell == cells_.end() ? nullptr : &*cell;
}
const Cia402Emulator::Cell* Cia402Emulator::find(ObjectKey key) const {
  return const_cast<Cia402Emulator*>(this)->find(key);
}

bool Cia402Emulator::index_exists(std::uint16_t index) const {
  return std::any_of(cells_.begin(), cells_.end(),
                     [&](const Cell& c) { return c.entry->key.index == index; });
}

void Cia402Emulator::set_defaults(std::uint16_t first_index, std::uint16_t last_index) {
  for (Cell& cell : cells_) {
    if (cell.entry->key.index < first_index || cell.entry->key.index > last_index) continue;
    cell.value = cell.entry->default_value + (cell.entry->plus_node_id ? config_.node_id : 0u);
  }
}

std::uint32_t Cia402Emulator::read_value(const Cell& cell) const {
  switch (cell.entry->key.index) {
    case 0x1001: return error_register_;
    case 0x603f: return error_code_;
    case 0x6041: return statusword();
    case 0x6061: return object(cia402::kModeOfOperation);
    case 0x6064: return static_cast<std::uint32_t>(encoder_position());
    case 0x606c: return static_cast<std::uint32_t>(static_cast<std::int32_t>(std::lround(speed_)));
    default: return cell.value;
  }
}

std::uint32_t Cia402Emulator::object(ObjectKey key) const {
  const Cell* cell = find(key);
  return cell ? read_value(*cell) : 0;
}

void Cia402Emulator::store(ObjectKey key, std::uint32_t value) {
  if (Cell* cell = find(key)) cell->value = value;
}

// ---- Frames ----

void Cia402Emulator::queue(const CanFrame& frame) {
  if (!silent_) out_.push_back(frame);
}

std::optional<CanFrame> Cia402Emulator::transmit() {
  if (out_.empty()) return std::nullopt;
  const CanFrame frame = out_.front();
  out_.pop_front();
  return frame;
}

void Cia402Emulator::receive(const CanFrame& frame, TimeUs now_us) {
  step(now_us);
  if (silent_ || booting_ || frame.remote) return;
  std::uint16_t rpdo_id = 0;
  if (frame.id == canopen::kNmtId) {
    on_nmt(frame);
  } else if (frame.id == (object({0x1005, 0}) & 0x7ffu)) {
    on_sync();
  } else if (frame.id == canopen::kSdoRequestBase + config_.node_id) {
    if (nmt_ != NmtState::kStopped) on_sdo(frame);
  } else if (frame.id > canopen::kHeartbeatBase) {
    on_master_heartbeat(frame);
  } else if (pdo_valid(0x1400, &rpdo_id) && frame.id == rpdo_id) {
    on_rpdo(frame);
  }
}

void Cia402Emulator::set_silent(bool silent) {
  silent_ = silent;
  if (silent) out_.clear();
}

// ---- NMT ----

void Cia402Emulator::on_nmt(const CanFrame& frame) {
  if (frame.size != 2 || (frame.data[1] != 0 && frame.data[1] != config_.node_id)) return;
  switch (static_cast<NmtCommand>(frame.data[0])) {
    case NmtCommand::kStart: nmt_ = NmtState::kOperational; break;
    case NmtCommand::kStop:
      nmt_ = NmtState::kStopped;
      lose_connection();
      break;
    case NmtCommand::kEnterPreOperational: nmt_ = NmtState::kPreOperational; break;
    case NmtCommand::kResetNode: reset(true); break;
    case NmtCommand::kResetCommunication: reset(false); break;
  }
}

// Starts the way to the boot-up message. A communication reset keeps the application running.
void Cia402Emulator::reset(bool application) {
  if (application) {
    set_defaults(0x2000, 0xffff);
    position_ = 0;
    error_code_ = 0;
    state_ = State::kNotReadyToSwitchOn;
    controlword_ = 0;
  } else {
    lose_connection();
  }
  set_defaults(0x1000, 0x1fff);
  error_register_ = state_ == State::kFault ? error_register_ : 0;
  nmt_ = NmtState::kBootUp;
  booting_ = true;
  boot_at_us_ = now_us_ + config_.boot_time_us;
  master_watched_ = master_lost_ = false;
  pending_rpdo_.reset();
}

void Cia402Emulator::power_cycle(TimeUs now_us) {
  step(now_us);
  out_.clear();
  reset(true);
}

// ---- Heartbeats ----

void Cia402Emulator::on_master_heartbeat(const CanFrame& frame) {
  const std::uint32_t consumer = object({0x1016, 1});
  const std::uint32_t node = (consumer >> 16) & 0x7fu;
  if (node == 0 || (consumer & 0xffffu) == 0 || frame.id != canopen::kHeartbeatBase + node) return;
  if (master_lost_) {  // error reset
    master_lost_ = false;
    error_register_ &= static_cast<std::uint8_t>(~kRegisterCommunication);
    if (error_register_ == kRegisterGeneric && state_ != State::kFault) error_register_ = 0;
    queue(canopen::emergency_frame(config_.node_id, 0, error_register_));
  }
  master_watched_ = true;
  master_deadline_us_ = now_us_ + TimeUs{1000} * (consumer & 0xffffu);
}

void Cia402Emulator::step_heartbeats(TimeUs now_us) {
  const TimeUs period_us = TimeUs{1000} * object({0x1017, 0});
  if (period_us > 0 && now_us >= next_heartbeat_us_) {
    next_heartbeat_us_ = now_us + period_us;
    queue(canopen::heartbeat_frame(config_.node_id, nmt_));
  }
  if (!master_watched_ || now_us < master_deadline_us_) return;
  master_watched_ = false;
  master_lost_ = true;
  ++counters_.heartbeat_losses;
  error_register_ |= kRegisterGeneric | kRegisterCommunication;
  queue(canopen::emergency_frame(config_.node_id, kErrorHeartbeat, error_register_));
  if (nmt_ == NmtState::kOperational) {
    const std::uint32_t behaviour = object({0x1029, 1});
    if (behaviour == 0) nmt_ = NmtState::kPreOperational;
    if (behaviour == 2) nmt_ = NmtState::kStopped;
  }
  lose_connection();
}

// ---- SDO server ----

void Cia402Emulator::abort(ObjectKey key, std::uint32_t code) {
  ++counters_.sdo_aborts;
  queue(canopen::sdo_abort_frame(canopen::kSdoResponseBase, config_.node_id, key, code));
}

void Cia402Emulator::on_sdo(const CanFrame& frame) {
  if (frame.size != 8) return;
  ++counters_.sdo_requests;
  const ObjectKey key = canopen::sdo_key(frame);
  const unsigned specifier = frame.data[0] >> 5;
  if (specifier == 4) return;  // the client aborts: nothing is under way
  if (specifier == 2) return sdo_upload(key);
  const bool expedited = specifier == 1 && (frame.data[0] & 0x02u);
  if (!expedited) return abort(key, canopen::kAbortCommand);
  sdo_download(frame, key);
}

void Cia402Emulator::sdo_upload(ObjectKey key) {
  const Cell* cell = find(key);
  if (!cell) {
    return abort(key,
                 index_exists(key.index) ? canopen::kAbortNoSubIndex : canopen::kAbortNoObject);
  }
  const unsigned size = size_of(cell->entry->type);
  CanFrame answer =
      canopen::sdo_frame(static_cast<std::uint16_t>(canopen::kSdoResponseBase + config_.node_id),
                         static_cast<std::uint8_t>(0x43u | ((4u - size) << 2)), key);
  const std::uint32_t value = read_value(*cell);
  canopen::put_u32(answer, 4, size == 4 ? value : value & ((1u << (8 * size)) - 1));
  queue(answer);
}

void Cia402Emulator::sdo_download(const CanFrame& frame, ObjectKey key) {
  const Cell* cell = find(key);
  if (!cell) {
    return abort(key,
                 index_exists(key.index) ? canopen::kAbortNoSubIndex : canopen::kAbortNoObject);
  }
  const unsigned needed = size_of(cell->entry->type);
  const unsigned given = frame.data[0] & 1u ? 4u - ((frame.data[0] >> 2) & 3u) : needed;
  if (cell->entry->access != kRw) return abort(key, canopen::kAbortReadOnly);
  if (given != needed) {
    return abort(key, given > needed ? canopen::kAbortTooLong : canopen::kAbortTooShort);
  }
  const std::uint32_t value = canopen::get_u32(frame, 4) & (0xffffffffu >> (8 * (4 - needed)));
  const std::uint32_t code = write(key, value);
  if (code != 0) return abort(key, code);
  queue(canopen::sdo_frame(static_cast<std::uint16_t>(canopen::kSdoResponseBase + config_.node_id),
                           0x60, key));
}

// Writes a read-write object of this key; 0 or the abort code.
std::uint32_t Cia402Emulator::write(ObjectKey key, std::uint32_t value) {
  Cell* cell = find(key);
  if (const std::uint32_t code = check_write(*cell, value)) return code;
  cell->value = value;
  if (key == cia402::kControlword) on_controlword(static_cast<std::uint16_t>(value));
  if (key == ObjectKey{0x1017, 0}) next_heartbeat_us_ = now_us_ + TimeUs{1000} * value;
  if (key == ObjectKey{0x1016, 1}) master_watched_ = false;  // starts with the next heartbeat
  return 0;
}

std::uint32_t Cia402Emulator::check_write(const Cell& cell, std::uint32_t value) const {
  const ObjectKey key = cell.entry->key;
  const bool pdo = (key.index & 0xff00u) == 0x1400 || (key.index & 0xff00u) == 0x1800;
  if (is_mapping(key.index)) return check_mapping(key, value);
  if (pdo && key.sub == 1 && !(cell.value & canopen::kPdoInvalid) &&
      !(value & canopen::kPdoInvalid) && (cell.value & 0x7ffu) != (value & 0x7ffu)) {
    return canopen::kAbortAccess;  // the identifier may change only while the PDO is invalid
  }
  if (pdo && key.sub == 2 && value > 240 && value < 254) return canopen::kAbortValueRange;
  if (key == cia402::kModeOfOperation && value != 0 && value != cia402::kProfileVelocityMode) {
    return canopen::kAbortValueRange;
  }
  const auto option = as_i16(value);
  if (key == cia402::kQuickStopOption && (option < 0 || option > 6 || option == 3 || option == 4)) {
    return canopen::kAbortValueRange;
  }
  if (key == cia402::kFaultReactionOption && (option < 0 || option > 2)) {
    return canopen::kAbortValueRange;
  }
  if (key == cia402::kAbortConnectionOption && (option < 0 || option > 3)) {
    return canopen::kAbortValueRange;
  }
  return 0;
}

// CiA 301 section 7.5.2.36: entries change only while the PDO is invalid and its count is 0.
std::uint32_t Cia402Emulator::check_mapping(ObjectKey key, std::uint32_t value) const {
  if (pdo_valid(communication_of(key.index), nullptr)) return canopen::kAbortAccess;
  if (key.sub == 0) {
    if (value > kMappingSlots) return canopen::kAbortValueRange;
    std::uint32_t bits = 0;
    for (std::uint8_t i = 1; i <= value; ++i) bits += object({key.index, i}) & 0xffu;
    return bits > 64 ? canopen::kAbortPdoLength : 0;
  }
  if (object({key.index, 0}) != 0) return canopen::kAbortAccess;
  if (value == 0) return 0;
  const Cell* target = find(
      {static_cast<std::uint16_t>(value >> 16), static_cast<std::uint8_t>((value >> 8) & 0xffu)});
  const bool receives = key.index < 0x1800;
  const bool fits = target && target->entry->mappable &&
                    (value & 0xffu) == 8u * size_of(target->entry->type) &&
                    (!receives || target->entry->access == kRw);
  if (!target) return canopen::kAbortNoObject;
  return fits ? 0 : canopen::kAbortNotMappable;
}

// ---- PDOs ----

bool Cia402Emulator::pdo_valid(std::uint16_t communication, std::uint16_t* id) const {
  const std::uint32_t cob_id = object({communication, 1});
  if (id) *id = static_cast<std::uint16_t>(cob_id & 0x7ffu);
  return !(cob_id & canopen::kPdoInvalid);
}

std::uint32_t Cia402Emulator::mapped_bits(std::uint16_t mapping) const {
  std::uint32_t bits = 0;
  for (std::uint8_t i = 1; i <= object({mapping, 0}); ++i) bits += object({mapping, i}) & 0xffu;
  return bits;
}

void Cia402Emulator::on_rpdo(const CanFrame& frame) {
  if (nmt_ != NmtState::kOperational) return;
  if (frame.size * 8u < mapped_bits(0x1600)) {  // EMCY 8210h: PDO too short
    send_emergency(0x8210, kRegisterGeneric | kRegisterCommunication);
    return;
  }
  ++counters_.rpdos;
  if (object({0x1400, 2}) <= 240) {
    pending_rpdo_ = frame;  // acts at the next SYNC
  } else {
    apply_rpdo(frame);
  }
}

void Cia402Emulator::apply_rpdo(const CanFrame& frame) {
  std::size_t at = 0;
  for (std::uint8_t i = 1; i <= object({0x1600, 0}); ++i) {
    const std::uint32_t entry = object({0x1600, i});
    const std::size_t size = (entry & 0xffu) / 8;
    std::uint32_t value = 0;
    for (std::size_t b = 0; b < size; ++b) value |= std::uint32_t{frame.data[at + b]} << (8 * b);
    at += size;
    write({static_cast<std::uint16_t>(entry >> 16), static_cast<std::uint8_t>((entry >> 8) & 0xff)},
          value);
  }
}

void Cia402Emulator::on_sync() {
  ++counters_.syncs;
  if (nmt_ != NmtState::kOperational) return;
  if (pending_rpdo_) {
    const CanFrame frame = *pending_rpdo_;
    pending_rpdo_.reset();
    apply_rpdo(frame);
  }
  for (std::uint16_t i = 0; i < 2; ++i) {
    const auto communication = static_cast<std::uint16_t>(0x1800 + i);
    const std::uint32_t type = object({communication, 2});
    if (type < 1 || type > 240) continue;
    if (++sync_counts_[i] < type) continue;
    sync_counts_[i] = 0;
    send_tpdo(communication, static_cast<std::uint16_t>(0x1a00 + i));
  }
}

void Cia402Emulator::send_tpdo(std::uint16_t communication, std::uint16_t mapping) {
  CanFrame frame;
  if (!pdo_valid(communication, &frame.id)) return;
  for (std::uint8_t i = 1; i <= object({mapping, 0}); ++i) {
    const std::uint32_t entry = object({mapping, i});
    const std::uint32_t value = object(
        {static_cast<std::uint16_t>(entry >> 16), static_cast<std::uint8_t>((entry >> 8) & 0xff)});
    for (unsigned bit = 0; bit < (entry & 0xffu); bit += 8) {
      frame.data[frame.size++] = static_cast<std::uint8_t>((value >> bit) & 0xffu);
    }
  }
  queue(frame);
}

// ---- Power state machine, CiA 402-2 figure 8 ----

std::uint16_t Cia402Emulator::statusword() const {
  std::uint16_t word = 0;
  for (const cia402::StatusPattern& pattern : cia402::kStatusPatterns) {
    if (pattern.state == state_) word = pattern.value;
  }
  word |= cia402::kStatusVoltageEnabled;
  if (nmt_ == NmtState::kOperational) word |= cia402::kStatusRemote;
  const double target = static_cast<std::int32_t>(object(cia402::kTargetVelocity));
  if (state_ == State::kOperationEnabled && std::abs(speed_ - target) < 1.0) {
    word |= cia402::kStatusTargetReached;
  }
  if (std::abs(speed_) < 1.0) word |= cia402::kStatusSpeedZero;
  return word;
}

void Cia402Emulator::enter(State state) { state_ = state; }

void Cia402Emulator::on_controlword(std::uint16_t controlword) {
  const bool edge = (controlword & ~controlword_ & cia402::kControlFaultReset) != 0;
  controlword_ = controlword;
  if (edge && state_ == State::kFault) {  // transition 15
    error_code_ = 0;
    error_register_ = 0;
    queue(canopen::emergency_frame(config_.node_id, 0, 0));
    return enter(State::kSwitchOnDisabled);
  }
  const Command command = cia402::command_of(controlword);
  const auto option = as_i16(object(cia402::kQuickStopOption));
  if (state_ == State::kQuickStopActive && command == Command::kEnableOperation && option >= 5) {
    return enter(State::kOperationEnabled);  // transition 16
  }
  if (state_ == State::kOperationEnabled && command == Command::kQuickStop && option == 0) {
    return enter(State::kSwitchOnDisabled);  // the drive function is disabled at once
  }
  enter(cia402::next_state(state_, command));
}

// CiA 402-2, abort connection option code 6007h.
void Cia402Emulator::lose_connection() {
  pending_rpdo_.reset();
  const bool moving = state_ == State::kOperationEnabled;
  switch (as_i16(object(cia402::kAbortConnectionOption))) {
    case 1:
      if (moving) raise_fault(kErrorHeartbeat);
      break;
    case 2:
      if (moving) enter(State::kSwitchOnDisabled);
      break;
    case 3:
      if (moving) enter(State::kQuickStopActive);
      break;
    default: break;
  }
}

void Cia402Emulator::raise_fault(std::uint16_t error_code) {
  if (state_ == State::kFault || state_ == State::kFaultReactionActive) return;
  error_code_ = error_code;
  error_register_ |= kRegisterGeneric;
  queue(canopen::emergency_frame(config_.node_id, error_code, error_register_));
  const bool brakes = as_i16(object(cia402::kFaultReactionOption)) != 0 && speed_ != 0;
  enter(brakes ? State::kFaultReactionActive : State::kFault);
}

void Cia402Emulator::send_emergency(std::uint16_t error_code, std::uint8_t error_register) {
  queue(canopen::emergency_frame(config_.node_id, error_code, error_register));
}

// ---- Motor ----

std::int32_t Cia402Emulator::encoder_position() const {
  const auto counts = static_cast<std::int64_t>(std::floor(position_));
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(counts & 0xffffffff));
}

// The speed the drive works toward, and how fast it gets there in counts/s^2.
double Cia402Emulator::wanted_speed(double& ramp) const {
  const double quick = object(cia402::kQuickStopDeceleration);
  const double profile = object(cia402::kProfileDeceleration);
  ramp = config_.coast_deceleration;
  if (state_ == State::kOperationEnabled &&
      object(cia402::kModeOfOperation) == cia402::kProfileVelocityMode) {
    const bool halted = (controlword_ & cia402::kControlHalt) != 0;
    const double target = halted ? 0 : static_cast<std::int32_t>(object(cia402::kTargetVelocity));
    const bool faster = std::abs(target) > std::abs(speed_) && target * speed_ >= 0;
    ramp = faster ? object(cia402::kProfileAcceleration) : profile;
    return std::clamp(target, -config_.max_speed, config_.max_speed);
  }
  if (state_ == State::kQuickStopActive) {
    const auto option = as_i16(object(cia402::kQuickStopOption));
    ramp = option == 1 || option == 5 ? profile : quick;
  }
  if (state_ == State::kFaultReactionActive) {
    ramp = as_i16(object(cia402::kFaultReactionOption)) == 1 ? profile : quick;
  }
  return 0;
}

// What happens by itself once the motor stands: transitions 12 and 14.
void Cia402Emulator::finish_stop() {
  if (state_ == State::kQuickStopActive && as_i16(object(cia402::kQuickStopOption)) < 5) {
    enter(State::kSwitchOnDisabled);
  }
  if (state_ == State::kFaultReactionActive) enter(State::kFault);
}

void Cia402Emulator::step_motor(double seconds) {
  double ramp = 0;
  const double target = wanted_speed(ramp);
  const double before = speed_;
  speed_ = blocked_ ? 0 : approach(speed_, target, ramp * seconds);
  const double moved = 0.5 * (before + speed_) * seconds;
  position_ += moved;
  ground_position_ += moved * (1.0 - slip_);
  if (speed_ == 0) finish_stop();
}

void Cia402Emulator::step(TimeUs now_us) {
  if (!started_) {
    started_ = true;
    now_us_ = now_us;
    boot_at_us_ = now_us + config_.boot_time_us;
  }
  if (now_us > now_us_) {
    step_motor(static_cast<double>(now_us - now_us_) * 1e-6);
    now_us_ = now_us;
  }
  if (booting_) {
    if (now_us < boot_at_us_) return;
    booting_ = false;
    ++counters_.boots;
    nmt_ = NmtState::kPreOperational;
    if (state_ == State::kNotReadyToSwitchOn) enter(State::kSwitchOnDisabled);  // transitions 0, 1
    queue(canopen::heartbeat_frame(config_.node_id, NmtState::kBootUp));
    next_heartbeat_us_ = now_us;
  }
  step_heartbeats(now_us);
}

void DriveGroup::step(TimeUs now_us) {
  for (;;) {
    const Result<CanFrame> frame = bus_.receive();
    if (!frame.ok()) break;
    for (Cia402Emulator* drive : drives_) drive->receive(*frame, now_us);
  }
  for (Cia402Emulator* drive : drives_) {
    drive->step(now_us);
    while (const std::optional<CanFrame> frame = drive->transmit()) {
      if (!ok(bus_.send(*frame))) ++lost_frames_;
    }
  }
}

}  // namespace ivfm::host
