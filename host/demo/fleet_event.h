// What happens to the robots of a demonstration besides exploring, and how it is written.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "firmware/hal/clock.h"

namespace ivfm::host {

struct FleetEvent {
  enum class Kind : std::uint8_t {
    kJoin,   // the robot is switched on only then
    kLeave,  // it stops, hands over its map and ends
    kCrash,  // kill -9
  };
  Kind kind = Kind::kJoin;
  int robot = 0;                     // 1 ..
  TimeUs at_us = 0;                  // of the robots' time, since the first of them run
  std::optional<TimeUs> again_us{};  // when it is started again
};

// Parses ROBOT@TIME, such as 2@30s; for leaving and crashing also ROBOT@TIME+PAUSE, after which the
// robot is started again. Throws std::invalid_argument with a sentence that quotes the text.
FleetEvent parse_fleet_event(FleetEvent::Kind kind, std::string_view text);

}  // namespace ivfm::host
