// The supervisor's states, events and transitions as data, checked by the compiler.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace ivfm {

// What the robot as a whole is doing.
enum class RobotState : std::uint8_t {
  kBoot,       // waiting for the lidar, the drives and odometry
  kReady,      // everything is there, nothing to do
  kExploring,  // driving to see new places
  kReturning,  // driving back to where it started
  kExplored,   // nothing reachable is left to see
  kFound,      // the target was seen
  kFault,      // a cause in StopReason holds it; leaves by itself when the cause is gone
  kStopped,    // a person or the server said stop; leaves on RobotEvent::kStart only
};
inline constexpr std::size_t kRobotStates = 8;

enum class RobotEvent : std::uint8_t {
  kDevicesReady,  // every input is fresh
  kExplore,       // the mission is to explore
  kReturn,        // the mission is to go back to the start
  kMapExplored,   // no reachable unexplored cell is left
  kTargetFound,   // the target was seen
  kHome,          // back at the start
  kFault,         // an input went stale, a drive was lost, an internal error
  kFaultCleared,  // all causes have been gone for long enough
  kStop,          // stop command
  kStart,         // takes a stop command back
};
inline constexpr std::size_t kRobotEvents = 10;

// What a state lets through the gate.
enum class Motion : std::uint8_t { kNone, kDrive };

