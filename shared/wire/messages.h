// The bodies of the small messages (FORMAT.md).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "shared/geometry/grid_frame.h"
#include "shared/geometry/pose.h"
#include "shared/status/status.h"
#include "shared/wire/float16.h"

namespace ivfm {

// Every encode() returns the body's size; kFull: `out` is too small. Every decode_*() answers
// kTruncated when bytes are missing, kCorrupt when there are too many or a field is impossible.

// Which of the other side's datagrams have been taken over: `newest`, and newest - 1 - i for every
// set bit i. Sent by the server once they are durable.
struct Acknowledgement {
  std::uint32_t newest = 0;
  std::uint64_t earlier = 0;
  constexpr bool operator==(const Acknowledgement&) const = default;
  constexpr bool covers(std::uint32_t sequence) const {
    const std::uint32_t age = newest - sequence;
    return age == 0 || (age <= 64 && ((earlier >> (age - 1)) & 1u) != 0);
  }
};
Result<std::size_t> encode(const Acknowledgement& message, std::span<std::uint8_t> out);
Result<Acknowledgement> decode_acknowledgement(std::span<const std::uint8_t> body);

// A robot introduces itself: at every start, whenever its window moves, and when the server does
// not answer any more; until acknowledged.
struct Hello {
  static constexpr std::size_t kMaxName = 24;
  std::int32_t cell_um = 0;  // side of its map's cells, 1 .. 2^24 - 1
  CellRect window;           // of its map, at most 65,535 to a side; empty: all cells
  bool resuming = false;     // since this start a server has welcomed it already
  // In this epoch its cells are in another frame than before: what it said earlier holds no more.
  bool moved_frame = false;
  // Where its map frame lies in the team's is not known: the server keeps its map apart.
  bool apart = false;
  // Its start was told roughly, and it goes on looking for where it really was.
  bool rough = false;
  std::array<char, kMaxName> name_storage{};  // printable ASCII
  std::uint8_t name_size = 0;
  std::string_view name() const { return {name_storage.data(), name_size}; }
  // Keeps at most kMaxName characters; what is not printable ASCII becomes '?'.
  void set_name(std::string_view name);
};
Result<std::size_t> encode(const Hello& message, std::span<std::uint8_t> out);
Result<Hello> decode_hello(std::span<const std::uint8_t> body);

// The server's answer to a hello: proves to the robot that it speaks with the server of now.
struct Welcome {
  std::uint32_t epoch = 0;   // what the robot's datagrams carry from now on
  bool knows_epoch = false;  // the server has heard the robot in its present epoch
  bool has_cells = false;    // the server holds cells of this robot
  constexpr bool operator==(const Welcome&) const = default;
};
Result<std::size_t> encode(const Welcome& message, std::span<std::uint8_t> out);
Result<Welcome> decode_welcome(std::span<const std::uint8_t> body);

// A place in the order in which the server hands a robot its own cells back: by layer, row and
// column of tiles of 32 x 32 cells.
struct RestoreCursor {
  static constexpr std::uint8_t kEnd = 255;
  std::uint8_t layer = 0;  // kEnd: nothing is left
  std::int32_t tile_x = -0x800000;
  std::int32_t tile_y = -0x800000;
  constexpr bool operator==(const RestoreCursor&) const = default;
};
// A robot that has started again asks for its own cells, from `from` on.
struct RestoreRequest {
  CellRect window;  // of its map, as in Hello
  RestoreCursor from;
  constexpr bool operator==(const RestoreRequest&) const = default;
};
Result<std::size_t> encode(const RestoreRequest& message, std::span<std::uint8_t> out);
Result<RestoreRequest> decode_restore_request(std::span<const std::uint8_t> body);
// What stands before the map update (map_update.h) with the cells from `from` to before `next`.
struct RestoreHeader {
  RestoreCursor from, next;
  constexpr bool operator==(const RestoreHeader&) const = default;
};
inline constexpr std::size_t kRestoreHeaderBytes = 14;
Result<std::size_t> encode(const RestoreHeader& message, std::span<std::uint8_t> out);
// Reads the first kRestoreHeaderBytes of `body`; only kTruncated.
Result<RestoreHeader> decode_restore_header(std::span<const std::uint8_t> body);

// What a robot is doing, for people to look at; sent now and then, never acknowledged.
struct RobotStatus {
  PackedPose pose;
  std::uint8_t state = 0;  // the supervisor's state number
  std::uint8_t fault = 0;  // the supervisor's reason, 0: none
  Cell goal;               // 24-bit cell numbers; the robot's own cell when it has none
  std::uint32_t uptime_ms = 0;
  std::uint32_t actions = 0;      // decisions taken
  std::uint32_t distance_mm = 0;  // driven
  std::uint32_t decision_us = 0;  // time of the last decision
  std::uint32_t datagrams_sent = 0;
  std::uint32_t retransmissions = 0;
  constexpr bool operator==(const RobotStatus&) const = default;
};
inline constexpr std::size_t kRobotStatusBytes = 38;
Result<std::size_t> encode(const RobotStatus& message, std::span<std::uint8_t> out);
Result<RobotStatus> decode_robot_status(std::span<const std::uint8_t> body);

// A robot saw the target: until acknowledged.
struct FoundReport {
  PackedPose pose;
  Point target;  // in the map frame
  constexpr bool operator==(const FoundReport&) const = default;
};
inline constexpr std::size_t kFoundReportBytes = 14;
Result<std::size_t> encode(const FoundReport& message, std::span<std::uint8_t> out);
Result<FoundReport> decode_found_report(std::span<const std::uint8_t> body);

// What the server asks of a robot; the one with the highest revision counts, others are old.
enum class CommandCode : std::uint8_t {
  kStart = 1,   // explore
  kStop = 2,    // stand still
  kReturn = 3,  // drive back to the start
  kFound = 4,   // another robot found the target: the search is over
};
struct Command {
  CommandCode code = CommandCode::kStart;
  std::uint32_t revision = 0;
  constexpr bool operator==(const Command&) const = default;
};
inline constexpr std::size_t kCommandBytes = 5;
Result<std::size_t> encode(const Command& message, std::span<std::uint8_t> out);
Result<Command> decode_command(std::span<const std::uint8_t> body);

// Where another robot was.
struct RobotPlace {
  Float16 x = 0, y = 0;       // metres, finite
  std::uint8_t age_10ms = 0;  // when the server sent this, in hundredths of a second
  constexpr bool operator==(const RobotPlace&) const = default;
};
// The nearest of the other robots that have told a place lately; replaces what was told before.
// Sent as often as they tell, never acknowledged.
struct RobotPlaces {
  static constexpr std::size_t kMost = 8;
  std::array<RobotPlace, kMost> storage{};
  std::uint8_t size = 0;
  std::span<const RobotPlace> places() const { return {storage.data(), size}; }
  constexpr bool operator==(const RobotPlaces&) const = default;
};
Result<std::size_t> encode(const RobotPlaces& message, std::span<std::uint8_t> out);
Result<RobotPlaces> decode_robot_places(std::span<const std::uint8_t> body);

// Where the map frame of a robot lies that is apart, or whose start is rough: sent until it says
// that it is so no more.
struct MapFrame {
  std::uint32_t epoch = 0;  // the robot's, for which this holds
  Pose frame;               // T_team_robot's frame
  constexpr bool operator==(const MapFrame&) const = default;
};
inline constexpr std::size_t kMapFrameBytes = 14;
Result<std::size_t> encode(const MapFrame& message, std::span<std::uint8_t> out);
Result<MapFrame> decode_map_frame(std::span<const std::uint8_t> body);

}  // namespace ivfm
