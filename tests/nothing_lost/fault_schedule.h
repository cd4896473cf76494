// What goes wrong in one run of a team, and when: drawn from a seed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "firmware/hal/fake/faulty_channel.h"

namespace ivfm::host {

// From the kill to the start: half open, in microseconds of the run.
struct Outage {
  TimeUs begin_us = 0;
  TimeUs end_us = 0;
  bool contains(TimeUs now_us) const { return now_us >= begin_us && now_us < end_us; }
};

struct FaultSchedule {
  struct Robot {
    RadioFaults radio;            // its partitions, one of them a minute long, included
    std::vector<Outage> outages;  // killed, and started again with an empty map
  };
  std::uint32_t seed = 0;
  TimeUs faulty_until_us = 0;
  std::vector<Robot> robots;
  std::vector<Outage> server;
};

struct ScheduleOptions {
  bool kill_robots = true;
  TimeUs length_us = 150'000'000;
};

// 2 to 4 robots; 30 % drop, 10 % duplicates, reordering, corruption, partitions, kills.
FaultSchedule draw_schedule(std::uint32_t seed, const ScheduleOptions& options = {});

}  // namespace ivfm::host
