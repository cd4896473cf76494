#include "host/environment/ray_caster.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "host/environment/random.h"

namespace ivfm::host {
namespace {

// Draws a world from text, highest row first: '#' is an obstacle.
std::shared_ptr<World> drawn(const std::vector<std::string>& rows, std::int32_t cell_um,
                             Point origin = {0, 0}) {
  auto world = std::make_shared<World>();
  world->cell_um = cell_um;
  world->width = static_cast<std::int32_t>(rows.front().size());
  world->height = static_cast<std::int32_t>(rows.size());
  world->origin = origin;
  for (auto row = rows.rbegin(); row != rows.rend(); ++row) {
    for (const char c : *row) world->occupied.push_back(c == '#' ? 1 : 0);
  }
  return world;
}

std::shared_ptr<World> random_world(Random& random) {
  auto world = std::make_shared<World>();
  world->cell_um = 10'000;
  world->width = 60;
  world->height = 40;
  world->origin = {-137'000, 55'000};
  world->occupied.resize(60 * 40);
  const std::uint32_t percent = 1 + random.below(8);
  for (auto& cell : world->occupied) cell = random.chance(percent) ? 1 : 0;
  return world;
}

TEST(RayCaster, EndsOnTheEdgeOfTheFirstOccupiedCell) {
  const RayCaster rays(drawn({".....#", ".....#", "......"}, 10'000));
  EXPECT_EQ(rays.cast_um({5'000, 15'000}, BinaryAngle::from_degrees(0), 1'000'000), 45'000);
  // The lowest row is open up to the world's edge.
  EXPECT_EQ(rays.cast_um({5'000, 5'000}, BinaryAngle::from_degrees(0), 1'000'000), 55'000);
  EXPECT_EQ(rays.cast_um({5'000, 5'000}, BinaryAngle::from_degrees(90), 1'000'000), 25'000);
  EXPECT_EQ(rays.cast_um({5'000, 5'000}, BinaryAngle::from_degrees(180), 1'000'000), 5'000);
}

TEST(RayCaster, StopsAtTheGivenRangeAndAtZeroInsideAnObstacle) {
  const RayCaster rays(drawn({".....#", "......"}, 10'000));
  EXPECT_EQ(rays.cast_um({5'000, 15'000}, BinaryAngle::from_degrees(0), 30'000), 30'000);
  EXPECT_EQ(rays.cast_um({55'000, 15'000}, BinaryAngle::from_degrees(0), 30'000), 0);
  EXPECT_EQ(rays.cast_um({-1, 15'000}, BinaryAngle::from_degrees(0), 30'000), 0);
}

// A ray marched in steps of 20 um, rounded down to the cell.
double marched_um(const World& world, Point from, BinaryAngle bearing, double max_um) {
  const double c = std::cos(bearing.radians()), s = std::sin(bearing.radians());
  for (double t = 0; t < max_um; t += 20) {
    const Point p{static_cast<std::int32_t>(std::floor(from.x_um + t * c)),
                  static_cast<std::int32_t>(std::floor(from.y_um + t * s))};
    if (world.is_occupied(p)) return t;
  }
  return max_um;
}

TEST(RayCaster, AgreesWithMarchingOnRandomWorlds) {
  Random random(3);
  int differ = 0;
  for (int round = 0; round < 20; ++round) {
    const auto world = random_world(random);
    const RayCaster rays(world);
    for (int i = 0; i < 100; ++i) {
      const Point from{world->origin.x_um + random.between(0, 599'999),
                       world->origin.y_um + random.between(0, 399'999)};
      const BinaryAngle bearing(static_cast<std::uint16_t>(random.below(65536)));
      const double expected = marched_um(*world, from, bearing, 300'000);
      const double actual = rays.cast_um(from, bearing, 300'000);
      // Marching may step over a corner that is cut by less than its step; it is never nearer.
      ASSERT_LE(actual, expected + 2);
      if (std::abs(actual - expected) > 30) ++differ;
    }
  }
  EXPECT_LE(differ, 10);  // corners
}

TEST(RayCaster, SeesAlongASegmentOnlyWhenNothingStandsOnIt) {
  const RayCaster rays(drawn({"......", "..##..", "......"}, 10'000));
  EXPECT_TRUE(rays.line_of_sight({5'000, 5'000}, {55'000, 5'000}));
  EXPECT_FALSE(rays.line_of_sight({5'000, 15'000}, {55'000, 15'000}));
  EXPECT_TRUE(rays.line_of_sight({5'000, 15'000}, {19'000, 15'000}));
  EXPECT_FALSE(rays.line_of_sight({5'000, 15'000}, {21'000, 15'000}));
  EXPECT_TRUE(rays.line_of_sight({5'000, 5'000}, {5'000, 5'000}));
}

TEST(RayCaster, FindsADiscFreeOnlyWhenNoCellComesNearerThanItsRadius) {
  const RayCaster rays(drawn({"......", "......", "......", "....#.", "......"}, 10'000));
  // The occupied cell spans 40..50 by 10..20 mm.
  EXPECT_TRUE(rays.disc_is_free({29'000, 15'000}, 10'500));
  EXPECT_FALSE(rays.disc_is_free({29'000, 15'000}, 11'500));
  // Over the corner (40, 20): distance sqrt(6^2 + 8^2) = 10.
  EXPECT_TRUE(rays.disc_is_free({34'000, 28'000}, 9'990));
  EXPECT_FALSE(rays.disc_is_free({34'000, 28'000}, 10'010));
  EXPECT_FALSE(rays.disc_is_free({5'000, 25'000}, 6'000));  // the world's edge
}

TEST(RayCaster, StopsAMovingDiscAtFirstContact) {
  const RayCaster rays(drawn({"..........", "..........", "....#.....", ".........."}, 10'000));
  // Head on against the face at x = 40 mm.
  EXPECT_NEAR(rays.free_travel_um({12'000, 15'000}, {100'000, 15'000}, 8'000), 20'000, 1);
  // Past the corner (40, 20) at a height of 6 mm above it: contact at x = 40 - sqrt(100 - 36) = 32.
  EXPECT_NEAR(rays.free_travel_um({12'000, 26'000}, {80'000, 26'000}, 10'000), 20'000, 1);
  // High enough to pass.
  EXPECT_NEAR(rays.free_travel_um({12'000, 30'500}, {80'000, 30'500}, 9'000), 68'000, 1);
  // Against the world's edge.
  EXPECT_NEAR(rays.free_travel_um({80'000, 25'000}, {150'000, 25'000}, 8'000), 12'000, 1);
}

TEST(RayCaster, LetsATouchingDiscMoveAwayOrAlongButNotCloser) {
  const RayCaster rays(drawn({"..........", "..........", "....#.....", ".........."}, 10'000));
  const Point touching{32'500, 15'000};  // 7.5 mm from the face
  EXPECT_NEAR(rays.free_travel_um(touching, {20'000, 15'000}, 8'000), 12'500, 1);
  EXPECT_NEAR(rays.free_travel_um(touching, {36'000, 15'000}, 8'000), 0, 1);
}

// The same by marching in steps of 0.1 mm.
TEST(RayCaster, FirstContactAgreesWithMarchingOnRandomWorlds) {
  Random random(4);
  constexpr std::int32_t kRadius = 23'000;
  int compared = 0;
  for (int round = 0; round < 40; ++round) {
    const auto world = random_world(random);
    const RayCaster rays(world);
    for (int i = 0; i < 200; ++i) {
      const Point from{world->origin.x_um + random.between(0, 599'999),
                       world->origin.y_um + random.between(0, 399'999)};
      if (!rays.disc_is_free(from, kRadius + 10)) continue;
      const Point to{from.x_um + random.between(-200'000, 200'000),
                     from.y_um + random.between(-200'000, 200'000)};
      const double length = std::hypot(to.x_um - from.x_um, to.y_um - from.y_um);
      double expected = length;
      for (double t = 0; t < length; t += 100) {
        const Point p{static_cast<std::int32_t>(from.x_um + (to.x_um - from.x_um) * t / length),
                      static_cast<std::int32_t>(from.y_um + (to.y_um - from.y_um) * t / length)};
        if (rays.disc_is_free(p, kRadius - 3)) continue;  // p is rounded to micrometres
        expected = t;
        break;
      }
      const double actual = rays.free_travel_um(from, to, kRadius);
      ASSERT_LE(actual, expected + 2) << "from " << from.x_um << ' ' << from.y_um;
      if (actual < expected - 102) {  // a grazing touch between two steps of the march
        const Point p{
            static_cast<std::int32_t>(from.x_um + (to.x_um - from.x_um) * actual / length),
            static_cast<std::int32_t>(from.y_um + (to.y_um - from.y_um) * actual / length)};
        ASSERT_FALSE(rays.disc_is_free(p, kRadius + 60));
      }
      ++compared;
    }
  }
  EXPECT_GT(compared, 200);
}

TEST(RayCaster, RefusesABitmapThatDoesNotMatchItsSides) {
  auto world = drawn({"..", ".."}, 10'000);
  world->width = 3;
  EXPECT_THROW(RayCaster{world}, std::invalid_argument);
  EXPECT_THROW(RayCaster{std::make_shared<World>()}, std::invalid_argument);
}

}  // namespace
}  // namespace ivfm::host
