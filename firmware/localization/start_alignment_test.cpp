#include "firmware/localization/start_alignment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "firmware/mapping/scan_fusion.h"
#include "tests/support/drawn_walls.h"

namespace ivfm {
namespace {

constexpr std::int32_t kCellUm = 50'000;
constexpr std::int32_t kWindowCells = 256;

const Pose kTruth{{-300'000, 200'000}, BinaryAngle::from_degrees(20)};

class StartAlignmentTest : public testing::Test {
 protected:
  const Scan& scan_from(const std::vector<Wall>& walls, const Pose& pose) {
    scan_.clear();
    for (int i = 0; i < 400; ++i) {
      const BinaryAngle bearing(static_cast<std::uint16_t>(i * 65536 / 400));
      const auto range_mm = static_cast<std::uint16_t>(
          std::lround(1000 * cast_m(walls, pose.position.x_um * 1e-6, pose.position.y_um * 1e-6,
                                    (pose.heading + bearing).radians())));
      (void)scan_.push({bearing, range_mm, range_mm > 0 ? Echo::kHit : Echo::kNothing, 40});
    }
    return scan_;
  }
  // Another robot has looked around in two places and told what it saw.
  void others_saw(const std::vector<Wall>& walls) {
    auto cells = std::make_unique<MapStorage<kWindowCells>>();
    ExplorationMap theirs(cells->layers(), kCellUm, kWindowCells, 100'000);
    ScanFusion fusion{FusionConfig{}};
    for (const Pose& pose : {Pose{{700'000, -400'000}, {}}, Pose{{-900'000, 300'000}, {}}}) {
      for (int i = 0; i < 3; ++i) fusion.fuse(theirs, pose, scan_from(walls, pose), false);
    }
    const CellRect all = theirs.frame().window();
    std::vector<std::uint8_t> obstacles(static_cast<std::size_t>(all.area()));
    ASSERT_EQ(theirs.read_own(Layer::kObstacles, all, obstacles), Status::kOk);
    ASSERT_EQ(map_.write_peers(Layer::kObstacles, all, obstacles), Status::kOk);
  }
  // What a robot at kTruth that was told `guess` finds out.
  StartAlignment::Result align(const std::vector<Wall>& walls, const Pose& guess) {
    surfaces_.take(scan_from(walls, kTruth), 8'000'000, kCellUm);
    alignment_.begin(guess);
    auto result = StartAlignment::Result::kSearching;
    for (int i = 0; i < 100 && result == StartAlignment::Result::kSearching; ++i) {
      result = alignment_.step(map_, surfaces_.samples(), guess);
    }
    return result;
  }
  static Pose off(double x_m, double y_m, double degrees) {
    return {{kTruth.position.x_um + static_cast<std::int32_t>(x_m * 1e6),
             kTruth.position.y_um + static_cast<std::int32_t>(y_m * 1e6)},
            kTruth.heading + BinaryAngle::from_degrees(degrees)};
  }

  std::unique_ptr<MapStorage<kWindowCells>> cells_ = std::make_unique<MapStorage<kWindowCells>>();
  ExplorationMap map_{cells_->layers(), kCellUm, kWindowCells, 100'000};
  ScanSurfaces surfaces_;
  Scan scan_{};
  StartAlignment alignment_;
};

TEST_F(StartAlignmentTest, FindsThePlaceWhereOthersHaveBeen) {
  others_saw(kRoom);
  for (const Pose& guess : {off(0, 0, 0), off(0.35, 0.35, 15), off(-0.48, 0.1, -14.5),
                            off(0.2, -0.45, 7.3), off(-0.3, -0.4, -9)}) {
    ASSERT_EQ(align(kRoom, guess), StartAlignment::Result::kFound);
    const Pose found = compose(alignment_.correction(), guess);
    EXPECT_NEAR(found.position.x_um, kTruth.position.x_um, 40'000);
    EXPECT_NEAR(found.position.y_um, kTruth.position.y_um, 40'000);
    EXPECT_NEAR((found.heading - kTruth.heading).degrees(), 0, 0.8);
  }
}

// The robot was told to start 6 m west of where it is now: a wrong heading has put it 1 m aside.
TEST_F(StartAlignmentTest, FindsLaterWhereTheStartWas) {
  others_saw(kRoom);
  const Pose true_start{{kTruth.position.x_um - 6'000'000, kTruth.position.y_um}, {}};
  const Pose told_start{{true_start.position.x_um + 200'000, true_start.position.y_um - 300'000},
                        BinaryAngle::from_degrees(-10)};
  const Pose believed = compose(told_start, relative_pose(true_start, kTruth));
  ASSERT_GT(std::abs(believed.position.y_um - kTruth.position.y_um), 1'000'000);
  surfaces_.take(scan_from(kRoom, kTruth), 8'000'000, kCellUm);
  alignment_.begin(told_start);
  auto result = StartAlignment::Result::kSearching;
  for (int i = 0; i < 17; ++i) result = alignment_.step(map_, surfaces_.samples(), believed);
  ASSERT_EQ(result, StartAlignment::Result::kFound);
  EXPECT_EQ(alignment_.seen_from(), believed);
  const Pose found = compose(alignment_.correction(), believed);
  EXPECT_NEAR(found.position.x_um, kTruth.position.x_um, 40'000);
  EXPECT_NEAR(found.position.y_um, kTruth.position.y_um, 40'000);
  EXPECT_NEAR((found.heading - kTruth.heading).degrees(), 0, 0.8);
}

TEST_F(StartAlignmentTest, FindsNothingWhereNobodyHasBeen) {
  EXPECT_EQ(align(kRoom, off(0.2, 0.1, 5)), StartAlignment::Result::kNotFound);
}

TEST_F(StartAlignmentTest, FindsNothingWhereThePlaceIsOpen) {
  others_saw(kCorridor);
  EXPECT_EQ(align(kCorridor, off(0.2, 0.1, 5)), StartAlignment::Result::kNotFound);
}

}  // namespace
}  // namespace ivfm
