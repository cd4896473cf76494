#include "firmware/supervisor/obstacle_guard.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

namespace ivfm {
namespace {

constexpr std::int32_t kRadiusMm = 200;
constexpr std::int32_t kHorizonMm = 2'000;
constexpr Velocity kAhead{300'000, 0};

void add_hit(Scan& scan, double x_mm, double y_mm) {
  scan.push({BinaryAngle::from_radians(std::atan2(y_mm, x_mm)),
             static_cast<std::uint16_t>(std::lround(std::hypot(x_mm, y_mm))), Echo::kHit, 10});
}

Scan scan_with_hit(double x_mm, double y_mm) {
  Scan scan;
  add_hit(scan, x_mm, y_mm);
  return scan;
}

std::int32_t free_travel(const Scan& scan, const Velocity& motion, const Pose& pose = {}) {
  return free_travel_mm({scan, Pose{}, {}}, pose, motion, kRadiusMm, kHorizonMm);
}

TEST(ObstacleGuard, AWallAheadIsTouchedOneRadiusBeforeIt) {
  EXPECT_NEAR(free_travel(scan_with_hit(1000, 0), kAhead), 800, 1);
}

TEST(ObstacleGuard, AHitAtTheSideOfTheCorridorIsTouchedLater) {
  // 3-4-5: at y = 120 the disc's rim is 160 ahead of its centre.
  EXPECT_NEAR(free_travel(scan_with_hit(1000, 120), kAhead), 840, 2);
  EXPECT_NEAR(free_travel(scan_with_hit(1000, -120), kAhead), 840, 2);
}

TEST(ObstacleGuard, HitsBesideTheCorridorOrBehindDoNotMatter) {
  EXPECT_EQ(free_travel(scan_with_hit(500, 205), kAhead), kHorizonMm);
  EXPECT_EQ(free_travel(scan_with_hit(-500, 0), kAhead), kHorizonMm);
}

TEST(ObstacleGuard, BackingUpLooksBehind) {
  const Velocity back{-300'000, 0};
  EXPECT_NEAR(free_travel(scan_with_hit(-500, 0), back), 300, 1);
  EXPECT_EQ(free_travel(scan_with_hit(500, 0), back), kHorizonMm);
}

TEST(ObstacleGuard, TurningOnTheSpotTouchesNothing) {
  EXPECT_EQ(free_travel(scan_with_hit(150, 0), {0, 1000}), kHorizonMm);
}

TEST(ObstacleGuard, InsideTheDiscOnlyTheFrontBlocks) {
  EXPECT_EQ(free_travel(scan_with_hit(150, 0), kAhead), 0);
  EXPECT_EQ(free_travel(scan_with_hit(100, 100), kAhead), 0);
  EXPECT_EQ(free_travel(scan_with_hit(50, 150), kAhead), kHorizonMm);
  EXPECT_EQ(free_travel(scan_with_hit(-150, 0), kAhead), kHorizonMm);
}

TEST(ObstacleGuard, OnlyHitsAreObstacles) {
  Scan scan;
  scan.push({BinaryAngle(), 500, Echo::kClear, 10});
  scan.push({BinaryAngle(), 300, Echo::kNothing, 0});
  EXPECT_EQ(free_travel(scan, kAhead), kHorizonMm);
}

TEST(ObstacleGuard, OtherRobotsAreInTheWayThoughTheyAreNoPartOfTheMap) {
  Scan scan = scan_with_hit(1000, 0);
  scan.storage[0].echo = Echo::kRobot;
  EXPECT_NEAR(free_travel(scan, kAhead), 800, 1);
}

TEST(ObstacleGuard, AnArcMissesWhatIsStraightAheadAndMeetsWhatLiesOnIt) {
  const Velocity left_arc{500'000, 1000};  // turning radius 500 mm
  EXPECT_EQ(free_travel(scan_with_hit(1000, 0), left_arc), kHorizonMm);
  // Half a circle on, the hit at (0, 1000) lies on the circle itself. The disc touches it at the
  // chord of 200 mm: 2 asin(0.2) = 0.4027 rad before pi, so after 500 * 2.7389 mm.
  EXPECT_NEAR(free_travel(scan_with_hit(0, 1000), left_arc), 1369, 4);
  const Velocity right_arc{500'000, -1000};
  EXPECT_NEAR(free_travel(scan_with_hit(0, -1000), right_arc), 1369, 4);
  EXPECT_EQ(free_travel(scan_with_hit(0, 1000), right_arc), kHorizonMm);
  const Velocity back_to_the_left{-500'000, -1000};
  EXPECT_NEAR(free_travel(scan_with_hit(0, 1000), back_to_the_left), 1369, 4);
}

TEST(ObstacleGuard, AgreesWithDrivingTheArcStepByStep) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-1500, 1500);
  std::uniform_int_distribution<int> speed(-500'000, 500'000), turn(-3000, 3000);
  for (int i = 0; i < 2000; ++i) {
    const double x = std::round(place(random)), y = std::round(place(random));
    if (std::hypot(x, y) < kRadiusMm + 5) continue;
    const Velocity motion{speed(random), turn(random)};
    if (std::abs(motion.v_um_s) < 1000) continue;
    double px = 0, py = 0, heading = 0, travelled = 0;
    const double curvature = double(motion.omega_mrad_s) / std::abs(motion.v_um_s);  // rad a mm
    double closest = 1e9;
    while (travelled < kHorizonMm && std::hypot(px - x, py - y) > kRadiusMm) {
      closest = std::min(closest, std::hypot(px - x, py - y));
      const double sign = motion.v_um_s > 0 ? 1 : -1;
      px += sign * std::cos(heading + curvature / 2);
      py += sign * std::sin(heading + curvature / 2);
      heading += curvature;
      travelled += 1;
    }
    const bool grazes = std::abs(closest - kRadiusMm) < 12;
    const std::int32_t free_mm = free_travel(scan_with_hit(x, y), motion);
    if (!grazes || travelled < kHorizonMm) {
      EXPECT_LE(free_mm, travelled + 40)
          << x << ' ' << y << ' ' << motion.v_um_s << ' ' << motion.omega_mrad_s;
    }
    if (!grazes) {
      EXPECT_GE(free_mm, travelled - 40)
          << x << ' ' << y << ' ' << motion.v_um_s << ' ' << motion.omega_mrad_s;
    }
  }
}

TEST(ObstacleGuard, TheRobotsMotionSinceTheScanCounts) {
  const Scan scan = scan_with_hit(1000, 0);
  const Pose moved_on{{300'000, 0}, BinaryAngle()};
  EXPECT_NEAR(free_travel(scan, kAhead, moved_on), 500, 2);
  const Pose turned_left{{0, 0}, BinaryAngle::from_degrees(90)};
  EXPECT_EQ(free_travel(scan, kAhead, turned_left), kHorizonMm);
}

TEST(ObstacleGuard, FurtherPointsCountAsHits) {
  const std::array points{Point{1'000'000, 500'000}};
  const Pose facing_it{{0, 500'000}, BinaryAngle()};
  EXPECT_NEAR(free_travel_mm({Scan{}, Pose{}, points}, facing_it, kAhead, kRadiusMm, kHorizonMm),
              800, 1);
}

TEST(ObstacleGuard, RelativePoseIsSeenFromTheFirst) {
  const Pose from{{1'000'000, 2'000'000}, BinaryAngle::from_degrees(90)};
  const Pose of{{1'000'000, 2'500'000}, BinaryAngle::from_degrees(180)};
  const Pose seen = relative_pose(from, of);
  EXPECT_NEAR(seen.position.x_um, 500'000, 2);
  EXPECT_NEAR(seen.position.y_um, 0, 2);
  EXPECT_EQ(seen.heading, BinaryAngle::from_degrees(90));
}

}  // namespace
}  // namespace ivfm
