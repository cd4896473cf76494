#include "firmware/localization/localization.h"

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
constexpr TimeUs kRevolutionUs = 180'000;

// A robot that stands while its surroundings change, and does with each revolution what the agent
// does.
class StandingRobot : public testing::Test {
 protected:
  StandingRobot() {
    map_.clear(map_.frame().cell_at({}));
    localization_.reset({});
  }
  void look(const std::vector<Wall>& walls, int revolutions = 1) {
    for (int i = 0; i < revolutions; ++i) {
      now_us_ += kRevolutionUs;
      ASSERT_EQ(localization_.add_wheels(0, 0, now_us_), Status::kOk);
      (void)localization_.correct(map_, scan_of(walls), now_us_);
      if (!localization_.trusted()) continue;
      ++painted_;
      fusion_.fuse(map_, localization_.pose(), scan_, false);
      localization_.learn(map_, scan_, now_us_);
    }
  }
  static LocalizationConfig matching() {
    LocalizationConfig config;
    config.matching = true;
    return config;
  }
  const Scan& scan_of(const std::vector<Wall>& walls) {
    scan_.clear();
    for (int i = 0; i < 400; ++i) {
      const BinaryAngle bearing(static_cast<std::uint16_t>(i * 65536 / 400));
      const double range_m = cast_m(walls, 0, 0, bearing.radians());
      const auto range_mm = static_cast<std::uint16_t>(std::lround(range_m * 1000));
      (void)scan_.push({bearing, range_mm, range_mm > 0 ? Echo::kHit : Echo::kNothing, 40});
    }
    return scan_;
  }

  std::unique_ptr<MapStorage<kWindowCells>> cells_ = std::make_unique<MapStorage<kWindowCells>>();
  std::unique_ptr<SurfaceStorage<2048>> surface_cells_ = std::make_unique<SurfaceStorage<2048>>();
  ExplorationMap map_{cells_->layers(), kCellUm, kWindowCells, 100'000};
  ScanFusion fusion_{FusionConfig{}};
  Localization localization_{matching(), surface_cells_->surface_entries, {}, 1'000'000};
  Scan scan_;
  TimeUs now_us_ = 0;
  int painted_ = 0;
};

const std::vector<Wall> kRoomTurned{{-1.5, -3, -1.5, 2},
                                    {-1.5, 2, 2.5, 2},
                                    {2.5, 2, 2.5, -3},
                                    {2.5, -3, -1.5, -3},
                                    {0.8, -1, 0.8, -1.7}};

TEST_F(StandingRobot, PaintsNothingThatContradictsItsMapAndIsSoonLost) {
  look(kRoom, 12);
  ASSERT_EQ(painted_, 12);
  look(kRoomTurned, 4);
  EXPECT_EQ(painted_, 12);
  EXPECT_TRUE(localization_.lost());
}

// A fit by chance between contradictions proves nothing.
TEST_F(StandingRobot, IsLostThoughARevolutionFitsNowAndThen) {
  look(kRoom, 12);
  for (int i = 0; i < 6 && !localization_.lost(); ++i) {
    look(kRoomTurned);
    look(kRoom);
  }
  EXPECT_TRUE(localization_.lost());
  EXPECT_EQ(painted_, 12);
}

// kRoom when a gate has opened to a hall: two fifths of what is seen lie where nothing is known.
const std::vector<Wall> kGateOpen{{-2, -1.5, 3, -1.5}, {3, -1.5, 3, -4},   {3, -4, 5.5, -4},
                                  {5.5, -4, 5.5, 4.5}, {5.5, 4.5, 3, 4.5}, {3, 4.5, 3, 2.5},
                                  {3, 2.5, -2, 2.5},   {-2, 2.5, -2, -1.5}};

TEST_F(StandingRobot, DoubtsThenLooksAroundWhereMuchIsNewAndPaintsOnAsItHasNotMoved) {
  look(kRoom, 12);
  look(kGateOpen);
  EXPECT_EQ(localization_.last_match().outcome, MatchOutcome::kMatched);
  EXPECT_FALSE(localization_.trusted());
  look(kGateOpen, 11);
  EXPECT_TRUE(localization_.lost());
  EXPECT_EQ(painted_, 12);
  look(kGateOpen, 50);
  EXPECT_TRUE(localization_.trusted());
  EXPECT_GT(painted_, 12);
}

TEST_F(StandingRobot, WithALidarThatDoesNotSeeAllAroundDoubtsNothingThatIsNew) {
  LocalizationConfig config = matching();
  config.sees_all_around = false;
  localization_ = {config, surface_cells_->surface_entries, {}, 1'000'000};
  localization_.reset({});
  look(kRoom, 12);
  look(kGateOpen);
  EXPECT_EQ(painted_, 13);
}

TEST_F(StandingRobot, PaintsOnOnceTheMapFitsAgain) {
  look(kRoom, 12);
  look(kRoomTurned);
  EXPECT_FALSE(localization_.trusted());
  look(kRoom, 4);
  EXPECT_TRUE(localization_.trusted());
  EXPECT_FALSE(localization_.lost());
}

// Otherwise a robot would never again see anything new in the open.
TEST_F(StandingRobot, DoubtWearsOffWhereNothingCanBeJudged) {
  look(kRoom, 12);
  look(kRoomTurned);
  EXPECT_FALSE(localization_.trusted());
  look({}, 20);
  EXPECT_FALSE(localization_.trusted());
  look({}, 40);
  EXPECT_TRUE(localization_.trusted());
}

// In the open a short wall and thin posts that face nowhere: a dozen points to go by.
std::vector<Wall> wall_and_posts() {
  std::vector<Wall> walls{{1, -0.3, 1, 0.3}};
  for (int i = 2; i < 18; ++i) {
    const double angle = i * 0.35, x = 2 * std::cos(angle), y = 2 * std::sin(angle);
    walls.push_back({x - 0.03, y - 0.03, x + 0.03, y + 0.03});
  }
  return walls;
}

TEST_F(StandingRobot, WhereFewPointsFitEachTakesItsShareOfTheDoubt) {
  look(wall_and_posts(), 12);
  look(kRoomTurned, 2);
  look(wall_and_posts(), 3);
  ASSERT_EQ(localization_.last_match().outcome, MatchOutcome::kMatched);
  ASSERT_LT(localization_.last_match().could_fit(), 20);
  EXPECT_FALSE(localization_.trusted());
  look(wall_and_posts(), 2);
  EXPECT_TRUE(localization_.trusted());
}

}  // namespace
}  // namespace ivfm
