// The CiA 402 power state machine as data: states, statusword patterns, commands, transitions.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/wheel_drive/canopen.h"

namespace ivfm::cia402 {

// Objects of the drive profile (CiA 402-2) that the wheel drive uses.
inline constexpr canopen::ObjectKey kAbortConnectionOption{0x6007, 0};
inline constexpr canopen::ObjectKey kErrorCode{0x603f, 0};
inline constexpr canopen::ObjectKey kControlword{0x6040, 0};
inline constexpr canopen::ObjectKey kStatusword{0x6041, 0};
inline constexpr canopen::ObjectKey kQuickStopOption{0x605a, 0};
inline constexpr canopen::ObjectKey kFaultReactionOption{0x605e, 0};
inline constexpr canopen::ObjectKey kModeOfOperation{0x6060, 0};
inline constexpr canopen::ObjectKey kModeDisplay{0x6061, 0};
inline constexpr canopen::ObjectKey kPositionActual{0x6064, 0};
inline constexpr canopen::ObjectKey kVelocityActual{0x606c, 0};
inline constexpr canopen::ObjectKey kProfileAcceleration{0x6083, 0};
inline constexpr canopen::ObjectKey kProfileDeceleration{0x6084, 0};
inline constexpr canopen::ObjectKey kQuickStopDeceleration{0x6085, 0};
inline constexpr canopen::ObjectKey kTargetVelocity{0x60ff, 0};
inline constexpr canopen::ObjectKey kSupportedModes{0x6502, 0};

inline constexpr std::uint8_t kProfileVelocityMode = 3;
inline constexpr std::uint16_t kDeviceProfile = 402;  // low half of object 1000h

// Bits of the statusword besides the state's.
inline constexpr std::uint16_t kStatusVoltageEnabled = 1u << 4;
inline constexpr std::uint16_t kStatusRemote = 1u << 9;
inline constexpr std::uint16_t kStatusTargetReached = 1u << 10;
inline constexpr std::uint16_t kStatusSpeedZero = 1u << 12;  // profile velocity mode

// Bits of the controlword besides the command's.
inline constexpr std::uint16_t kControlFaultReset = 1u << 7;
inline constexpr std::uint16_t kControlHalt = 1u << 8;

enum class State : std::uint8_t {
  kNotReadyToSwitchOn,
  kSwitchOnDisabled,
  kReadyToSwitchOn,
  kSwitchedOn,
  kOperationEnabled,
  kQuickStopActive,
  kFaultReactionActive,
  kFault,
};
inline constexpr std::size_t kStateCount = 8;

constexpr const char* to_string(State state) {
  constexpr std::array<const char*, kStateCount> kNames = {
      "not ready to switch on", "switch on disabled", "ready to switch on",    "switched on",
      "operation enabled",      "quick stop active",  "fault reaction active", "fault"};
  return kNames[static_cast<std::size_t>(state)];
}

// Statusword bits that name a state: (statusword & mask) == value. CiA 402-2 section 8.4.2,
// table 30.
struct StatusPattern {
  State state;
  std::uint16_t mask;
  std::uint16_t value;
};
inline constexpr std::array<StatusPattern, kStateCount> kStatusPatterns = {{
    {State::kNotReadyToSwitchOn, 0x4f, 0x00},
    {State::kSwitchOnDisabled, 0x4f, 0x40},
    {State::kReadyToSwitchOn, 0x6f, 0x21},
    {State::kSwitchedOn, 0x6f, 0x23},
    {State::kOperationEnabled, 0x6f, 0x27},
    {State::kQuickStopActive, 0x6f, 0x07},
    {State::kFaultReactionActive, 0x4f, 0x0f},
    {State::kFault, 0x4f, 0x08},
}};

// The state that a statusword names; kNotReadyToSwitchOn for a pattern the profile does not define.
constexpr State state_of(std::uint16_t statusword) {
  for (const StatusPattern& pattern : kStatusPatterns) {
    if ((statusword & pattern.mask) == pattern.value) return pattern.state;
  }
  return State::kNotReadyToSwitchOn;
}

enum class Command : std::uint8_t {
  kNone,
  kShutdown,
  kSwitchOn,
  kEnableOperation,
  kDisableVoltage,
  kQuickStop,
  kFaultReset,  // a rising edge of bit 7
};

// Controlword bits of each command. Disable operation has switch on's bits. Table 27.
constexpr std::uint16_t controlword_of(Command command) {
  switch (command) {
    case Command::kShutdown: return 0x06;
    case Command::kSwitchOn: return 0x07;
    case Command::kEnableOperation: return 0x0f;
    case Command::kQuickStop: return 0x02;
    case Command::kFaultReset: return kControlFaultReset;
    case Command::kDisableVoltage:
    case Command::kNone: break;
  }
  return 0x00;
}

// The command that a controlword without a fault reset edge carries.
constexpr Command command_of(std::uint16_t controlword) {
  const unsigned bits = controlword & 0x0fu;
  if (!(bits & 0x02u)) return Command::kDisableVoltage;
  if (!(bits & 0x04u)) return Command::kQuickStop;
  if (!(bits & 0x01u)) return Command::kShutdown;
  return bits & 0x08u ? Command::kEnableOperation : Command::kSwitchOn;
}

// Transitions that a command causes (figure 8; 0, 1, 13 and 14 happen by themselves).
struct Transition {
  std::uint8_t number;
  State from;
  Command command;
  State to;
};
inline constexpr std::array<Transition, 13> kTransitions = {{
    {2, State::kSwitchOnDisabled, Command::kShutdown, State::kReadyToSwitchOn},
    {3, State::kReadyToSwitchOn, Command::kSwitchOn, State::kSwitchedOn},
    {4, State::kSwitchedOn, Command::kEnableOperation, State::kOperationEnabled},
    {5, State::kOperationEnabled, Command::kSwitchOn, State::kSwitchedOn},
    {6, State::kSwitchedOn, Command::kShutdown, State::kReadyToSwitchOn},
    {7, State::kReadyToSwitchOn, Command::kDisableVoltage, State::kSwitchOnDisabled},
    {7, State::kReadyToSwitchOn, Command::kQuickStop, State::kSwitchOnDisabled},
    {8, State::kOperationEnabled, Command::kShutdown, State::kReadyToSwitchOn},
    {9, State::kOperationEnabled, Command::kDisableVoltage, State::kSwitchOnDisabled},
    {10, State::kSwitchedOn, Command::kDisableVoltage, State::kSwitchOnDisabled},
    {10, State::kSwitchedOn, Command::kQuickStop, State::kSwitchOnDisabled},
    {11, State::kOperationEnabled, Command::kQuickStop, State::kQuickStopActive},
    {12, State::kQuickStopActive, Command::kDisableVoltage, State::kSwitchOnDisabled},
}};
// Besides these: 15, fault reset, kFault to kSwitchOnDisabled (an edge, not a level); 16, enable
// operation from kQuickStopActive, only with quick stop options 5 to 8.

// Where `command` leads from `from`; `from` itself when the command does nothing there.
constexpr State next_state(State from, Command command) {
  for (const Transition& transition : kTransitions) {
    if (transition.from == from && transition.command == command) return transition.to;
  }
  if (from == State::kFault && command == Command::kFaultReset) return State::kSwitchOnDisabled;
  // Enable operation in ready to switch on runs transitions 3 and 4 in one go (footnote of table
  // 27) in drives that can; ours asks for one step at a time.
  return from;
}

// What the master wants of a drive.
enum class Goal : std::uint8_t {
  kOff,        // no torque
  kOperate,    // follow the target velocity
  kQuickStop,  // brake on the quick stop ramp, then no torque
};
inline constexpr std::size_t kGoalCount = 3;

// The master's next command: row = drive's state, column = goal. A fault is never reset by goal
// kOff or kQuickStop. In quick stop active the drive leaves by itself when it stands (605Ah = 2).
inline constexpr std::array<std::array<Command, kGoalCount>, kStateCount> kNextCommand = {{
    /* not ready     */ {Command::kDisableVoltage, Command::kDisableVoltage, Command::kQuickStop},
    /* disabled      */ {Command::kDisableVoltage, Command::kShutdown, Command::kQuickStop},
    /* ready         */ {Command::kDisableVoltage, Command::kSwitchOn, Command::kQuickStop},
    /* switched on   */ {Command::kDisableVoltage, Command::kEnableOperation, Command::kQuickStop},
    /* enabled       */ {Command::kDisableVoltage, Command::kEnableOperation, Command::kQuickStop},
    /* quick stop    */ {Command::kDisableVoltage, Command::kQuickStop, Command::kQuickStop},
    /* fault reaction*/ {Command::kDisableVoltage, Command::kDisableVoltage, Command::kQuickStop},
    /* fault         */ {Command::kDisableVoltage, Command::kFaultReset, Command::kDisableVoltage},
}};

constexpr Command next_command(State state, Goal goal) {
  return kNextCommand[static_cast<std::size_t>(state)][static_cast<std::size_t>(goal)];
}

namespace detail {
// From every resting state the commands toward kOperate end in operation enabled.
constexpr bool operation_is_reachable() {
  for (const State start : {State::kSwitchOnDisabled, State::kReadyToSwitchOn, State::kSwitchedOn,
                            State::kFault, State::kOperationEnabled}) {
    State state = start;
    for (int steps = 0; steps < 4; ++steps)
      state = next_state(state, next_command(state, Goal::kOperate));
    if (state != State::kOperationEnabled) return false;
  }
  return true;
}
// A moving drive brakes when a quick stop is wanted, and nothing that stands gets torque by it.
constexpr bool quick_stop_is_safe() {
  for (const StatusPattern& pattern : kStatusPatterns) {
    const State next = next_state(pattern.state, next_command(pattern.state, Goal::kQuickStop));
    if (next == State::kOperationEnabled || next == State::kSwitchedOn) return false;
  }
  return next_state(State::kOperationEnabled, Command::kQuickStop) == State::kQuickStopActive;
}
}  // namespace detail
static_assert(detail::operation_is_reachable());
static_assert(detail::quick_stop_is_safe());

}  // namespace ivfm::cia402
