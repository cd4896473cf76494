#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "firmware/planning/frontier.h"
#include "firmware/planning/path_planner.h"
#include "firmware/planning/view_planner.h"

namespace ivfm {
namespace {

// Drawn from the top row down: '#' obstacle, '.' seen free, ' ' unseen. (0, 0) is the lower left.
struct Drawn {
  explicit Drawn(const std::vector<std::string>& rows)
      : map(storage->layers(), 50'000, 64, 1'000), paths({}, buckets->entries) {
    const auto height = static_cast<std::int32_t>(rows.size());
    for (std::int32_t y = 0; y < height; ++y) {
      const std::string& row = rows[static_cast<std::size_t>(height - 1 - y)];
      region = region.united(CellRect{0, y, static_cast<std::int32_t>(row.size()), 1});
      for (std::int32_t x = 0; x < static_cast<std::int32_t>(row.size()); ++x) {
        const char drawn = row[static_cast<std::size_t>(x)];
        if (drawn == '#') map.add_evidence({x, y}, occupancy::kHit);
        if (drawn == '.') map.count_visit({x, y});
      }
    }
  }
  std::unique_ptr<MapStorage<64>> storage = std::make_unique<MapStorage<64>>();
  std::unique_ptr<BucketStorage<64>> buckets = std::make_unique<BucketStorage<64>>();
  ExplorationMap map;
  ShortestPathMap paths;
  CellRect region{};
};

TEST(Frontier, IsTheUnseenSideOfTheBorderAndNeverAnObstacle) {
  Drawn world({"..  ",  //
               "..# ",  //
               "..# "});
  EXPECT_TRUE(is_frontier(world.map, {2, 2}));
  EXPECT_FALSE(is_frontier(world.map, {3, 2})) << "not next to a seen cell";
  EXPECT_FALSE(is_frontier(world.map, {2, 1})) << "an obstacle";
  EXPECT_FALSE(is_frontier(world.map, {3, 1})) << "behind the wall";
  EXPECT_FALSE(is_frontier(world.map, {1, 2})) << "seen";
}

TEST(Frontier, TheNearestByPathIsChosenNotTheNearestByAir) {
  Drawn world({"..........",  //
               ".########.",  //
               ".#     .#.",  // unseen cells behind a wall, close by air
               ".########.",  //
               "........  "});
  world.paths.compute(world.map, {4, 0}, world.region);
  const auto goal = nearest_frontier(world.map, world.paths, world.region, 1, 1);
  ASSERT_TRUE(goal.has_value());
  EXPECT_EQ(goal->frontier, (Cell{8, 0}));
  EXPECT_EQ(goal->stand, (Cell{8, 0}));
}

TEST(Frontier, GivenUpFrontiersAreNotChosenAgain) {
  Drawn world({"... "});
  world.paths.compute(world.map, {0, 0}, world.region);
  EXPECT_TRUE(has_reachable_frontier(world.map, world.paths, world.region, 1, 1));
  world.map.set_flag({3, 0}, cell_flag::kGivenUp);
  EXPECT_FALSE(nearest_frontier(world.map, world.paths, {0, 0, 4, 1}, 1, 1).has_value());
}

TEST(Frontier, SpecksAreNotWide) {
  Drawn world({"#########",  //
               "#.....   ",  //
               "#.....   ",  //
               "#.. ..   ",  //
               "#.....   ",  //
               "#.....   ",  //
               "#########"});
  EXPECT_TRUE(is_frontier(world.map, {3, 3}));
  EXPECT_FALSE(is_wide_frontier(world.map, {3, 3}, 3));
  EXPECT_TRUE(is_wide_frontier(world.map, {6, 3}, 3));
  world.paths.compute(world.map, {2, 3}, world.region);
  EXPECT_EQ(nearest_frontier(world.map, world.paths, world.region, 1, 1)->frontier, (Cell{3, 3}));
  EXPECT_EQ(nearest_frontier(world.map, world.paths, world.region, 1, 3)->frontier.x, 6);
}

std::optional<FrontierGoal> richest(const Drawn& world, std::int32_t least) {
  return richest_region(world.map, world.paths, {}, world.region, 4, 2, least);
}

TEST(RichestRegion, WeighsWhatIsUnseenAgainstTheWayThere) {
  Drawn world({"........            ",  //
               ".  .....            ",  // two unseen cells close by, many further on
               ".  .....            ",  //
               "........            "});
  world.paths.compute(world.map, {0, 0}, world.region);
  EXPECT_EQ(count_reachable_unseen(world.map, world.paths, world.region), 4 + 4 * 12);
  const auto all = richest(world, 1);
  ASSERT_TRUE(all.has_value());
  EXPECT_EQ(all->frontier.x, 9) << "the first region that is all unseen, not the pocket";
  EXPECT_EQ(richest(world, 17), std::nullopt) << "a region holds 16";
  const CellRect seen = world.map.known_rect();
  EXPECT_EQ(richest_region(world.map, world.paths, {}, seen, 4, 2, 1)->frontier, (Cell{1, 1}));
}

TEST(RichestRegion, LeavesToATeammateWhatThatIsNearerTo) {
  Drawn world({"    ............    ",  //
               "    ............    ",  //
               "    ............    ",  //
               "    ............    "});
  world.paths.compute(world.map, {9, 1}, world.region);
  EXPECT_LT(richest(world, 1)->frontier.x, 4) << "a little nearer";
  Teammates teammates;
  teammates.set(std::array{Cell{6, 2}});
  const auto region = [&](const CellRect& rect) {
    return richest_region(world.map, world.paths, teammates, rect, 4, 2, 1)->frontier;
  };
  EXPECT_GE(region(world.region).x, 16);
  EXPECT_LT(region({0, 0, 16, 4}).x, 4) << "what is left is not left to a teammate alone";
}

TEST(RichestRegion, LeavesOutWhatIsOutOfReachOrGivenUp) {
  Drawn world({".....#    ",  //
               ".  ..#    ",  //
               ".....#    "});
  world.paths.compute(world.map, {0, 0}, world.region);
  EXPECT_EQ(count_reachable_unseen(world.map, world.paths, world.region), 2);
  EXPECT_EQ(richest(world, 1)->frontier, (Cell{1, 1}));
  world.map.set_flag({1, 1}, cell_flag::kGivenUp);
  world.map.set_flag({2, 1}, cell_flag::kGivenUp);
  EXPECT_EQ(richest(world, 1), std::nullopt);
}

// The definition, cell by cell.
std::optional<FrontierGoal> richest_by_definition(const Drawn& world, std::int32_t side,
                                                  std::int32_t way, std::int32_t least) {
  const auto cells_of = [&](const CellRect& rect) {
    std::vector<Cell> cells;
    for (std::int32_t y = rect.y; y < rect.top(); ++y) {
      for (std::int32_t x = rect.x; x < rect.right(); ++x) {
        const Cell c{x, y};
        if (world.map.is_seen(c) || world.map.is_given_up(c)) continue;
        if (world.paths.cost_at(world.map, c) != path::kUnreachable) cells.push_back(c);
      }
    }
    return cells;
  };
  const auto cost = [&](Cell c) { return world.paths.cost_at(world.map, c); };
  std::vector<Cell> best;
  double best_worth = 0;
  for (std::int32_t y = 0; y < world.region.top(); y += side / 2) {
    for (std::int32_t x = 0; x < world.region.right(); x += side / 2) {
      const std::vector<Cell> cells = cells_of({x, y, side, side});
      if (cells.empty() || static_cast<std::int32_t>(cells.size()) < least) continue;
      const int nearest = cost(std::ranges::min(cells, {}, cost));
      const double worth = static_cast<double>(cells.size()) / (nearest + 12 * way);
      if (worth <= best_worth) continue;
      best_worth = worth;
      best = cells;
    }
  }
  if (best.empty()) return std::nullopt;
  const auto n = static_cast<std::int32_t>(best.size());
  std::int32_t sum_x = 0, sum_y = 0;
  for (const Cell& c : best) sum_x += c.x, sum_y += c.y;
  const Cell middle = std::ranges::min(best, {}, [&](Cell c) {
    return (c.x * n - sum_x) * (c.x * n - sum_x) + (c.y * n - sum_y) * (c.y * n - sum_y);
  });
  return FrontierGoal{middle, middle, cost(middle)};
}

TEST(RichestRegion, IsWhatItsDefinitionSaysOnRandomMaps) {
  std::minstd_rand random(7);
  for (int round = 0; round < 100; ++round) {
    std::vector<std::string> rows(9 + random() % 20, std::string(9 + random() % 20, ' '));
    for (std::string& row : rows) {
      for (char& cell : row) cell = random() % 9 == 0 ? '#' : random() % 3 == 0 ? '.' : ' ';
    }
    rows.back()[0] = '.';
    Drawn world(rows);
    world.map.set_flag({4, 4}, cell_flag::kGivenUp);
    world.paths.compute(world.map, {0, 0}, world.region);
    const std::int32_t side = 2 + 2 * static_cast<std::int32_t>(random() % 5);
    const auto way = static_cast<std::int32_t>(random() % 20);
    const auto least = static_cast<std::int32_t>(random() % 9);
    ASSERT_EQ(richest_region(world.map, world.paths, {}, world.region, side, way, least),
              richest_by_definition(world, side, way, least))
        << round;
  }
}

TEST(View, CountsUnseenCellsInReachAsADiscDoesAndNothingBehindWalls) {
  Drawn open({"."});
  const std::int32_t disc = unseen_in_view(open.map, {0, 0}, 20);
  EXPECT_NEAR(disc, 1257, 70) << "pi times 20 squared";
  Drawn walled({"#########",  //
                "#.......#",  //
                "#.......#",  //
                "#########"});
  EXPECT_EQ(unseen_in_view(walled.map, {4, 1}, 20), 0);
}

TEST(View, AViewIsWeighedAgainstTheWayToIt) {
  // A speck of unseen cells three cells to the west; a door to the unknown eight to the east.
  Drawn world({"####################",  //
               "#..  ..............#",  //
               "#..  ..............#",  //
               "#...................",  //
               "#...................",  //
               "#...................",  //
               "####################"});
  world.paths.compute(world.map, {8, 3}, world.region.grown(4));
  const auto nearest = nearest_frontier(world.map, world.paths, world.region.grown(4), 1, 2);
  const auto best = best_frontier_view(world.map, world.paths, {}, world.region.grown(4), 12, 1, 2);
  ASSERT_TRUE(nearest && best);
  EXPECT_LT(nearest->frontier.x, 8);
  EXPECT_EQ(best->goal.frontier.x, 20);
  EXPECT_TRUE(ViewValue({10, 2}).is_better_than({14, 3}));
  EXPECT_FALSE(ViewValue({10, 2}).is_better_than({15, 3}));
}

TEST(View, WhatATeammateIsNearerToIsLeftToIt) {
  Drawn world({"##################",  //
               "..................",  //
               "..................",  //
               "##################"});
  const CellRect rect = world.region.grown(4);
  world.paths.compute(world.map, {8, 1}, rect);
  Teammates teammates;
  const auto best = [&](const CellRect& where) {
    return best_frontier_view(world.map, world.paths, teammates, where, 6, 1, 2);
  };
  const auto alone = best(rect);
  ASSERT_TRUE(alone);
  EXPECT_LT(alone->goal.frontier.x, 0) << "a little nearer";
  teammates.set(std::array{Cell{4, 1}});
  EXPECT_GT(best(rect)->goal.frontier.x, 17);
  const auto left = best({-4, 0, 10, 4});
  EXPECT_EQ(left->goal, alone->goal);
  EXPECT_LT(left->value.cells, alone->value.cells);
}

TEST(View, FrontiersInSightOfEachOtherCountForEachOther) {
  const std::vector<std::string> rows{"#####################",  //
                                      "#...................#",  //
                                      "#...................#",  //
                                      "#...................#",  //
                                      "#####################"};
  Drawn world(rows);
  const ViewValue alone = value_of_view(world.map, {5, 2}, 12, 30, 2);
  const ViewValue two = value_of_view(world.map, {5, 2}, 12, 30, 3);
  EXPECT_EQ(alone.cells * 3, two.cells * 2) << "nothing unseen in view: only what is closed counts";
}

TEST(PathPlanner, AStraightWayIsOneWaypoint) {
  Drawn world({"........", "........", "........"});
  world.paths.compute(world.map, {0, 0}, world.region);
  WaypointPath path;
  ASSERT_TRUE(ok(plan_path(world.map, world.paths, {7, 2}, path)));
  ASSERT_EQ(path.points().size(), 1u);
  EXPECT_EQ(path.points()[0], world.map.frame().center_of({7, 2}));
}

TEST(PathPlanner, WaypointsGoAroundCornersAndEverySegmentIsFree) {
  Drawn world({".....", "...#.", ".###.", "....."});
  world.paths.compute(world.map, {1, 0}, world.region);
  WaypointPath path;
  ASSERT_TRUE(ok(plan_path(world.map, world.paths, {2, 2}, path)));
  ASSERT_GE(path.points().size(), 2u);
  Cell at{1, 0};
  for (const Point& p : path.points()) {
    const Cell next = world.map.frame().cell_at(p);
    EXPECT_TRUE(line_is_traversable(world.map, world.paths, at, next));
    at = next;
  }
  EXPECT_EQ(at, (Cell{2, 2}));
}

TEST(PathPlanner, AGoalOutOfReachIsRefused) {
  Drawn world({"..#.", "..#."});
  world.paths.compute(world.map, {0, 0}, world.region);
  WaypointPath path;
  EXPECT_EQ(plan_path(world.map, world.paths, {3, 1}, path), Status::kUnavailable);
  EXPECT_TRUE(path.empty());
}

TEST(WaypointPath, AFullPathDropsWhatIsFarthestAway) {
  WaypointPath path;
  for (int i = 70; i > 0; --i) path.push_front({i * 1000, 0});
  ASSERT_EQ(path.points().size(), WaypointPath::kMaxWaypoints);
  EXPECT_EQ(path.points().front(), (Point{1000, 0}));
  EXPECT_EQ(path.points().back(), (Point{64'000, 0}));
  EXPECT_EQ(path.length_um({0, 0}), 64'000);
}

}  // namespace
}  // namespace ivfm
