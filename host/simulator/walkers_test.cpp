#include "host/simulator/walkers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace ivfm::host {
namespace {

// 6 m x 6 m around the origin.
World room() {
  World world{"room", 50'000, 120, 120, {-3'000'000, -3'000'000}, {}};
  world.occupied.assign(120 * 120, 0);
  for (std::size_t i = 0; i < 120; ++i) {
    for (const std::size_t edge : {0u, 119u}) {
      world.occupied[edge * 120 + i] = world.occupied[i * 120 + edge] = 1;
    }
  }
  return world;
}

TEST(Walkers, KeepMovingAndAwayFromWallsAndRobots) {
  const World world = room();
  const TruePose robots[] = {{0, 0, 0}};
  Walkers walkers(world, robots, 3, 7);
  ASSERT_EQ(walkers.legs().size(), 6u);
  const std::vector<TruePose> first = walkers.legs();
  double walked_m = 0, nearest_m = 10;
  for (int i = 0; i < 12'000; ++i) {  // a minute
    const TruePose before = walkers.legs()[0];
    walkers.step(0.005, world, robots);
    walked_m += std::hypot(walkers.legs()[0].x_m - before.x_m, walkers.legs()[0].y_m - before.y_m);
    for (const TruePose& leg : walkers.legs()) {
      ASSERT_FALSE(disc_touches_obstacle(world, leg.x_m, leg.y_m, 0.105));
      nearest_m = std::min(nearest_m, std::hypot(leg.x_m, leg.y_m));
    }
  }
  EXPECT_GT(walked_m, 20);
  EXPECT_GT(nearest_m, 0.5);
  Walkers again(world, robots, 3, 7);
  EXPECT_EQ(again.legs()[5].x_m, first[5].x_m);
}

TEST(Walkers, NeedRoom) {
  const World world = room();
  const TruePose robots[] = {{0, 0, 0},   {2, 2, 0},    {2, -2, 0},  {-2, 2, 0},  {-2, -2, 0},
                             {2.6, 0, 0}, {-2.6, 0, 0}, {0, 2.6, 0}, {0, -2.6, 0}};
  EXPECT_THROW(Walkers(world, robots, 1, 1), std::invalid_argument);
  EXPECT_TRUE(Walkers(world, robots, 0, 1).legs().empty());
}

}  // namespace
}  // namespace ivfm::host
