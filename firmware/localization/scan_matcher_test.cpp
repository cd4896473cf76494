#include "firmware/localization/scan_matcher.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "firmware/mapping/scan_fusion.h"
#include "tests/support/drawn_walls.h"

namespace ivfm {
namespace {

constexpr std::int32_t kCellUm = 50'000;
constexpr std::int32_t kWindowCells = 256;

// 10 cm and 3 degrees: the prediction may be far off.
constexpr Symmetric3 kDoubt{0.01, 0, 0, 0.01, 0, 0.0027};

class ScanMatcherTest : public testing::Test {
 protected:
  // One revolution of 400 beams from `pose`; `wrong_percent` of them end anywhere.
  const Scan& scan_from(const std::vector<Wall>& walls, const Pose& pose, int wrong_percent = 0) {
    scan_.clear();
    for (int i = 0; i < 400; ++i) {
      const BinaryAngle bearing(static_cast<std::uint16_t>(i * 65536 / 400));
      double range_m = cast_m(walls, pose.position.x_um * 1e-6, pose.position.y_um * 1e-6,
                              (pose.heading + bearing).radians());
      range_m += range_m > 0 ? (random(21) - 10) * 1e-3 : 0;  // 6 mm of noise
      if (random(100) < wrong_percent) range_m = 0.2 + random(5000) * 1e-3;
      const auto range_mm = static_cast<std::uint16_t>(std::lround(range_m * 1000));
      (void)scan_.push({bearing, range_mm, range_mm > 0 ? Echo::kHit : Echo::kNothing, 40});
    }
    return scan_;
  }
  // What a robot that moves a little around `pose` has drawn of its surroundings.
  void draw(const std::vector<Wall>& walls, const Pose& pose) {
    map_.clear(map_.frame().cell_at(pose.position));
    surfaces_.clear();
    for (int i = 0; i < 12; ++i) {
      Pose here = pose;
      here.position.x_um += (i % 4) * 20'000;
      here.position.y_um += (i / 4) * 20'000;
      const Scan& scan = scan_from(walls, here);
      fusion_.fuse(map_, here, scan, false);
      scan_surfaces_.take(scan, 8'000'000, kCellUm);
      surfaces_.learn(map_, here, scan, scan_surfaces_, 8'000'000);
    }
  }
  ScanMatch match(const Pose& predicted, const Scan& scan, const Symmetric3& doubt = kDoubt) {
    return matcher_.match(map_, surfaces_, predicted, doubt, scan);
  }
  static Pose shifted(Pose pose, std::int32_t x_um, std::int32_t y_um, double degrees) {
    pose.position.x_um += x_um;
    pose.position.y_um += y_um;
    pose.heading = pose.heading + BinaryAngle::from_degrees(degrees);
    return pose;
  }
  static void expect_found(const Pose& found, const Pose& truth) {
    EXPECT_NEAR(found.position.x_um, truth.position.x_um, kCellUm / 4);
    EXPECT_NEAR(found.position.y_um, truth.position.y_um, kCellUm / 4);
    EXPECT_NEAR((found.heading - truth.heading).degrees(), 0, 0.2);
  }
  int random(int below) {
    seed_ = seed_ * 1664525u + 1013904223u;
    return static_cast<int>((seed_ >> 8) % static_cast<std::uint32_t>(below));
  }

