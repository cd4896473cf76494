#include "firmware/supervisor/blind_zone.h"

#include <gtest/gtest.h>

namespace ivfm {
namespace {

constexpr std::int32_t kBlindUm = 170'000;
constexpr Pose kOrigin{};
constexpr Pose kNearer{{60'000, 0}, BinaryAngle()};

Scan scan_ahead_mm(std::uint16_t range_mm, Echo echo = Echo::kHit) {
  Scan scan;
  scan.push({BinaryAngle(), range_mm, echo, 10});
  return scan;
}

TEST(BlindZone, RemembersAHitThatBecomesTooNearToSee) {
  BlindZone zone(kBlindUm);
  zone.update(scan_ahead_mm(200), kOrigin);
  ASSERT_EQ(zone.points().size(), 1u);
  zone.update(scan_ahead_mm(0, Echo::kNothing), kNearer);
  ASSERT_EQ(zone.points().size(), 1u);
  EXPECT_EQ(zone.points()[0], (Point{200'000, 0}));
}

TEST(BlindZone, ForgetsAHitThatABeamNowPassesThrough) {
  BlindZone zone(kBlindUm);
  zone.update(scan_ahead_mm(200), kOrigin);
  zone.update(scan_ahead_mm(1'000), kNearer);
  EXPECT_TRUE(zone.points().empty());
}

TEST(BlindZone, ForgetsWhatTheLidarCanSeeForItselfAgain) {
  BlindZone zone(kBlindUm);
  zone.update(scan_ahead_mm(200), kOrigin);
  zone.update(scan_ahead_mm(0, Echo::kNothing), kNearer);
  zone.update(scan_ahead_mm(0, Echo::kNothing), kOrigin);
  EXPECT_TRUE(zone.points().empty());
}

TEST(BlindZone, FarHitsAreTheScansBusiness) {
  BlindZone zone(kBlindUm);
  zone.update(scan_ahead_mm(400), kOrigin);
  EXPECT_TRUE(zone.points().empty());
}

TEST(BlindZone, PointsAreSeenFromTheRobotsPose) {
  BlindZone zone(kBlindUm);
  zone.update(scan_ahead_mm(200), {{1'000'000, 0}, BinaryAngle::from_degrees(90)});
  ASSERT_EQ(zone.points().size(), 1u);
  EXPECT_NEAR(zone.points()[0].x_um, 1'000'000, 2);
  EXPECT_NEAR(zone.points()[0].y_um, 200'000, 2);
}

TEST(BlindZone, PointsMoveWithTheMapFrame) {
  BlindZone zone(kBlindUm);
  zone.update(scan_ahead_mm(200), kOrigin);
  zone.re_express({{1'000'000, 0}, BinaryAngle::from_degrees(90)});
  ASSERT_EQ(zone.points().size(), 1u);
  EXPECT_NEAR(zone.points()[0].x_um, 1'000'000, 2);
  EXPECT_NEAR(zone.points()[0].y_um, 200'000, 2);
}

TEST(BlindZone, AFullMemoryDropsTheRest) {
  BlindZone zone(1'000'000);
  Scan scan;
  for (std::size_t i = 0; i < 600; ++i) {
    scan.push({BinaryAngle(static_cast<std::uint16_t>(i * 109)), 900, Echo::kHit, 10});
  }
  zone.update(scan, kOrigin);
  EXPECT_EQ(zone.points().size(), BlindZone::kCapacity);
}

}  // namespace
}  // namespace ivfm
