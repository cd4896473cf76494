#include "host/environment/building_worlds.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

#include "host/environment/reachable_area.h"

namespace ivfm::host {
namespace {

class EveryStyle : public testing::TestWithParam<BuildingStyle> {};

TEST_P(EveryStyle, LetsAllRobotsReachEachOtherAndAFairAreaForEverySeed) {
  BuildingConfig config;
  config.style = GetParam();
  config.max_side_um = 16'000'000;
  for (std::uint64_t seed = 0; seed < 15; ++seed) {
    const Scenario scenario = random_building(config, 3, seed);
    ASSERT_EQ(scenario.starts.size(), 3u);
    const GridFrame frame(config.cell_um, extent_of(*scenario.world, config.cell_um));
    const auto reached = reachable_centers(
        *scenario.rays, frame, frame.cell_at(scenario.starts[0].position), config.robot_radius_um);
    for (const Pose& pose : scenario.starts) {
      EXPECT_TRUE(scenario.rays->disc_is_free(pose.position, config.robot_radius_um));
      EXPECT_EQ(reached[frame.index_of(frame.cell_at(pose.position))], 1);
    }
    const auto cells = std::ranges::count(reached, std::uint8_t{1});
    EXPECT_GE(static_cast<double>(cells) * 0.05 * 0.05, 12.0);
  }
}

TEST_P(EveryStyle, IsTheSameForTheSameSeedAndAnotherForAnother) {
  BuildingConfig config;
  config.style = GetParam();
  const Scenario a = random_building(config, 2, 9), b = random_building(config, 2, 9);
  EXPECT_EQ(a.world->occupied, b.world->occupied);
  EXPECT_EQ(a.starts, b.starts);
  EXPECT_NE(a.world->occupied, random_building(config, 2, 10).world->occupied);
}

INSTANTIATE_TEST_SUITE_P(Styles, EveryStyle,
                         testing::Values(BuildingStyle::kRooms, BuildingStyle::kCorridors,
                                         BuildingStyle::kHall, BuildingStyle::kCave,
                                         BuildingStyle::kRing, BuildingStyle::kMixed));

TEST(BuildingWorlds, RefuseMeasuresOutOfRange) {
  BuildingConfig config;
  EXPECT_THROW(random_building(config, 0, 1), std::invalid_argument);
  config.min_side_um = 1'000'000;
  EXPECT_THROW(random_building(config, 1, 1), std::invalid_argument);
  config = {};
  config.cell_um = 0;
  EXPECT_THROW(random_building(config, 1, 1), std::invalid_argument);
}

TEST(ReachableArea, CoversWhatADiscCanSweepAndNoMore) {
  auto world = std::make_shared<World>();
  world->cell_um = 100'000;
  world->width = 10;
  world->height = 3;
  world->occupied.assign(30, 0);
  world->occupied[5] = world->occupied[25] = 1;  // a gap of one cell in column 5
  const RayCaster rays(world);
  const GridFrame frame(100'000, extent_of(*world, 100'000));
  const auto thin = reachable_centers(rays, frame, {1, 1}, 40'000);
  EXPECT_EQ(std::ranges::count(thin, std::uint8_t{1}), 28);
  // A disc as wide as two cells stays on the left of the gap, in the middle row.
  const auto wide = reachable_centers(rays, frame, {1, 1}, 100'000);
  EXPECT_EQ(std::ranges::count(wide, std::uint8_t{1}), 3);  // columns 1 .. 3
  const auto swept = dilated(wide, frame, 100'000);
  // Columns 0 .. 4 of the middle row, 1 .. 3 of the outer rows.
  EXPECT_EQ(std::ranges::count(swept, std::uint8_t{1}), 5 + 3 + 3);
}

}  // namespace
}  // namespace ivfm::host
