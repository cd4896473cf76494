#include "host/demo/run_scores.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ivfm::host {
namespace {

using testing::ElementsAre;

LayerMap map_of(const CellRect& bounds, std::vector<std::uint8_t> visits) {
  LayerMap map{50'000, bounds, std::move(visits), {}};
  map.obstacles.assign(map.visits.size(), 0);
  return map;
}

// 6 x 3 cells of 5 cm from the origin; column 4 is a wall, column 5 is free but cut off.
World divided() {
  World world{"divided", 50'000, 6, 3, {}, {}};
  for (int y = 0; y < 3; ++y) {
    for (int x = 0; x < 6; ++x) world.occupied.push_back(x == 4 ? 1 : 0);
  }
  return world;
}

TEST(ToPictureLayers, KeepsPlaceAndValues) {
  LayerMap map = map_of({-1, 2, 2, 1}, {7, 255});
  map.obstacles[0] = 1;
  const PictureLayers layers = to_picture_layers(map);
  EXPECT_EQ(layers.frame.window(), map.bounds);
  EXPECT_EQ(layers.frame.cell_um(), 50'000);
  EXPECT_THAT(layers.visits, ElementsAre(7, 255));
  EXPECT_THAT(layers.obstacles, ElementsAre(1, 0));
}

TEST(CoverageMeter, CountsOnlyWhatIsConnectedToTheStart) {
  const CoverageMeter meter(divided(), {25'000, 25'000}, 50'000);
  EXPECT_EQ(meter.explorable_cells(), 12u);
  EXPECT_FALSE(meter.is_explorable({4, 1}));
  EXPECT_FALSE(meter.is_explorable({5, 1}));
  EXPECT_FALSE(meter.is_explorable({-1, 0}));
  EXPECT_DOUBLE_EQ(meter.share_visited(map_of({0, 0, 6, 1}, {1, 1, 1, 0, 1, 1})), 3.0 / 12);
  EXPECT_DOUBLE_EQ(meter.share_visited({}), 0);
  EXPECT_THROW(CoverageMeter(divided(), {225'000, 25'000}, 50'000), std::invalid_argument);
}

TEST(CoverageMeter, CoarserMapCellsCountByTheirMiddle) {
  const CoverageMeter meter(divided(), {25'000, 25'000}, 100'000);
  // Middles at x 0.05, 0.15, 0.25 and y 0.05 (and 0.15, outside): the third lies past the wall.
  EXPECT_EQ(meter.explorable_cells(), 2u);
}

TEST(CountGhosts, CountsObstaclesWhereNothingIs) {
  World hall{"hall", 50'000, 40, 20, {}, std::vector<std::uint8_t>(800, 0)};
  for (std::size_t y = 0; y < 20; ++y) hall.occupied[y * 40] = 1;
  LayerMap map = map_of({0, 10, 40, 1}, std::vector<std::uint8_t>(40, 1));
  for (const std::size_t x : {0, 1, 5, 7, 20, 39}) map.obstacles[x] = 1;
  EXPECT_EQ(count_ghosts(map, hall), 2u);  // 7 and 20; 39 is at the world's edge
}

TEST(ScoreRun, GivesThePapersMetrics) {
  const CoverageMeter meter(divided(), {25'000, 25'000}, 50'000);
  const std::vector<LayerMap> robots{map_of({0, 0, 4, 1}, {1, 3, 1, 0}),
                                     map_of({0, 0, 4, 1}, {0, 1, 0, 1})};
  const LayerMap merged = map_of({0, 0, 4, 1}, {1, 4, 1, 1});
  const RunScores scores = score_run(merged, robots, meter, 0.5);
  EXPECT_DOUBLE_EQ(scores.coverage, 4.0 / 12);
  EXPECT_DOUBLE_EQ(scores.explored_m2, 4 * 0.0025);
  EXPECT_DOUBLE_EQ(scores.repeat_rate, 3.0 / 4);  // counts 1 4 1 1
  EXPECT_DOUBLE_EQ(scores.overlap, 1.0 / 4);
  EXPECT_DOUBLE_EQ(scores.pixels_per_metre, 0.01 * 16384 / 0.5);
}

}  // namespace
}  // namespace ivfm::host
