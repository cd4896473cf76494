#include "host/demo/run_scores.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <fstream>

namespace ivfm::host {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

RobotMap map_of(std::uint16_t robot, const CellRect& window, std::vector<std::uint8_t> visits) {
  RobotMap map{{robot, 1, 50'000, window}, std::move(visits), {}};
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

TEST(MergeRobotMaps, AddsUpVisitsOverTheUnionOfTheWindows) {
  RobotMap a = map_of(1, {0, 0, 2, 1}, {1, 200});
  const RobotMap b = map_of(2, {1, 0, 2, 1}, {100, 3});
  a.obstacles[0] = 1;
  const std::vector<RobotMap> maps{a, b};
  const PictureLayers merged = merge_robot_maps(maps);
  EXPECT_EQ(merged.frame.window(), (CellRect{0, 0, 3, 1}));
  EXPECT_THAT(merged.visits, ElementsAre(1, 255, 3));
  EXPECT_THAT(merged.obstacles, ElementsAre(1, 0, 0));
}

TEST(CoverageMeter, CountsOnlyWhatIsConnectedToTheStart) {
  const CoverageMeter meter(divided(), {25'000, 25'000}, 50'000);
  EXPECT_EQ(meter.explorable_cells(), 12u);
  EXPECT_FALSE(meter.is_explorable({4, 1}));
  EXPECT_FALSE(meter.is_explorable({5, 1}));
  EXPECT_FALSE(meter.is_explorable({-1, 0}));
  const std::vector<RobotMap> maps{map_of(1, {0, 0, 6, 1}, {1, 1, 1, 0, 1, 1})};
  EXPECT_DOUBLE_EQ(meter.share_visited(merge_robot_maps(maps)), 3.0 / 12);
  EXPECT_THROW(CoverageMeter(divided(), {225'000, 25'000}, 50'000), std::invalid_argument);
}

TEST(CoverageMeter, CoarserMapCellsCountByTheirMiddle) {
  const CoverageMeter meter(divided(), {25'000, 25'000}, 100'000);
  // Middles at x 0.05, 0.15, 0.25 and y 0.05 (and 0.15, outside): the third lies past the wall.
  EXPECT_EQ(meter.explorable_cells(), 2u);
}

TEST(ScoreRun, GivesThePapersMetrics) {
  const CoverageMeter meter(divided(), {25'000, 25'000}, 50'000);
  const std::vector<RobotMap> maps{map_of(1, {0, 0, 4, 1}, {1, 3, 1, 0}),
                                   map_of(2, {0, 0, 4, 1}, {0, 1, 0, 1})};
  const RunScores scores = score_run(merge_robot_maps(maps), maps, meter, 0.5);
  EXPECT_DOUBLE_EQ(scores.coverage, 4.0 / 12);
  EXPECT_DOUBLE_EQ(scores.explored_m2, 4 * 0.0025);
  EXPECT_DOUBLE_EQ(scores.repeat_rate, 3.0 / 4);  // counts 1 4 1 1
  EXPECT_DOUBLE_EQ(scores.overlap, 1.0 / 4);
  EXPECT_DOUBLE_EQ(scores.pixels_per_metre, 0.01 * 16384 / 0.5);
}

TEST(ReadRobotMap, SaysWhichFileIsMissingOrDamaged) {
  std::string pattern = (std::filesystem::temp_directory_path() / "ivfm_dump_XXXXXX").string();
  const std::filesystem::path folder = mkdtemp(pattern.data());
  std::ofstream(folder / "bad.map") << "IVFMDUMP and nonsense";
  for (const char* name : {"none.map", "bad.map"}) {
    try {
      read_robot_map(folder / name);
      ADD_FAILURE();
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr(name));
    }
  }
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace ivfm::host
