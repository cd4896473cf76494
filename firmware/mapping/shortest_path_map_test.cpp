#include "firmware/mapping/shortest_path_map.h"

#include <gtest/gtest.h>

#include <memory>
#include <random>
#include <string>
#include <vector>

namespace ivfm {
namespace {

constexpr std::int32_t kCellUm = 50'000;

// A map drawn from its top row down: '#' obstacle, anything else unknown. (0, 0) is the lower left.
template <std::size_t kCapacity = 64>
struct Drawn {
  explicit Drawn(const std::vector<std::string>& rows, PathConfig config = {},
                 std::int32_t radius_um = 1'000)
      : map(storage->layers(), kCellUm, 64, radius_um), paths(config, buckets->entries) {
    const auto height = static_cast<std::int32_t>(rows.size());
    for (std::int32_t y = 0; y < height; ++y) {
      const std::string& row = rows[static_cast<std::size_t>(height - 1 - y)];
      region = region.united(CellRect{0, y, static_cast<std::int32_t>(row.size()), 1});
      for (std::int32_t x = 0; x < static_cast<std::int32_t>(row.size()); ++x) {
        const char drawn = row[static_cast<std::size_t>(x)];
        if (drawn == '#') map.add_evidence({x, y}, occupancy::kHit);
        if (drawn == '.') map.add_evidence({x, y}, occupancy::kMiss);
      }
    }
  }
  std::unique_ptr<MapStorage<64>> storage = std::make_unique<MapStorage<64>>();
  std::unique_ptr<BucketStorage<kCapacity>> buckets = std::make_unique<BucketStorage<kCapacity>>();
  ExplorationMap map;
  ShortestPathMap paths;
  CellRect region{};
};

TEST(ShortestPathMap, StraightStepsCost12AndDiagonalOnes17) {
  Drawn world({".....", ".....", "....."});
  world.paths.compute(world.map, {0, 0}, world.region);
  EXPECT_EQ(world.paths.cost_at(world.map, {0, 0}), 0);
  EXPECT_EQ(world.paths.cost_at(world.map, {4, 0}), 48);
  EXPECT_EQ(world.paths.cost_at(world.map, {2, 2}), 34);
  EXPECT_EQ(world.paths.cost_at(world.map, {4, 1}), 36 + 17);
  EXPECT_EQ(world.paths.cost_at(world.map, {5, 0}), path::kUnreachable) << "outside the region";
}

TEST(ShortestPathMap, WalksAroundWallsAndNotThroughThem) {
  Drawn world({".#...",  //
               ".#.#.",  //
               "...#."});
  world.paths.compute(world.map, {0, 2}, world.region);
  EXPECT_EQ(world.paths.cost_at(world.map, {1, 2}), path::kUnreachable);
  // Down 2 with one diagonal around the wall's foot, up and over the second wall, down again.
  EXPECT_EQ(world.paths.cost_at(world.map, {2, 1}), 12 + 17 + 17);
  EXPECT_EQ(world.paths.cost_at(world.map, {4, 0}), 12 + 17 + 17 + 17 + 17 + 12);
}

TEST(ShortestPathMap, AClosedRoomIsOutOfReach) {
  Drawn world({".....", ".###.", ".#.#.", ".###.", "....."});
  world.paths.compute(world.map, {0, 0}, world.region);
  EXPECT_EQ(world.paths.cost_at(world.map, {2, 2}), path::kUnreachable);
}

TEST(ShortestPathMap, UnknownGroundIsTraversableOnlyWhenConfigured) {
  const std::vector<std::string> rows{"..  .."};
  Drawn bold(rows, {.unknown_is_traversable = true});
  bold.paths.compute(bold.map, {0, 0}, bold.region);
  EXPECT_EQ(bold.paths.cost_at(bold.map, {5, 0}), 60);
  Drawn careful(rows, {.unknown_is_traversable = false});
  careful.paths.compute(careful.map, {0, 0}, careful.region);
  EXPECT_EQ(careful.paths.cost_at(careful.map, {1, 0}), 12);
  EXPECT_EQ(careful.paths.cost_at(careful.map, {5, 0}), path::kUnreachable);
}

TEST(ShortestPathMap, ARobotTooCloseToAWallMayDriveOff) {
  Drawn world({"........", "........", "........", "########"}, {}, 105'000);
  world.paths.compute(world.map, {4, 1}, world.region);
  EXPECT_NE(world.paths.cost_at(world.map, {4, 3}), path::kUnreachable);
  EXPECT_EQ(world.paths.cost_at(world.map, {0, 1}), path::kUnreachable) << "not along the wall";
}

TEST(ShortestPathMap, OnlyTightClearanceSqueezesThroughANarrowGap) {
  // A gap of three cells; the inflation by 0.105 m closes it, a robot of 0.06 m fits.
  Drawn world({"....#....",  //
               "....#....",  //
               ".........",  //
               ".........",  //
               ".........",  //
               "....#....",  //
               "....#...."},
              {.unknown_is_traversable = false, .tight_radius_um = 60'000}, 105'000);
  world.paths.compute(world.map, {0, 3}, world.region);
  EXPECT_EQ(world.paths.cost_at(world.map, {8, 3}), path::kUnreachable);
  world.paths.compute(world.map, {0, 3}, world.region, Clearance::kTight);
  EXPECT_EQ(world.paths.cost_at(world.map, {8, 3}), 8 * 12);
  EXPECT_EQ(world.paths.cost_at(world.map, {4, 2}), path::kUnreachable) << "next to the wall";
}

TEST(ShortestPathMap, OnlyEscapingGoesHalfACellNearerToObstacles) {
  // A gap of one cell: its obstacles' middles are one cell away, nearer than 0.06 m, but not nearer
  // than 0.035 m.
  Drawn world({"....#....",  //
               ".........",  //
               "....#...."},
              {.unknown_is_traversable = false, .tight_radius_um = 60'000}, 105'000);
  world.paths.compute(world.map, {0, 1}, world.region, Clearance::kTight);
  EXPECT_EQ(world.paths.cost_at(world.map, {8, 1}), path::kUnreachable);
  world.paths.compute(world.map, {0, 1}, world.region, Clearance::kEscape);
  EXPECT_EQ(world.paths.cost_at(world.map, {8, 1}), 8 * 12);
}

TEST(ShortestPathMap, AQueueThatOverflowsStillFindsEveryCost) {
  std::vector<std::string> rows(60, std::string(60, '.'));
  for (std::size_t i = 0; i < 50; ++i) rows[20][i] = rows[40][59 - i] = '#';
  Drawn<2> tiny(rows);
  Drawn<512> roomy(rows);
  tiny.paths.compute(tiny.map, {5, 5}, {0, 0, 31, 31});
  roomy.paths.compute(roomy.map, {5, 5}, {0, 0, 31, 31});
  for (std::int32_t y = 0; y < 31; ++y) {
    for (std::int32_t x = 0; x < 31; ++x) {
      ASSERT_EQ(tiny.paths.cost_at(tiny.map, {x, y}), roomy.paths.cost_at(roomy.map, {x, y}));
    }
  }
}

// Costs over the cells that can be stood on, by relaxing all steps until nothing changes.
std::vector<std::uint16_t> relaxed_costs(const Drawn<>& world, Cell robot) {
  const CellRect& region = world.region;
  const auto index = [&](Cell c) { return static_cast<std::size_t>(c.y * region.width + c.x); };
  std::vector<std::uint16_t> costs(static_cast<std::size_t>(region.area()), path::kUnreachable);
  costs[index(robot)] = 0;
  for (bool changes = true; changes;) {
    changes = false;
    for (std::int32_t i = 0; i < 9 * region.area(); ++i) {
      const Cell from{i / 9 % region.width, i / 9 / region.width};
      const Cell to{from.x + i % 9 % 3 - 1, from.y + i % 9 / 3 - 1};
      if (costs[index(from)] == path::kUnreachable || !region.contains(to)) continue;
      if (!world.paths.is_traversable(world.map, to)) continue;
      const bool diagonal = from.x != to.x && from.y != to.y;
      const int cost = costs[index(from)] + (diagonal ? path::kDiagonal : path::kStraight);
      if (cost >= costs[index(to)]) continue;
      costs[index(to)] = static_cast<std::uint16_t>(cost);
      changes = true;
    }
  }
  return costs;
}

TEST(ShortestPathMap, EveryCostIsTheLeastOnRandomMaps) {
  std::minstd_rand random(11);
  for (int round = 0; round < 200; ++round) {
    std::vector<std::string> rows(5 + random() % 25, std::string(5 + random() % 25, '.'));
    const auto one_in = 3 + random() % 20;
    for (std::string& row : rows) {
      for (char& cell : row) cell = random() % one_in == 0 ? '#' : '.';
    }
    Drawn world(rows, {}, round % 2 == 0 ? 1'000 : 75'000);
    const Cell robot{static_cast<std::int32_t>(random()) % world.region.width,
                     static_cast<std::int32_t>(random()) % world.region.height};
    if (!world.paths.is_traversable(world.map, robot)) continue;
    world.paths.compute(world.map, robot, world.region);
    const std::vector<std::uint16_t> costs = relaxed_costs(world, robot);
    for (std::size_t i = 0; i < costs.size(); ++i) {
      const auto at = static_cast<std::int32_t>(i);
      const Cell c{at % world.region.width, at / world.region.width};
      ASSERT_EQ(world.paths.cost_at(world.map, c), costs[i]) << round << ": " << c.x << ' ' << c.y;
    }
  }
}

TEST(ShortestPathMap, ARobotOutsideTheRegionReachesNothing) {
  Drawn world({"....."});
  world.paths.compute(world.map, {40, 40}, world.region);
  EXPECT_EQ(world.paths.cost_at(world.map, {0, 0}), path::kUnreachable);
}

}  // namespace
}  // namespace ivfm
