// The faults a simulated run injects, and how they are written on the command line.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/hal/clock.h"

namespace ivfm::host {

enum class FaultKind : std::uint8_t {
  kLidarSilence,      // the lidar sends nothing
  kLidarGarbage,      // the lidar sends random bytes among its own
  kCanDrop,           // the drives' frames are lost with a probability, both ways
  kDriveFault,        // a drive reports an error and goes to the state Fault
  kDriveSilence,      // the drives fall silent, as after a power cut
  kLeftDriveSilence,  // one of them does
};

struct Fault {
  FaultKind kind;
  int robot = 0;               // 1 ..; 0: every robot
  TimeUs begin_us = 0;         // simulated time since the start
  TimeUs end_us = UINT64_MAX;  // first moment without the fault
  double probability = 0;      // kCanDrop only

  bool is_active(int robot_number, TimeUs now_us) const {
    return (robot == 0 || robot == robot_number) && now_us >= begin_us && now_us < end_us;
  }
};

// Parses one fault: NAME[#ROBOT]@BEGIN[+DURATION] with times such as 12s, 1.5s or 300ms, for
// example `lidar-silence@12s+3s` or `drive-fault#2@20s`; or can-drop[#ROBOT]=PROBABILITY. Without a
// robot every robot has it, without a duration it lasts to the end. Throws std::invalid_argument
// with a sentence that quotes the text and says what is allowed.
Fault parse_fault(std::string_view text);

std::vector<Fault> parse_faults(const std::vector<std::string>& texts);

}  // namespace ivfm::host
