#include "firmware/mapping/scan_fusion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

namespace ivfm {
namespace {

constexpr std::int32_t kCellUm = 50'000;

// A scan of `count` beams all around, all with the same reading.
Scan ring(int count, std::uint16_t range_mm, Echo echo) {
  Scan scan;
  for (int i = 0; i < count; ++i) {
    scan.push({BinaryAngle(static_cast<std::uint16_t>(i * 65536 / count)), range_mm, echo, 40});
  }
  return scan;
}

class ScanFusionTest : public ::testing::Test {
 protected:
  static FusionConfig sector(std::int32_t range_um) {
    FusionConfig config;
    config.footprint = VisitFootprint::sector(range_um, BinaryAngle(std::uint16_t{0x8000}));
    return config;
  }
  std::unique_ptr<MapStorage<128>> storage_ = std::make_unique<MapStorage<128>>();
  ExplorationMap map_{storage_->layers(), kCellUm, 128, 105'000};
  const Pose center_{{25'000, 25'000}, {}};
};

TEST_F(ScanFusionTest, BeamsClearTheirCellsAndEndOnObstacles) {
  ScanFusion fusion(sector(2'000'000));
  Scan scan;
  scan.push({BinaryAngle::from_degrees(0), 1000, Echo::kHit, 40});    // to x = 1.025 m
  scan.push({BinaryAngle::from_degrees(90), 500, Echo::kClear, 40});  // to y = 0.525 m
  scan.push({BinaryAngle::from_degrees(180), 0, Echo::kNothing, 0});
  (void)fusion.fuse(map_, center_, scan, true);
  EXPECT_TRUE(map_.is_obstacle({20, 0}));
  for (int x = 0; x < 20; ++x) EXPECT_TRUE(map_.is_known_free({x, 0})) << x;
  EXPECT_FALSE(map_.is_known_free({21, 0}));
  for (int y = 0; y < 10; ++y) EXPECT_TRUE(map_.is_known_free({0, y})) << y;
  EXPECT_FALSE(map_.is_obstacle({0, 10}));
  EXPECT_FALSE(map_.is_known_free({-1, 0}));
}

TEST_F(ScanFusionTest, AWallHitInThisScanIsNotClearedByItsOwnGrazingBeams) {
  ScanFusion fusion(sector(3'000'000));
  Scan scan;  // a wall at y = 0.5 m, seen at grazing angles
  for (int degrees = 10; degrees <= 170; ++degrees) {
    const double range = 0.5 / std::sin(degrees * 3.14159265 / 180);
    scan.push({BinaryAngle::from_degrees(degrees), static_cast<std::uint16_t>(range * 1000),
               Echo::kHit, 40});
  }
  for (int i = 0; i < 20; ++i) (void)fusion.fuse(map_, center_, scan, true);
  for (int x = -20; x <= 20; ++x) {
    EXPECT_TRUE(map_.is_obstacle({x, 10})) << x;
    EXPECT_FALSE(map_.is_obstacle({x, 8})) << x;
  }
}

class ChangingRoom : public ScanFusionTest {
 protected:
  ChangingRoom() {
    FusionConfig config = sector(2'000'000);
    config.doubt_changes = true;
    fusion_ = std::make_unique<ScanFusion>(config);
    look(2000, 8);
  }
  // So many revolutions that see something 20 cm wide straight ahead, and walls 2 m away.
  void look(std::uint16_t ahead_mm, int revolutions) {
    Scan scan = ring(720, 2000, Echo::kHit);
    for (std::size_t i = 0; i < scan.size; ++i) {
      const double aside_m =
          std::sin(scan.storage[i].bearing.radians()) * static_cast<double>(ahead_mm) * 1e-3;
      const bool in_front = std::abs(scan.storage[i].bearing.degrees()) < 90;
      if (in_front && std::abs(aside_m) < 0.1) scan.storage[i].range_mm = ahead_mm;
    }
    for (int i = 0; i < revolutions; ++i) (void)fusion_->fuse(map_, center_, scan, false);
  }
  int obstacles_near() const {
    int count = 0;
    for (std::int32_t y = -10; y <= 10; ++y) {
      for (std::int32_t x = 2; x <= 34; ++x) count += map_.is_obstacle({x, y}) ? 1 : 0;
    }
    return count;
  }
  std::unique_ptr<ScanFusion> fusion_;
};

TEST_F(ChangingRoom, WhoWalksByLeavesNoTrail) {
  ASSERT_EQ(obstacles_near(), 0);
  for (std::uint16_t ahead_mm = 1500; ahead_mm >= 500; ahead_mm -= 145) {  // 0.8 m/s
    look(ahead_mm, 1);
    EXPECT_EQ(obstacles_near(), 0) << ahead_mm;
  }
}

TEST_F(ChangingRoom, WhatStaysIsAnObstacleFromTheSecondRevolutionOnAndForgottenWhenItLeaves) {
  look(1000, 1);
  EXPECT_EQ(obstacles_near(), 0);
  look(1000, 1);
  EXPECT_GE(obstacles_near(), 4);
  EXPECT_TRUE(map_.is_obstacle({20, 0}));
  look(1000, 20);
  look(2000, 24);  // a door that opens: 4.4 s at the latest
  EXPECT_EQ(obstacles_near(), 0);
}

TEST_F(ScanFusionTest, AnotherRobotIsInTheWayForOneRevolutionAndNoEvidence) {
  ScanFusion fusion(sector(2'000'000));
  Scan scan;
  scan.push({BinaryAngle::from_degrees(0), 1000, Echo::kRobot, 40});     // to x = 1.025 m
  scan.push({BinaryAngle::from_degrees(90), 15'000, Echo::kRobot, 40});  // beyond what is mapped
  (void)fusion.fuse(map_, center_, scan, true);
  EXPECT_TRUE(map_.is_obstacle({20, 0}));
  EXPECT_TRUE(map_.is_blocked({18, 0}));
  for (int x = 0; x < 20; ++x) EXPECT_TRUE(map_.is_known_free({x, 0})) << x;
  std::uint8_t told = 255;
  ASSERT_EQ(map_.read_own(Layer::kObstacles, {20, 0, 1, 1}, {&told, 1}), Status::kOk);
  EXPECT_EQ(told, 0) << "not for the others";
  EXPECT_TRUE(map_.take_changes(Layer::kObstacles).empty());
  (void)fusion.fuse(map_, center_, ring(360, 3000, Echo::kClear), true);
  EXPECT_FALSE(map_.is_obstacle({20, 0}));
  EXPECT_FALSE(map_.is_blocked({18, 0}));
}

TEST_F(ScanFusionTest, TheFullCircleCountsEveryCellOnceWithoutGaps) {
  ScanFusion fusion(sector(1'000'000));
  const ViewStatistics seen = fusion.fuse(map_, center_, ring(360, 4000, Echo::kHit), true);
  // pi r^2 / cell^2 = 1,257 cells.
  EXPECT_NEAR(seen.newly_seen_cells, 1257, 25);
  for (int y = -25; y <= 25; ++y) {
    for (int x = -25; x <= 25; ++x) {
      const double distance = std::hypot(x, y) * 0.05;
      if (std::abs(distance - 1.0) < 0.02) continue;  // the rim may fall to either side
      EXPECT_EQ(map_.visits({x, y}), distance < 1.0 ? 1u : 0u) << x << ", " << y;
    }
  }
}

TEST_F(ScanFusionTest, VisitsCountOncePerActionOnTheUnionOfItsViews) {
  ScanFusion fusion(sector(1'000'000));
  const Scan scan = ring(360, 4000, Echo::kHit);
  fusion.begin_action(map_);
  (void)fusion.fuse(map_, center_, scan, true);
  const ViewStatistics again = fusion.fuse(map_, center_, scan, true);
  EXPECT_EQ(again.newly_seen_cells + again.re_seen_cells, 0u);
  EXPECT_EQ(map_.visits({3, 3}), 1u);
  fusion.begin_action(map_);
  const ViewStatistics next = fusion.fuse(map_, center_, scan, true);
  EXPECT_EQ(next.newly_seen_cells, 0u);
  EXPECT_GT(next.re_seen_cells, 1200u);
  // 2 sigma(1) - 1 = 0.46212 a cell.
  EXPECT_NEAR(static_cast<double>(next.re_seen_penalty_q12) / 4096 / next.re_seen_cells, 0.46212,
              1e-3);
  EXPECT_EQ(map_.visits({3, 3}), 2u);
}

TEST_F(ScanFusionTest, NothingIsSeenBehindAnObstacleButItsSurfaceIs) {
  ScanFusion fusion(sector(2'000'000));
  (void)fusion.fuse(map_, center_, ring(360, 1000, Echo::kHit), true);
  EXPECT_EQ(map_.visits({19, 0}), 1u);
  EXPECT_EQ(map_.visits({20, 0}), 1u) << "the surface";
  EXPECT_EQ(map_.visits({22, 0}), 0u);
}

TEST_F(ScanFusionTest, DirectionsWithoutAMeasurementAreNotSeen) {
  ScanFusion fusion(sector(1'000'000));
  Scan scan;
  for (int degrees = 0; degrees < 360; ++degrees) {
    const bool lost = degrees >= 80 && degrees <= 100;
    scan.push({BinaryAngle::from_degrees(degrees), 3000, lost ? Echo::kNothing : Echo::kHit, 40});
  }
  (void)fusion.fuse(map_, center_, scan, true);
  EXPECT_EQ(map_.visits({0, 15}), 0u);
  EXPECT_EQ(map_.visits({15, 0}), 1u);
}

TEST_F(ScanFusionTest, ThePapersCameraSeesATrapezoidOf0068SquareMetres) {
  auto storage = std::make_unique<MapStorage<128>>();
  ExplorationMap map(storage->layers(), 15'625, 128, 64'000);
  FusionConfig config;
  config.footprint = VisitFootprint::paper_camera();
  double total = 0;
  for (int degrees = 0; degrees < 360; degrees += 15) {
    map.clear({0, 0});
    ScanFusion fusion(config);
    const Pose pose{{3'000, -2'000}, BinaryAngle::from_degrees(degrees)};
    total += fusion.fuse(map, pose, ring(720, 1000, Echo::kClear), true).newly_seen_cells;
  }
  // Integral of 2 * 1.026 (0.866 x + 0.035) dx from 0.040 to 0.245 m = 0.0667 m^2.
  EXPECT_NEAR(total / 24 * 0.015625 * 0.015625, 0.0667, 0.0007);
}

TEST_F(ScanFusionTest, HeadingTurnsTheFootprint) {
  FusionConfig config;
  config.footprint = VisitFootprint::sector(1'000'000, BinaryAngle::from_degrees(45));
  ScanFusion fusion(config);
  const Pose facing_north{center_.position, BinaryAngle::from_degrees(90)};
  (void)fusion.fuse(map_, facing_north, ring(360, 3000, Echo::kHit), true);
  EXPECT_EQ(map_.visits({0, 10}), 1u);
  EXPECT_EQ(map_.visits({10, 0}), 0u);
  EXPECT_EQ(map_.visits({0, -10}), 0u);
}

TEST_F(ScanFusionTest, ScansAtTheWindowsEdgeStayInside) {
  ScanFusion fusion(sector(3'000'000));
  const Pose corner{{-3'190'000, -3'190'000}, {}};
  const ViewStatistics seen = fusion.fuse(map_, corner, ring(360, 12000, Echo::kHit), true);
  EXPECT_GT(seen.newly_seen_cells, 1000u);
}

}  // namespace
}  // namespace ivfm
