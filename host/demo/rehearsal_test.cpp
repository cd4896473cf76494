#include "host/demo/rehearsal.h"

#include <gtest/gtest.h>

#include "host/cli/shipped_model.h"
#include "host/quantizer/robot_model.h"

namespace ivfm::host {
namespace {

// Two robots with noise and drift in the corridor until they have seen a tenth of it.
RehearsalOptions short_run() {
  RehearsalOptions options;
  options.world.random_starts = true;
  options.odometry = OdometryNoise::preset("turtlebot");
  options.lidar = LidarModel::preset("mild");
  options.model = read_model_file(shipped_model(".ivfm"));
  options.agent.goals = GoalsChoice::kNetwork;
  options.agent.visit_range_m = 1.2;
  options.agent.visit_fov_deg = 150;
  options.until = 0.1;
  return options;
}

TEST(Rehearsal, IsTheSameEachTime) {
  const RehearsalResult first = rehearse(short_run()), second = rehearse(short_run());
  EXPECT_TRUE(first.goal_reached);
  EXPECT_EQ(first.collisions, 0);
  EXPECT_GE(first.actions, 3u);
  EXPECT_GT(first.driven_m, 1);
  EXPECT_LT(first.largest_error_m, 0.3);
  EXPECT_EQ(first.actions, second.actions);
  EXPECT_EQ(first.driven_m, second.driven_m);
  EXPECT_EQ(first.scores.repeat_rate, second.scores.repeat_rate);
  EXPECT_EQ(first.simulated_s, second.simulated_s);
}

TEST(Rehearsal, GivesUpWhenTimeIsOver) {
  RehearsalOptions options = short_run();
  options.time_limit_s = 8;
  options.until = 1;
  const RehearsalResult result = rehearse(options);
  EXPECT_FALSE(result.goal_reached);
  EXPECT_DOUBLE_EQ(result.simulated_s, 8);
}

}  // namespace
}  // namespace ivfm::host
