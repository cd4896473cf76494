#include "firmware/mapping/exploration_map.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace ivfm {
namespace {

constexpr std::int32_t kCellUm = 50'000;

class ExplorationMapTest : public ::testing::Test {
 protected:
  ExplorationMapTest() { map_.clear({0, 0}); }
  std::unique_ptr<MapStorage<32>> storage_ = std::make_unique<MapStorage<32>>();
  ExplorationMap map_{storage_->layers(), kCellUm, 32, 105'000};
};

TEST_F(ExplorationMapTest, OneHitMakesAnObstacleAndManyMissesForgetIt) {
  map_.add_evidence({3, 4}, occupancy::kMiss);
  EXPECT_FALSE(map_.is_obstacle({3, 4}));
  EXPECT_TRUE(map_.is_known_free({3, 4}));
  map_.add_evidence({3, 4}, occupancy::kHit);
  EXPECT_TRUE(map_.is_obstacle({3, 4}));
  for (int i = 0; i < 7; ++i) map_.add_evidence({3, 4}, occupancy::kMiss);
  EXPECT_FALSE(map_.is_obstacle({3, 4}));
}

TEST_F(ExplorationMapTest, ObstaclesAreInflatedByTheRobotsDisc) {
  map_.add_evidence({0, 0}, occupancy::kHit);
  // Radius 0.105 m over cells of 0.05 m: centres up to 2.1 cells away.
  const char* const drawn[] = {
      "..#..",  //
      ".###.",  //
      "#####",  //
      ".###.",  //
      "..#..",
  };
  for (int y = -2; y <= 2; ++y) {
    for (int x = -2; x <= 2; ++x) {
      EXPECT_EQ(map_.is_blocked({x, y}), drawn[y + 2][x + 2] == '#') << x << ", " << y;
    }
  }
  map_.add_evidence({0, 0}, -8);
  EXPECT_FALSE(map_.is_blocked({1, 0}));
}

TEST_F(ExplorationMapTest, WhatItHasSeenMovesToAnotherFrameAndWhatOthersToldStays) {
  for (std::int32_t i = -6; i <= 6; ++i) {
    map_.add_evidence({i, 3}, occupancy::kMax);  // a wall
    for (int n = 0; n < 4; ++n) map_.add_evidence({i, 0}, occupancy::kMiss);
    map_.count_visit({i, 1});
  }
  const std::vector<std::uint8_t> told{1};
  ASSERT_EQ(map_.write_peers(Layer::kObstacles, {2, 0, 1, 1}, told), Status::kOk);
  EXPECT_FALSE(map_.is_obstacle({2, 0})) << "surely free by this robot's own eyes";
  (void)map_.take_changes(Layer::kVisits);
  // A quarter turn, then 0.1 m east: (x, y) comes to (-y, x) + (0.1 m, 0).
  map_.re_express({{100'000, 0}, BinaryAngle::from_degrees(90)});
  int obstacles = 0, visits = 0;
  for (std::int32_t y = -16; y < 16; ++y) {
    for (std::int32_t x = -16; x < 16; ++x) {
      std::uint8_t own = 0;
      ASSERT_EQ(map_.read_own(Layer::kObstacles, {x, y, 1, 1}, {&own, 1}), Status::kOk);
      obstacles += own;
      visits += static_cast<int>(map_.visits({x, y}));
      EXPECT_EQ(map_.is_blocked({x, y}), map_.obstacle_within({x, y}, 105'000)) << x << ' ' << y;
    }
  }
  EXPECT_EQ(obstacles, 13);
  EXPECT_EQ(visits, 13);
  EXPECT_TRUE(map_.is_obstacle({-2, 0}));  // the wall's middle (25 mm, 175 mm) is at (-75, 25) mm
  EXPECT_TRUE(map_.is_seen({0, 5}));
  EXPECT_TRUE(map_.is_known_free({1, -3}));
  EXPECT_TRUE(map_.is_obstacle({2, 0})) << "not seen by itself any more";
  EXPECT_TRUE(map_.take_changes(Layer::kVisits).contains({0, 5, 1, 1}));
}

TEST_F(ExplorationMapTest, TheWindowGoesAlongWithAFrameThatMovesFar) {
  for (std::int32_t i = -6; i <= 6; ++i) {
    map_.add_evidence({i, 3}, occupancy::kMax);
    map_.count_visit({i, 1});
  }
  // A quarter turn, then 50.1 m west: (x, y) comes to (-y, x) - (50.1 m, 0).
  map_.re_express_alone({{-50'100'000, 0}, BinaryAngle::from_degrees(90)});
  const CellRect& window = map_.frame().window();
  int obstacles = 0, visits = 0;
  for (std::int32_t y = window.y; y < window.top(); ++y) {
    for (std::int32_t x = window.x; x < window.right(); ++x) {
      obstacles += map_.is_obstacle({x, y}) ? 1 : 0;
      visits += static_cast<int>(map_.visits({x, y}));
    }
  }
  EXPECT_EQ(obstacles, 13);
  EXPECT_EQ(visits, 13);
  EXPECT_TRUE(map_.is_obstacle({-1006, 0}));  // from (25 mm, 175 mm)
  EXPECT_EQ(map_.visits({-1004, -6}), 1u);    // from (-275 mm, 75 mm)
}

TEST_F(ExplorationMapTest, VisitsOfAllRobotsAddUpAndSaturate) {
  map_.count_visit({1, 1});
  const std::vector<std::uint8_t> peers{254};
  ASSERT_TRUE(ok(map_.write_peers(Layer::kVisits, {1, 1, 1, 1}, peers)));
  EXPECT_EQ(map_.visits({1, 1}), 255u);
  map_.count_visit({1, 1});
  EXPECT_EQ(map_.visits({1, 1}), 255u);
  EXPECT_EQ(map_.visits({500, 500}), 0u) << "outside the window";
}

TEST_F(ExplorationMapTest, AnObstacleStaysWhileAnyRobotSaysSo) {
  map_.add_evidence({2, 2}, occupancy::kHit);
  ASSERT_TRUE(ok(map_.write_peers(Layer::kObstacles, {2, 2, 1, 1}, std::vector<std::uint8_t>{1})));
  map_.add_evidence({2, 2}, -8);
  EXPECT_TRUE(map_.is_obstacle({2, 2}));
  ASSERT_TRUE(ok(map_.write_peers(Layer::kObstacles, {2, 2, 1, 1}, std::vector<std::uint8_t>{0})));
  EXPECT_FALSE(map_.is_obstacle({2, 2}));
  EXPECT_FALSE(map_.is_blocked({2, 2}));
}

// Another robot takes this one for an obstacle, or saw a third one that has left.
TEST_F(ExplorationMapTest, WhatOthersSayIsNoObstacleWhereTheRobotHasSeenFreeGround) {
  const std::vector<std::uint8_t> obstacle{1};
  ASSERT_TRUE(ok(map_.write_peers(Layer::kObstacles, {2, 2, 1, 1}, obstacle)));
  for (int scan = 0; scan < 3; ++scan) map_.add_misses_on_line({2, 2}, {3, 2});
  EXPECT_TRUE(map_.is_obstacle({2, 2})) << "three glances are not enough";
  map_.add_misses_on_line({2, 2}, {3, 2});
  EXPECT_FALSE(map_.is_obstacle({2, 2}));
  EXPECT_FALSE(map_.is_blocked({2, 2}));
  ASSERT_TRUE(ok(map_.write_peers(Layer::kObstacles, {2, 2, 1, 1}, obstacle)));
  EXPECT_FALSE(map_.is_obstacle({2, 2})) << "nor when they say so again";
  map_.add_evidence({2, 2}, occupancy::kHit);
  EXPECT_TRUE(map_.is_obstacle({2, 2})) << "but its own eyes";
}

TEST_F(ExplorationMapTest, ChangesAreTheBoundingRectangleOfOwnCellsOnly) {
  map_.count_visit({-3, 2});
  map_.count_visit({4, -1});
  ASSERT_TRUE(ok(map_.write_peers(Layer::kVisits, {9, 9, 1, 1}, std::vector<std::uint8_t>{3})));
  EXPECT_EQ(map_.take_changes(Layer::kVisits), (CellRect{-3, -1, 8, 4}));
  EXPECT_TRUE(map_.take_changes(Layer::kVisits).empty());
  EXPECT_TRUE(map_.take_changes(Layer::kObstacles).empty());
}

TEST_F(ExplorationMapTest, ReadsOwnLayersRowByRow) {
  map_.count_visit({0, 0});
  map_.count_visit({1, 1});
  map_.count_visit({1, 1});
  std::vector<std::uint8_t> cells(4);
  ASSERT_TRUE(ok(map_.read_own(Layer::kVisits, {0, 0, 2, 2}, cells)));
  EXPECT_EQ(cells, (std::vector<std::uint8_t>{1, 0, 0, 2}));
  EXPECT_EQ(map_.read_own(Layer::kVisits, {0, 0, 2, 3}, cells), Status::kInvalidArgument);
  EXPECT_EQ(map_.read_own(Layer::kVisits, {15, 15, 2, 2}, cells), Status::kOutOfRange);
}

TEST_F(ExplorationMapTest, RollingKeepsWhatStaysInTheWindow) {
  map_.count_visit({10, 3});
  map_.count_visit({-16, -16});
  map_.add_evidence({12, 0}, occupancy::kHit);
  EXPECT_FALSE(map_.roll_to({5, 0})) << "still far from the edge";
  EXPECT_TRUE(map_.roll_to({9, 0}));
  EXPECT_EQ(map_.frame().window(), (CellRect{-7, -16, 32, 32}));
  EXPECT_EQ(map_.visits({10, 3}), 1u);
  EXPECT_TRUE(map_.is_obstacle({12, 0}));
  EXPECT_TRUE(map_.is_blocked({13, 1}));
  EXPECT_EQ(map_.visits({20, 3}), 0u) << "what enters is empty";
  EXPECT_TRUE(map_.roll_to({-7, 0}));
  EXPECT_EQ(map_.visits({-16, -16}), 0u) << "what left is forgotten";
}

TEST_F(ExplorationMapTest, RollsDiagonallyWithoutSmearing) {
  for (int i = -8; i < 16; ++i) map_.count_visit({i, i});
  ASSERT_TRUE(map_.roll_to({12, 12}));
  for (int y = -4; y < 28; ++y) {
    for (int x = -4; x < 28; ++x) EXPECT_EQ(map_.visits({x, y}), x == y && x < 16 ? 1u : 0u);
  }
}

}  // namespace
}  // namespace ivfm