namespace supervisor_table {

struct StateRow {
  RobotState state;
  const char* name;
  Motion motion;
};

inline constexpr std::array<StateRow, kRobotStates> kStates{{
    {RobotState::kBoot, "boot", Motion::kNone},
    {RobotState::kReady, "ready", Motion::kNone},
    {RobotState::kExploring, "exploring", Motion::kDrive},
    {RobotState::kReturning, "returning", Motion::kDrive},
    {RobotState::kExplored, "explored", Motion::kNone},
    {RobotState::kFound, "found", Motion::kNone},
    {RobotState::kFault, "fault", Motion::kNone},
    {RobotState::kStopped, "stopped", Motion::kNone},
}};

struct Transition {
  RobotState from;
  RobotEvent event;
  RobotState to;
};

// Pairs that are not listed leave the state as it is.
inline constexpr std::array kTransitions{
    Transition{RobotState::kBoot, RobotEvent::kDevicesReady, RobotState::kReady},
    Transition{RobotState::kBoot, RobotEvent::kFault, RobotState::kFault},
    Transition{RobotState::kBoot, RobotEvent::kStop, RobotState::kStopped},

    Transition{RobotState::kReady, RobotEvent::kExplore, RobotState::kExploring},
    Transition{RobotState::kReady, RobotEvent::kReturn, RobotState::kReturning},
    Transition{RobotState::kReady, RobotEvent::kMapExplored, RobotState::kExplored},
    Transition{RobotState::kReady, RobotEvent::kTargetFound, RobotState::kFound},
    Transition{RobotState::kReady, RobotEvent::kFault, RobotState::kFault},
    Transition{RobotState::kReady, RobotEvent::kStop, RobotState::kStopped},

    Transition{RobotState::kExploring, RobotEvent::kReturn, RobotState::kReturning},
    Transition{RobotState::kExploring, RobotEvent::kMapExplored, RobotState::kExplored},
    Transition{RobotState::kExploring, RobotEvent::kTargetFound, RobotState::kFound},
    Transition{RobotState::kExploring, RobotEvent::kFault, RobotState::kFault},
    Transition{RobotState::kExploring, RobotEvent::kStop, RobotState::kStopped},

    Transition{RobotState::kReturning, RobotEvent::kExplore, RobotState::kExploring},
    Transition{RobotState::kReturning, RobotEvent::kHome, RobotState::kReady},
    Transition{RobotState::kReturning, RobotEvent::kFault, RobotState::kFault},
    Transition{RobotState::kReturning, RobotEvent::kStop, RobotState::kStopped},

    Transition{RobotState::kExplored, RobotEvent::kExplore, RobotState::kExploring},
    Transition{RobotState::kExplored, RobotEvent::kReturn, RobotState::kReturning},
    Transition{RobotState::kExplored, RobotEvent::kTargetFound, RobotState::kFound},
    Transition{RobotState::kExplored, RobotEvent::kFault, RobotState::kFault},
    Transition{RobotState::kExplored, RobotEvent::kStop, RobotState::kStopped},

    Transition{RobotState::kFound, RobotEvent::kExplore, RobotState::kExploring},
    Transition{RobotState::kFound, RobotEvent::kReturn, RobotState::kReturning},
    Transition{RobotState::kFound, RobotEvent::kFault, RobotState::kFault},
    Transition{RobotState::kFound, RobotEvent::kStop, RobotState::kStopped},

    Transition{RobotState::kFault, RobotEvent::kFaultCleared, RobotState::kReady},
    Transition{RobotState::kFault, RobotEvent::kFault, RobotState::kFault},
    Transition{RobotState::kFault, RobotEvent::kStop, RobotState::kStopped},

    Transition{RobotState::kStopped, RobotEvent::kStart, RobotState::kBoot},
    Transition{RobotState::kStopped, RobotEvent::kFault, RobotState::kStopped},
    Transition{RobotState::kStopped, RobotEvent::kStop, RobotState::kStopped},
};

// The index of the pair's row, or kTransitions.size() when it is not listed.
constexpr std::size_t index_of(RobotState state, RobotEvent event) {
  std::size_t i = 0;
  while (i < kTransitions.size() &&
         (kTransitions[i].from != state || kTransitions[i].event != event)) {
    ++i;
  }
  return i;
}

constexpr bool is_listed(RobotState state, RobotEvent event) {
  return index_of(state, event) < kTransitions.size();
}

// Where the pair leads. Requires is_listed().
constexpr RobotState next_state(RobotState state, RobotEvent event) {
  return kTransitions[index_of(state, event)].to;
}

constexpr Motion motion_in(RobotState state) {
  return kStates[static_cast<std::size_t>(state)].motion;
}

constexpr bool rows_are_in_order() {
  for (std::size_t i = 0; i < kRobotStates; ++i) {
    if (static_cast<std::size_t>(kStates[i].state) != i) return false;
  }
  return true;
}

constexpr bool every_pair_is_listed_once() {
  for (std::size_t i = 0; i < kTransitions.size(); ++i) {
    if (index_of(kTransitions[i].from, kTransitions[i].event) != i) return false;
  }
  return true;
}

// Every state answers `event`, and the answer is a state that lets no motion through.
constexpr bool always_stands_after(RobotEvent event) {
  for (const StateRow& row : kStates) {
    if (!is_listed(row.state, event)) return false;
    if (motion_in(next_state(row.state, event)) != Motion::kNone) return false;
  }
  return true;
}

// Every state can be reached from `start`.
constexpr bool every_state_reachable_from(RobotState start) {
  std::array<bool, kRobotStates> reached{};
  reached[static_cast<std::size_t>(start)] = true;
  for (std::size_t round = 0; round < kRobotStates; ++round) {
    for (const Transition& t : kTransitions) {
      if (reached[static_cast<std::size_t>(t.from)]) reached[static_cast<std::size_t>(t.to)] = true;
    }
  }
  for (const bool r : reached) {
    if (!r) return false;
  }
  return true;
}

constexpr bool no_state_is_a_dead_end() {
  for (const StateRow& row : kStates) {
    if (!every_state_reachable_from(row.state)) return false;
  }
  return true;
}

// A state with motion is entered by a mission only: never by a recovery, a start-up or a release.
constexpr bool only_missions_move() {
  for (const Transition& t : kTransitions) {
    const bool mission = t.event == RobotEvent::kExplore || t.event == RobotEvent::kReturn;
    if (motion_in(t.to) == Motion::kDrive && !mission) return false;
  }
  return true;
}

static_assert(rows_are_in_order());
static_assert(every_pair_is_listed_once());
static_assert(every_state_reachable_from(RobotState::kBoot));
static_assert(no_state_is_a_dead_end());
static_assert(always_stands_after(RobotEvent::kFault));
static_assert(always_stands_after(RobotEvent::kStop));
static_assert(only_missions_move());
static_assert(motion_in(RobotState::kBoot) == Motion::kNone);

}  // namespace supervisor_table

// A short English name, for logs. Never null.
constexpr const char* to_string(RobotState state) {
  return supervisor_table::kStates[static_cast<std::size_t>(state)].name;
}

}  // namespace ivfm
