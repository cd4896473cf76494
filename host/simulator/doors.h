// Doors of the simulated world: walls that are there for some of the time.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "firmware/hal/clock.h"
#include "host/environment/world.h"
#include "host/simulator/robot_body.h"

namespace ivfm::host {

// A rectangle that is closed from `close_us` on and open again from `open_us` on, in simulated
// time.
struct Door {
  double x0_m = 0, y0_m = 0, x1_m = 0, y1_m = 0;  // lower left and upper right corner
  TimeUs close_us = 0;
  TimeUs open_us = UINT64_MAX;
};

// Parses X0,Y0,X1,Y1@CLOSES[+LENGTH], for example 3,1,3.1,2@20s+15s: closed for 15 s from the 20th
// second on; without a length for good. Throws std::invalid_argument with a sentence.
Door parse_door(const std::string& text);

class Doors {
 public:
  // Doors open onto the free cells of `world`; throws std::invalid_argument for a door with none.
  Doors(const World& world, const std::vector<Door>& doors);

  // Opens and closes in `world` what is due; a door waits while one of `bodies`, discs of
  // `radius_m`, stands in it. True when the world has changed.
  bool step(TimeUs now_us, World& world, std::span<const TruePose> bodies, double radius_m);

 private:
  struct Leaf {
    Door door;
    std::vector<std::size_t> cells;  // of the world
    bool closed = false;
  };
  std::vector<Leaf> leaves_;
};

}  // namespace ivfm::host
