#include "firmware/localization/odometry.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace ivfm {
namespace {

// 4 counts a millimetre, 0.2 m track.
constexpr WheelGeometry kBase{200'000, 250'000, 1'000};
constexpr TimeUs kPeriodUs = 20'000;

class OdometryTest : public testing::Test {
 protected:
  // Moves the wheels by `left` and `right` counts within one period.
  Status roll(std::int32_t left, std::int32_t right) {
    left_ = static_cast<std::int32_t>(static_cast<std::uint32_t>(left_) + left);
    right_ = static_cast<std::int32_t>(static_cast<std::uint32_t>(right_) + right);
    now_us_ += kPeriodUs;
    return odometry_.update(left_, right_, now_us_);
  }
  void start(const Pose& pose, std::int32_t left = 0, std::int32_t right = 0) {
    odometry_.reset(pose);
    left_ = left;
    right_ = right;
    EXPECT_EQ(roll(0, 0), Status::kOk);
  }

  Odometry odometry_{kBase, 500'000};  // 40 counts a period at full speed, 16 of slack
  std::int32_t left_ = 0;
  std::int32_t right_ = 0;
  TimeUs now_us_ = 0;
};

TEST_F(OdometryTest, StraightOnFollowsTheHeading) {
  start({{1'000, 2'000}, BinaryAngle::from_degrees(90)});
  for (int i = 0; i < 100; ++i) EXPECT_EQ(roll(40, 40), Status::kOk);  // 1 m
  EXPECT_NEAR(odometry_.pose().position.x_um, 1'000, 2);
  EXPECT_NEAR(odometry_.pose().position.y_um, 1'002'000, 2);
  EXPECT_EQ(odometry_.pose().heading, BinaryAngle::from_degrees(90));
  EXPECT_EQ(odometry_.travelled_um(), 1'000'000u);
}

TEST_F(OdometryTest, BackwardCountsAsTravelToo) {
  start({});
  roll(-40, -40);
  EXPECT_EQ(odometry_.pose().position, (Point{-10'000, 0}));
  EXPECT_EQ(odometry_.travelled_um(), 10'000u);
}

// A turn on the spot: each wheel rolls pi * 0.1 m * 4 counts/mm = 1256.6 counts for half a turn.
TEST_F(OdometryTest, TurnsOnTheSpotWithoutPilingUpRounding) {
  start({});
  for (int turn = 1; turn <= 500; ++turn) {
    for (int i = 0; i < 100; ++i) roll(-25, 25);
  }
  const double turned_rad = 500.0 * 100 * 50 * 0.25 / 200;  // (right - left) in mm over the track
  const auto expected = BinaryAngle::from_radians(std::fmod(turned_rad, 2 * M_PI));
  EXPECT_NEAR((odometry_.pose().heading - expected).signed_raw(), 0, 6);  // 3,125 rad; 355/113
  EXPECT_EQ(odometry_.pose().position, Point{});
}

// A circle of radius 0.5 m: the wheels on 0.4 and 0.6 m, ratio 2:3.
TEST_F(OdometryTest, ACircleComesBackToItsStart) {
  start({});
  const double steps = 2 * M_PI * 500 * 4 / 25;  // 25 counts of the middle a step: 502.65
  for (int i = 0; i < 503; ++i) EXPECT_EQ(roll(20, 30), Status::kOk);
  const double rest_um = (503 - steps) * 25 * 250;
  EXPECT_NEAR(odometry_.pose().position.x_um, rest_um, 200);
  EXPECT_NEAR(odometry_.pose().position.y_um, 0, 200);
}

TEST_F(OdometryTest, CountersWrapAround) {
  constexpr std::int32_t kMax = std::numeric_limits<std::int32_t>::max();
  start({}, kMax - 10, kMax - 10);
  EXPECT_EQ(roll(40, 40), Status::kOk);
  EXPECT_LT(left_, 0);
  EXPECT_EQ(odometry_.pose().position, (Point{10'000, 0}));
}

TEST_F(OdometryTest, RefusesAJumpAndIgnoresASingleGlitch) {
  start({});
  roll(40, 40);
  EXPECT_EQ(odometry_.update(left_ + 100'000, right_, now_us_ += kPeriodUs), Status::kRefused);
  EXPECT_EQ(odometry_.jumps(), 1u);
  EXPECT_EQ(odometry_.pose().position, (Point{10'000, 0}));
  EXPECT_EQ(roll(40, 40), Status::kOk);
  EXPECT_EQ(odometry_.pose().position, (Point{20'000, 0}));
}

TEST_F(OdometryTest, GoesOnFromTheNewCountsOfARestartedDrive) {
  start({}, 1'000'000, 1'000'000);
  roll(40, 40);
  left_ = right_ = 0;  // the drives lost their counts
  EXPECT_EQ(roll(0, 0), Status::kRefused);
  EXPECT_EQ(roll(40, 40), Status::kOk);
  EXPECT_EQ(odometry_.pose().position, (Point{20'000, 0}));
  EXPECT_EQ(odometry_.jumps(), 1u);
}

TEST_F(OdometryTest, ALongPauseAllowsALongWay) {
  start({});
  now_us_ += 180'000;  // 0.2 s at 0.5 m/s: 400 counts
  EXPECT_EQ(roll(400, 400), Status::kOk);
  EXPECT_EQ(odometry_.pose().position, (Point{100'000, 0}));
}

TEST_F(OdometryTest, OldMeasurementsAreLeftOut) {
  start({});
  roll(40, 40);
  EXPECT_EQ(odometry_.update(left_ + 4, right_ + 4, now_us_), Status::kEmpty);
  EXPECT_EQ(odometry_.pose().position, (Point{10'000, 0}));
}

TEST_F(OdometryTest, RandomCountersNeverMoveFasterThanPossible) {
  start({});
  std::uint32_t seed = 5;
  const auto random = [&seed] { return static_cast<std::int32_t>(seed = seed * 1664525u + 1u); };
  for (int i = 0; i < 10'000; ++i) {
    const Point before = odometry_.pose().position;
    (void)odometry_.update(random(), random(), now_us_ += kPeriodUs);
    EXPECT_LE(squared_distance_um2(before, odometry_.pose().position), 140'000ll * 140'000ll);
  }
}

}  // namespace
}  // namespace ivfm