  std::unique_ptr<MapStorage<kWindowCells>> cells_ = std::make_unique<MapStorage<kWindowCells>>();
  std::unique_ptr<SurfaceStorage<2048>> surface_cells_ = std::make_unique<SurfaceStorage<2048>>();
  ExplorationMap map_{cells_->layers(), kCellUm, kWindowCells, 100'000};
  ScanFusion fusion_{FusionConfig{}};
  SurfaceMap surfaces_{surface_cells_->surface_entries};
  ScanSurfaces scan_surfaces_;
  ScanMatcher matcher_{MatcherConfig{}};
  Scan scan_;
  std::uint32_t seed_ = 1;
};

TEST_F(ScanMatcherTest, FindsKnownOffsetsWithinAQuarterCellAndAFifthOfADegree) {
  const Pose truth{{120'000, 330'000}, BinaryAngle::from_degrees(31)};
  draw(kRoom, truth);
  const Scan& scan = scan_from(kRoom, truth);
  for (const std::int32_t x_um : {-80'000, 0, 33'000}) {
    for (const std::int32_t y_um : {-57'000, 90'000}) {
      for (const double degrees : {-2.5, 0.0, 1.3}) {
        const ScanMatch found = match(shifted(truth, x_um, y_um, degrees), scan);
        ASSERT_EQ(found.outcome, MatchOutcome::kMatched);
        expect_found(found.pose, truth);
      }
    }
  }
}

TEST_F(ScanMatcherTest, KnowsEveryDirectionInARoom) {
  const Pose truth{{120'000, 330'000}, BinaryAngle::from_degrees(31)};
  draw(kRoom, truth);
  const ScanMatch found = match(shifted(truth, 60'000, -60'000, 1), scan_from(kRoom, truth));
  ASSERT_EQ(found.outcome, MatchOutcome::kMatched);
  EXPECT_LT(found.covariance.xx, 0.01 * 0.01);
  EXPECT_LT(found.covariance.yy, 0.01 * 0.01);
  EXPECT_LT(found.covariance.tt, 0.005 * 0.005);
}

TEST_F(ScanMatcherTest, ABareCorridorSaysNothingAlongItself) {
  const Pose truth{{0, 0}, BinaryAngle::from_degrees(-12)};
  draw(kCorridor, truth);
  constexpr Symmetric3 kTwoCm{0.0004, 0, 0, 0.0004, 0, 0.0003};
  const Pose predicted = shifted(truth, 20'000, 20'000, 1);
  const ScanMatch found = match(predicted, scan_from(kCorridor, truth), kTwoCm);
  ASSERT_EQ(found.outcome, MatchOutcome::kMatched);
  EXPECT_NEAR(found.pose.position.x_um, predicted.position.x_um, 3'000) << "the odometry rules";
  EXPECT_NEAR(found.pose.position.y_um, truth.position.y_um, 10'000);
  EXPECT_NEAR((found.pose.heading - truth.heading).degrees(), 0, 0.2);
  EXPECT_GT(found.covariance.xx, 0.8 * kTwoCm.xx) << "and the estimate says so";
  EXPECT_LT(found.covariance.yy, 0.01 * 0.01);
}

TEST_F(ScanMatcherTest, AThinWallIsNotTakenForItsOtherSide) {
  // Seen from below first, then a scan from above: 4 cm apart, in the same row of cells.
  const std::vector<Wall> below{
      {-2, 1.005, 2, 1.005}, {-2, -1, 2, -1}, {-2, -1, -2, 1.005}, {2, -1, 2, 1.005}};
  const std::vector<Wall> above{
      {-2, 1.045, 2, 1.045}, {-2, 3, 2, 3}, {-2, 1.045, -2, 3}, {2, 1.045, 2, 3}};
  draw(below, {{0, 0}, BinaryAngle()});
  const Pose beyond{{0, 2'000'000}, BinaryAngle()};
  const ScanMatch found = match(beyond, scan_from(above, beyond));
  EXPECT_NEAR(found.pose.position.y_um, beyond.position.y_um, 2'000);
  EXPECT_EQ(found.outcome, MatchOutcome::kUnknownPlace) << "and contradicts nothing";
  EXPECT_GT(found.on_backs, 20);
}

TEST_F(ScanMatcherTest, AThirdOfWrongPointsDoesNotMislead) {
  const Pose truth{{120'000, 330'000}, BinaryAngle::from_degrees(31)};
  draw(kRoom, truth);
  const ScanMatch found = match(shifted(truth, 50'000, -70'000, -1.5), scan_from(kRoom, truth, 33));
  ASSERT_EQ(found.outcome, MatchOutcome::kMatched);
  EXPECT_NEAR(found.pose.position.x_um, truth.position.x_um, kCellUm / 4);
  EXPECT_NEAR(found.pose.position.y_um, truth.position.y_um, kCellUm / 4);
  EXPECT_NEAR((found.pose.heading - truth.heading).degrees(), 0, 0.2);
}

TEST_F(ScanMatcherTest, AKidnappedRobotGetsNoWrongPose) {
  const Pose drawn{{120'000, 330'000}, BinaryAngle::from_degrees(31)};
  draw(kRoom, drawn);
  const Pose now = shifted(drawn, 1'300'000, -900'000, 70);
  EXPECT_EQ(match(drawn, scan_from(kRoom, now)).outcome, MatchOutcome::kPoorFit);
}

TEST_F(ScanMatcherTest, AnUnsurePredictionIsSearchedAsFarAsItMayBeOff) {
  const Pose truth{{120'000, 330'000}, BinaryAngle::from_degrees(31)};
  draw(kRoom, truth);
  const Scan& scan = scan_from(kRoom, truth);
  const Pose far_off = shifted(truth, 430'000, -260'000, 14);
  EXPECT_EQ(match(far_off, scan).outcome, MatchOutcome::kPoorFit);
  const ScanMatch found = match(far_off, scan, kDoubt * 16);  // 40 cm, 12 degrees
  ASSERT_EQ(found.outcome, MatchOutcome::kMatched);
  expect_found(found.pose, truth);
}

// In the open, where little of the scan lies on what the map holds.
TEST_F(ScanMatcherTest, AFewWellFittingSamplesCorrectTheHeading) {
  const std::vector<Wall> post{{3, -0.35, 3, 0.35}};
  const std::vector<Wall> post_and_new{{3, -0.35, 3, 0.35}, {-7, -3, -7, 3}};
  const Pose truth{{0, 0}, BinaryAngle()};
  draw(post, truth);
  const ScanMatch found = match(shifted(truth, 0, 0, 2), scan_from(post_and_new, truth));
  EXPECT_LT(found.judged, 15);
  ASSERT_EQ(found.outcome, MatchOutcome::kMatched);
  EXPECT_NEAR((found.pose.heading - truth.heading).degrees(), 0, 1);
}

TEST_F(ScanMatcherTest, AnEmptyMapOrAnEmptyScanDecidesNothing) {
  const Pose pose{{0, 0}, BinaryAngle()};
  EXPECT_EQ(match(pose, scan_from(kRoom, pose)).outcome, MatchOutcome::kUnknownPlace);
  EXPECT_EQ(match(pose, Scan{}).outcome, MatchOutcome::kTooFewPoints);
}

// A wall 1 m ahead, at right angles to the view, seen by beams 10 mm apart.
void look_at_wall(Scan& scan, int range_mm) {
  scan.clear();
  for (int i = -20; i <= 20; ++i) {
    const double angle = std::atan2(i * 10.0, range_mm), range = std::hypot(i * 10.0, range_mm);
    (void)scan.push({BinaryAngle::from_radians(angle),
                     static_cast<std::uint16_t>(std::lround(range)), Echo::kHit, 40});
  }
}

TEST(SurfaceMap, RemembersTheMeanOfTheHitsInACell) {
  const auto cells = std::make_unique<MapStorage<64>>();
  ExplorationMap map(cells->layers(), kCellUm, 64, 100'000);
  const auto memory = std::make_unique<SurfaceStorage<64>>();
  SurfaceMap surfaces(memory->surface_entries);
  Scan scan;
  ScanSurfaces found;
  for (const int range_mm : {1010, 1030}) {  // the mean is 1.02 m
    look_at_wall(scan, range_mm);
    ScanFusion(FusionConfig{}).fuse(map, {}, scan, false);
    found.take(scan, 6'000'000, kCellUm);
    surfaces.learn(map, {}, scan, found, 6'000'000);
  }
  const SurfaceMap::Distance ahead = surfaces.distance(map, {1'000'000, 0}, -16384, 0, 128);
  EXPECT_GT(ahead.weight, 0);
  EXPECT_NEAR(ahead.um, -20'000, 1'000);
  EXPECT_EQ(surfaces.distance(map, {1'000'000, 0}, 16384, 0, 0).weight, 0) << "the other side";
  EXPECT_EQ(surfaces.distance(map, {700'000, 0}, -16384, 0, 128).weight, 0) << "no surface there";
}

TEST(ScanSurfaces, FindsNormalsTowardsTheRobot) {
  Scan scan;
  look_at_wall(scan, 1000);
  ScanSurfaces found;
  found.take(scan, 6'000'000, kCellUm);
  ASSERT_GE(found.samples().size(), 7u);
  for (const SurfaceSample& sample : found.samples()) {
    EXPECT_NEAR(sample.normal_x, -16384, 60);
    EXPECT_NEAR(sample.x_um, 1'000'000, 1'000);
  }
}

TEST(ScanSurfaces, SpacesSamplesWiderWhenThereAreTooMany) {
  Scan scan;
  for (int i = 0; i < 1000; ++i) {  // a circle of 6 m: 37 m around
    (void)scan.push({BinaryAngle(static_cast<std::uint16_t>(i * 65)), 6'000, Echo::kHit, 40});
  }
  ScanSurfaces found;
  found.take(scan, 8'000'000, 50'000);
  EXPECT_LE(found.samples().size(), ScanSurfaces::kMaxSamples);
  EXPECT_GT(found.samples().size(), ScanSurfaces::kMaxSamples / 2);
  found.take(scan, 5'000'000, 50'000);
  EXPECT_TRUE(found.samples().empty());
}

}  // namespace
}  // namespace ivfm
