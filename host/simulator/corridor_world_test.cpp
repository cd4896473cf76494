#include "host/simulator/corridor_world.h"

#include <gtest/gtest.h>

#include <numeric>

#include "host/simulator/world_region.h"

namespace ivfm::host {
namespace {

// FNV-1a, 64 bits (http://www.isthe.com/chongo/tech/comp/fnv).
std::uint64_t fnv1a(const std::vector<std::uint8_t>& bytes) {
  std::uint64_t hash = 14695981039346656037u;
  for (const std::uint8_t byte : bytes) hash = (hash ^ byte) * 1099511628211u;
  return hash;
}

double square_metres(const World& world, const std::vector<std::uint8_t>& cells) {
  const double cell_m = world.cell_um / 1e6;
  return std::accumulate(cells.begin(), cells.end(), 0) * cell_m * cell_m;
}

const World& corridor() {
  static const World world = corridor_world();
  return world;
}

TEST(CorridorWorld, IsTheSameOnEveryMachine) {
  // mrpt-common 2.5.8 with MRPT 2.5.8 (Debian 12).
  EXPECT_EQ(fnv1a(corridor().occupied), 11284086592965414998u);
  EXPECT_EQ(corridor_world().occupied, corridor().occupied);
}

TEST(CorridorWorld, IsAClosedPlaceOfPlausibleSize) {
  const World& world = corridor();
  EXPECT_EQ(world.cell_um, 50'000);
  EXPECT_EQ(world.origin.x_um % world.cell_um, 0);  // aligned with the robots' cells
  EXPECT_EQ(world.origin.y_um % world.cell_um, 0);
  for (std::int32_t x = 0; x < world.width; ++x) {
    ASSERT_TRUE(world.occupied[static_cast<std::size_t>(x)]);
    ASSERT_TRUE(world.occupied[world.occupied.size() - 1 - static_cast<std::size_t>(x)]);
  }
  const Pose start = corridor_start_poses(1)[0];
  const auto visible = visible_region(world, start.position);
  // A hall of 65 m by about 2.5 m and a laboratory of 12 x 5 m.
  EXPECT_GT(square_metres(world, visible), 180);
  EXPECT_LT(square_metres(world, visible), 260);
  for (std::size_t i = 0; i < visible.size(); ++i) ASSERT_NE(visible[i], world.occupied[i]);
}

TEST(CorridorWorld, ARobotWithSomeMarginReachesTheLaboratoryAndBothEnds) {
  const World& world = corridor();
  const Pose start = corridor_start_poses(1)[0];
  const auto reached = reachable_cells(world, start.position, kRobotRadiusUm + 95'000);
  const auto is_reached = [&](double x_m, double y_m) {
    const auto column = static_cast<std::int64_t>((x_m * 1e6 - world.origin.x_um) / world.cell_um);
    const auto row = static_cast<std::int64_t>((y_m * 1e6 - world.origin.y_um) / world.cell_um);
    return reached[static_cast<std::size_t>(row * world.width + column)] != 0;
  };
  EXPECT_TRUE(is_reached(0, 0));       // where the recording started, in the laboratory
  EXPECT_TRUE(is_reached(-32, -12));   // west end
  EXPECT_TRUE(is_reached(30, -10.5));  // east end
}

TEST(CorridorWorld, EveryStartPoseHasRoomForTheRobot) {
  for (int count = 1; count <= 8; ++count) {
    const auto poses = corridor_start_poses(count);
    ASSERT_EQ(poses.size(), static_cast<std::size_t>(count));
    const auto reached = reachable_cells(corridor(), poses[0].position, kRobotRadiusUm + 50'000);
    for (const Pose& pose : poses) {
      const auto column = (pose.position.x_um - corridor().origin.x_um) / corridor().cell_um;
      const auto row = (pose.position.y_um - corridor().origin.y_um) / corridor().cell_um;
      EXPECT_TRUE(reached[static_cast<std::size_t>(row) * corridor().width + column]);
    }
  }
  EXPECT_THROW(corridor_start_poses(0), std::invalid_argument);
  EXPECT_THROW(corridor_start_poses(9), std::invalid_argument);
}

TEST(CorridorWorld, AMissingRecordingSaysWhichPackageHasIt) {
  RecordedWorldRecipe recipe;
  recipe.simple_map = "/nowhere/x.simplemap.gz";
  try {
    build_recorded_world(recipe);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("mrpt-common"), std::string::npos);
  }
}

TEST(MalagaWorld, IsAnOpenPlaceAroundABuilding) {
  const World world = malaga_world();
  const auto visible = visible_region(world, {0, 0});
  EXPECT_GT(square_metres(world, visible), 1000);
}

// A world drawn with '#' for obstacles, the first line being the highest row; cells of 0.1 m.
World drawn(const std::vector<std::string>& rows) {
  World world{"drawn",
              100'000,
              static_cast<std::int32_t>(rows[0].size()),
              static_cast<std::int32_t>(rows.size()),
              {},
              {}};
  for (auto row = rows.rbegin(); row != rows.rend(); ++row) {
    for (const char c : *row) world.occupied.push_back(c == '#' ? 1 : 0);
  }
  return world;
}

TEST(WorldRegion, ADiscStaysAwayFromWallsAndTheEdge) {
  const World world = drawn({
      ".....",
      ".....",
      "....#",
      ".....",
      ".....",
  });
  // A disc of 0.1 m needs its centre more than 0.1 + 0.05 m from an obstacle cell's centre.
  const std::vector<std::uint8_t> expected{
      0, 0, 0, 0, 0,  //
      0, 1, 1, 0, 0,  //
      0, 1, 1, 0, 0,  //
      0, 1, 1, 0, 0,  //
      0, 0, 0, 0, 0,
  };
  EXPECT_EQ(cells_with_clearance(world, 100'000), expected);
}

TEST(WorldRegion, ReachabilityEndsAtNarrowDoors) {
  const World world = drawn({
      ".......",
      "...#...",
      "...#...",
      ".......",
      "...#...",
      "...#...",
      ".......",
  });
  const auto visible = visible_region(world, {50'000, 50'000});
  EXPECT_EQ(std::accumulate(visible.begin(), visible.end(), 0), 49 - 4);
  const auto reached = reachable_cells(world, {150'000, 350'000}, 90'000);
  EXPECT_EQ(std::accumulate(reached.begin(), reached.end(), 0), 5 + 1);  // the left room's middle
  const auto nowhere = reachable_cells(world, {9'000'000, 0}, 90'000);
  EXPECT_EQ(std::accumulate(nowhere.begin(), nowhere.end(), 0), 0);
}

TEST(WorldRegion, RandomStartsAreReachableApartAndRepeatable) {
  const auto poses = random_start_poses(corridor(), 6, kRobotRadiusUm, 42);
  EXPECT_EQ(poses, random_start_poses(corridor(), 6, kRobotRadiusUm, 42));
  EXPECT_NE(poses, random_start_poses(corridor(), 6, kRobotRadiusUm, 43));
  for (const Pose& a : poses) {
    EXPECT_FALSE(corridor().is_occupied(a.position));
    for (const Pose& b : poses) {
      EXPECT_TRUE(a == b || squared_distance_um2(a.position, b.position) >= 250'000'000'000);
    }
  }
  EXPECT_THROW(random_start_poses(drawn({"...", "...", "..."}), 1, kRobotRadiusUm, 1),
               std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host
