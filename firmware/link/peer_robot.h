// What the link tells of another robot.
#pragma once

#include "firmware/hal/clock.h"
#include "shared/geometry/pose.h"

namespace ivfm {

struct PeerRobot {
  Point position;      // in the map frame
  TimeUs told_us = 0;  // when it said so, to some 0.1 s: the radio's delay is not known
};

}  // namespace ivfm
