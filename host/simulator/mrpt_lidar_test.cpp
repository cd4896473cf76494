#include "host/simulator/mrpt_lidar.h"

#include <gtest/gtest.h>

#include <cmath>

namespace ivfm::host {
namespace {

// A square room of 20 m x 20 m around the origin with walls at its edges: inner faces at +-9.9 m.
World room() {
  World world{
      "room", 50'000, 400, 400, {-10'000'000, -10'000'000}, std::vector<std::uint8_t>(160'000, 0)};
  for (int i = 0; i < 400; ++i) {
    for (const int edge : {0, 1, 398, 399}) {
      world.occupied[static_cast<std::size_t>(edge * 400 + i)] = 1;
      world.occupied[static_cast<std::size_t>(i * 400 + edge)] = 1;
    }
  }
  return world;
}

TEST(MrptLidar, MeasuresTheDistanceToWallsInTheRobotsFrame) {
  const MrptLidar lidar(room(), LidarModel::preset("none"), 1);
  const TruePose robot{2, -1, M_PI / 2};
  EXPECT_NEAR(lidar.true_range_m(robot, 0, {}, 0), 10.9, 0.03);         // ahead is +y
  EXPECT_NEAR(lidar.true_range_m(robot, M_PI / 2, {}, 0), 11.9, 0.03);  // left is -x
  EXPECT_NEAR(lidar.true_range_m(robot, -M_PI / 2, {}, 0), 7.9, 0.03);  // right is +x
  EXPECT_NEAR(lidar.true_range_m(robot, -M_PI / 4, {}, 0), 7.9 * M_SQRT2, 0.03);
}

TEST(MrptLidar, SaysNothingBelowItsSmallestAndBeyondItsLargestRange) {
  MrptLidar lidar(room(), LidarModel::preset("none"), 1);
  EXPECT_EQ(lidar.measure({-5, 0, 0}, 0, {}, 0).range_mm, 0);  // 14.9 m
  EXPECT_EQ(lidar.measure({-5, 0, 0}, 0, {}, 0).quality, 0);
  EXPECT_EQ(lidar.measure({9.8, 0, 0}, 0, {}, 0).range_mm, 0);  // 0.1 m
  EXPECT_GT(lidar.measure({9.7, 0, 0}, 0, {}, 0).range_mm, 0);  // 0.2 m
}

TEST(MrptLidar, NoiseHasTheStatedSpreadAndNoBias) {
  LidarModel model;
  MrptLidar lidar(room(), model, 3);
  const TruePose robot{1.9, 0, 0};  // 8 m
  const double truth = lidar.true_range_m(robot, 0, {}, 0) * 1000;
  double sum = 0, sum_squares = 0;
  int measured = 0, dropped = 0;
  for (int i = 0; i < 20'000; ++i) {
    const LidarSample sample = lidar.measure(robot, 0, {}, 0);
    if (sample.range_mm == 0) {
      ++dropped;
      continue;
    }
    const double error = sample.range_mm - truth;
    sum += error;
    sum_squares += error * error;
    ++measured;
  }
  const double sigma = 1000 * (model.noise_m + 8 * model.noise_share);  // 34 mm
  EXPECT_NEAR(sum / measured, 0, 4 * sigma / std::sqrt(measured));
  EXPECT_NEAR(std::sqrt(sum_squares / measured), sigma, 0.03 * sigma);
  EXPECT_NEAR(dropped / 20'000.0, model.dropout, 0.0025);
}

TEST(MrptLidar, SameSeedSameSamples) {
  const auto ranges = [](std::uint64_t seed) {
    MrptLidar lidar(room(), {}, seed);
    std::vector<int> out;
    for (int i = 0; i < 50; ++i) out.push_back(lidar.measure({}, i * 0.1, {}, 0).range_mm);
    return out;
  };
  EXPECT_EQ(ranges(4), ranges(4));
  EXPECT_NE(ranges(4), ranges(5));
}

TEST(MrptLidar, SeesOtherRobotsAsDiscs) {
  const MrptLidar lidar(room(), LidarModel::preset("none"), 1);
  const TruePose other{3, 0, 0};
  EXPECT_NEAR(lidar.true_range_m({}, 0, {&other, 1}, 0.105), 2.895, 1e-9);
  EXPECT_GT(lidar.true_range_m({}, 0.05, {&other, 1}, 0.105), 9);  // 0.15 m aside
}

}  // namespace
}  // namespace ivfm::host
