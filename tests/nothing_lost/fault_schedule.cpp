#include "tests/nothing_lost/fault_schedule.h"

namespace ivfm::host {
namespace {

constexpr TimeUs kSecond = 1'000'000;
constexpr TimeUs kLongPartitionUs = 60 * kSecond;

class Draw {
 public:
  explicit Draw(std::uint32_t seed) : random_(seed) {}
  std::uint64_t between(std::uint64_t low, std::uint64_t high) {
    return low + random_() % (high - low + 1);
  }
  // `count` outages of at least `min_us` and at most `max_us`, all over before `limit_us`.
  std::vector<Outage> outages(std::uint64_t count, TimeUs min_us, TimeUs max_us, TimeUs limit_us) {
    std::vector<Outage> out;
    for (; count > 0; --count) {
      const TimeUs length_us = between(min_us, max_us);
      const TimeUs begin_us = between(1, limit_us - length_us);
      out.push_back({begin_us, begin_us + length_us});
    }
    return out;
  }

 private:
  std::mt19937_64 random_;
};

}  // namespace

FaultSchedule draw_schedule(std::uint32_t seed, const ScheduleOptions& options) {
  Draw draw(seed);
  FaultSchedule schedule{seed, options.length_us, {}, {}};
  schedule.robots.resize(draw.between(2, 4));
  const TimeUs end_us = options.length_us;
  schedule.server = draw.outages(draw.between(1, 4), kSecond / 10, 20 * kSecond, end_us);
  for (FaultSchedule::Robot& robot : schedule.robots) {
    robot.radio = {.drop = 0.3,
                   .duplicate = 0.1,
                   .reorder = 0.1,
                   .corrupt = 0.03,
                   .truncate = 0.01,
                   .delay_us = draw.between(0, 100'000),
                   .jitter_us = draw.between(0, 900'000)};
    auto partitions = draw.outages(draw.between(0, 3), kSecond, 10 * kSecond, end_us);
    for (const Outage& minute : draw.outages(1, kLongPartitionUs, kLongPartitionUs, end_us)) {
      partitions.push_back(minute);
    }
    for (const Outage& o : partitions) robot.radio.partitions.push_back({o.begin_us, o.end_us});
    if (options.kill_robots) {
      robot.outages = draw.outages(draw.between(0, 2), kSecond / 10, 20 * kSecond, end_us);
    }
  }
  return schedule;
}

}  // namespace ivfm::host
