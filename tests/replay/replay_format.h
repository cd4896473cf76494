// Constants and settings of a replay file (FORMAT.md): what the player and the recorder agree on.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "firmware/agent/agent.h"

namespace ivfm::replay {

inline constexpr std::array<std::uint8_t, 8> kMagic = {'I', 'V', 'F', 'M', 'R', 'P', 'L', 'Y'};
inline constexpr std::uint16_t kVersion = 2;
inline constexpr std::size_t kMaxBlockBytes = 512;
inline constexpr std::size_t kBlockHeadBytes = 6;

// What was recorded.
enum class Subject : std::uint8_t {
  kAgent = 1,     // the agent's ports, step by step
  kExplorer = 2,  // the explorer's calls, without ports
};

enum class ProfileId : std::uint8_t { kPaper = 0, kRobot = 1, kMcu = 2 };

// Limits of one step; a recorder leaves what is beyond them for the next step.
inline constexpr std::size_t kMaxSerialBytes = 1024;
inline constexpr std::size_t kMaxCanFrames = 32;
inline constexpr std::size_t kMaxDatagramBytes =
    2048;                                     // all datagrams of a step, 2 bytes more each
inline constexpr std::size_t kCanSlots = 16;  // identifiers that are remembered

// Bits of a step's first byte.
namespace step_part {
inline constexpr std::uint8_t kSerial = 1;
inline constexpr std::uint8_t kCan = 2;
inline constexpr std::uint8_t kDatagrams = 4;
inline constexpr std::uint8_t kStatuses = 8;
inline constexpr std::uint8_t kAll = 15;
}  // namespace step_part

// The first byte of a CAN frame: a slot, or a slot and a new identifier for it.
inline constexpr std::uint8_t kNewSlot = 0x80;
inline constexpr std::uint8_t kRemoteFlag = 0x80;  // in the byte with a new slot's size

// Calls of the explorer.
enum class Call : std::uint8_t { kStart = 1, kBeginAction, kFuse, kDecide, kAbandonGoal };

// Visits the members of `config` that a replay file holds, in their order there.
template <typename Config, typename Visitor>
void for_each_setting(Config& config, Visitor&& visit) {
  auto& explorer = config.explorer;
  visit(explorer.fusion.footprint.kind);
  visit(explorer.fusion.footprint.near_um);
  visit(explorer.fusion.footprint.far_um);
  visit(explorer.fusion.footprint.half_angle);
  visit(explorer.fusion.footprint.slope_q16);
  visit(explorer.fusion.footprint.offset_um);
  visit(explorer.fusion.mapping_range_um);
  visit(explorer.fusion.doubt_changes);
  visit(explorer.paths.unknown_is_traversable);
  visit(explorer.robot_radius_um);
  visit(explorer.pool);
  visit(explorer.paths.tight_radius_um);
  visit(explorer.min_local_frontier);
  visit(explorer.view_reach_um);
  visit(explorer.min_frontier_size);
  visit(explorer.wide_frontier_size);
  visit(explorer.min_goal_distance_um);
  visit(explorer.return_to_start);
  visit(explorer.rolling_window);
  visit(config.wheels.geometry.track_um);
  visit(config.wheels.geometry.wheel_circumference_um);
  visit(config.wheels.geometry.counts_per_turn);
  visit(config.wheels.max_wheel_um_s);
  visit(config.wheels.drive.acceleration);
  visit(config.wheels.drive.deceleration);
  visit(config.wheels.drive.quick_stop_deceleration);
  visit(config.follower.max_speed_um_s);
  visit(config.follower.max_turn_mrad_s);
  visit(config.supervisor.robot_radius_um);
  visit(config.supervisor.max_speed_um_s);
  visit(config.supervisor.max_turn_mrad_s);
  visit(config.supervisor.braking_um_s2);
  visit(config.link.robot);
  visit(config.link.epoch);
  visit(config.start.position.x_um);
  visit(config.start.position.y_um);
  visit(config.start.heading);
  visit(config.max_action_travel_um);
  visit(config.localization.matching);
}

// A setting as the file holds it, and back.
template <typename T>
constexpr std::int32_t to_stored(const T& value) {
  if constexpr (std::is_same_v<T, BinaryAngle>) {
    return value.raw();
  } else {
    return static_cast<std::int32_t>(value);
  }
}
template <typename T>
constexpr void from_stored(std::int32_t stored, T& value) {
  if constexpr (std::is_same_v<T, BinaryAngle>) {
    value = BinaryAngle(static_cast<std::uint16_t>(stored));
  } else if constexpr (std::is_same_v<T, bool>) {
    value = stored != 0;
  } else {
    value = static_cast<T>(stored);
  }
}

// What stands before the records.
struct Header {
  Subject subject = Subject::kAgent;
  ProfileId profile = ProfileId::kMcu;
  AgentConfig config;  // the explorer's part counts for both subjects
};

}  // namespace ivfm::replay
