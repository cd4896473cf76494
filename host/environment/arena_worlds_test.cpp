#include "host/environment/arena_worlds.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <stdexcept>

namespace ivfm::host {
namespace {

class EveryArena : public testing::TestWithParam<ArenaKind> {};

TEST_P(EveryArena, StartsRobotsAndTargetClearOfObstaclesForEverySeed) {
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    const Scenario scenario = random_arena(GetParam(), 4, seed);
    ASSERT_EQ(scenario.starts.size(), 4u);
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_TRUE(scenario.rays->disc_is_free(scenario.starts[i].position, arena::kRobotRadiusUm));
      for (std::size_t j = 0; j < i; ++j) {
        const auto apart =
            squared_distance_um2(scenario.starts[i].position, scenario.starts[j].position);
        EXPECT_GT(apart, 4 * std::int64_t{arena::kRobotRadiusUm} * arena::kRobotRadiusUm);
      }
    }
    ASSERT_TRUE(scenario.target.has_value());
    EXPECT_FALSE(scenario.world->is_occupied(*scenario.target));
    EXPECT_LE(std::abs(scenario.target->x_um), side_um(GetParam()) / 2 - 22'000);
  }
}

TEST_P(EveryArena, IsTheSameForTheSameSeedAndAnotherForAnother) {
  const Scenario a = random_arena(GetParam(), 2, 7), b = random_arena(GetParam(), 2, 7);
  EXPECT_EQ(a.world->occupied, b.world->occupied);
  EXPECT_EQ(a.starts, b.starts);
  EXPECT_EQ(a.target, b.target);
  EXPECT_NE(a.world->occupied, random_arena(GetParam(), 2, 8).world->occupied);
}

INSTANTIATE_TEST_SUITE_P(Arenas, EveryArena,
                         testing::Values(ArenaKind::k1x, ArenaKind::k2x, ArenaKind::kDivider,
                                         ArenaKind::kDividerReleased));

void expect_columns_keep_their_distances(ArenaKind kind, std::size_t most) {
  std::set<std::size_t> counts;
  const std::int32_t limit = side_um(kind) / 2 - arena::kWallGapUm;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    Random random(seed);
    const std::vector<Box> boxes = random_obstacles(kind, random);
    counts.insert(boxes.size());
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      const Box& a = boxes[i];
      EXPECT_EQ(a.x1_um - a.x0_um, 100'000);
      EXPECT_EQ(a.y1_um - a.y0_um, 100'000);
      EXPECT_GE(std::min(a.x0_um, a.y0_um), -limit);
      EXPECT_LE(std::max(a.x1_um, a.y1_um), limit);
      for (std::size_t j = 0; j < i; ++j) {
        const Box& b = boxes[j];
        const bool apart_x = a.x0_um - b.x1_um >= 80'000 || b.x0_um - a.x1_um >= 80'000;
        const bool apart_y = a.y0_um - b.y1_um >= 80'000 || b.y0_um - a.y1_um >= 80'000;
        EXPECT_TRUE(apart_x || apart_y);
      }
    }
  }
  EXPECT_EQ(*counts.begin(), 1u);
  EXPECT_EQ(*counts.rbegin(), most);
}

TEST(ArenaWorlds, HoldOneTo25ColumnsThatKeepTheirDistancesIn1x) {
  expect_columns_keep_their_distances(ArenaKind::k1x, 25);
}

TEST(ArenaWorlds, HoldOneTo50ColumnsThatKeepTheirDistancesIn2x) {
  expect_columns_keep_their_distances(ArenaKind::k2x, 50);
}

TEST(ArenaWorlds, HaveOneStripInTheMiddleOfYForTheDividers) {
  Random random(1);
  const Box paper = random_obstacles(ArenaKind::kDivider, random).front();
  EXPECT_EQ(paper.y0_um, -400'000);
  EXPECT_EQ(paper.y1_um, 400'000);
  EXPECT_EQ(paper.x1_um - paper.x0_um, 50'000);
  const Box released = random_obstacles(ArenaKind::kDividerReleased, random).front();
  EXPECT_EQ(released.y1_um - released.y0_um, 1'800'000);
  EXPECT_EQ(released.x1_um - released.x0_um, 100'000);
}

TEST(ArenaWorlds, MeasureThreeAndFourPointTwoMetres) {
  const auto area_cells = [](ArenaKind kind) {
    return random_arena(kind, 1, 0).world->occupied.size();
  };
  EXPECT_EQ(area_cells(ArenaKind::k1x), 600u * 600u);
  EXPECT_EQ(area_cells(ArenaKind::k2x), 840u * 840u);
}

TEST(ArenaWorlds, AreFoundByNameAndRefuseImpossibleTeams) {
  EXPECT_EQ(arena_from_name("divider-released"), ArenaKind::kDividerReleased);
  EXPECT_EQ(arena_from_name("3x"), std::nullopt);
  EXPECT_EQ(name_of(ArenaKind::k2x), "2x");
  EXPECT_THROW(random_arena(ArenaKind::k1x, 0, 1), std::invalid_argument);
  EXPECT_THROW(random_arena(ArenaKind::k1x, 33, 1), std::invalid_argument);
}

}  // namespace
}  // namespace ivfm::host
