// The short version of `make soak`.
#include <gtest/gtest.h>

#include "tests/nothing_lost/simulated_team.h"

namespace ivfm::host {
namespace {

TEST(NothingLost, WhateverTheRadioDoesAndWhoeverIsKilled) {
  ScheduleReport sum;
  for (std::uint32_t seed = 1; seed <= 40; ++seed) {
    const ScheduleReport report = SimulatedTeam(draw_schedule(seed, {.kill_robots = true})).run();
    ASSERT_EQ(report.failure, "");
    EXPECT_GT(report.cells_checked, 0u) << seed;
    sum.radio += report.radio;
    sum.server_kills += report.server_kills;
    sum.robot_kills += report.robot_kills;
  }
  // The schedules are what they say they are.
  EXPECT_GT(sum.radio.lost, sum.radio.sent / 4);
  EXPECT_GT(sum.radio.duplicated, sum.radio.sent / 20);
  EXPECT_GT(sum.radio.spoiled, 0u);
  EXPECT_GT(sum.server_kills, 60u);
  EXPECT_GT(sum.robot_kills, 60u);
}

// The test itself must notice a loss: a server that forgets its database.
TEST(NothingLost, ALossIsNoticed) {
  const ScheduleReport report =
      SimulatedTeam(draw_schedule(1), SimulatedTeam::Sabotage::kServersForget).run();
  EXPECT_NE(report.failure.find("acknowledged to robot"), std::string::npos) << report.failure;
}

TEST(FaultSchedule, HasAMinuteOfPartitionForEveryRobotAndIsTheSameForASeed) {
  for (std::uint32_t seed = 1; seed <= 20; ++seed) {
    const FaultSchedule schedule = draw_schedule(seed), again = draw_schedule(seed);
    ASSERT_GE(schedule.robots.size(), 2u);
    ASSERT_FALSE(schedule.server.empty());
    for (std::size_t i = 0; i < schedule.robots.size(); ++i) {
      const auto& minute = schedule.robots[i].radio.partitions.back();
      EXPECT_EQ(minute.end_us - minute.begin_us, 60'000'000u);
      EXPECT_LE(minute.end_us, schedule.faulty_until_us);
      EXPECT_EQ(minute.begin_us, again.robots[i].radio.partitions.back().begin_us);
    }
  }
}

}  // namespace
}  // namespace ivfm::host
