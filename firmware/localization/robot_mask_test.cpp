#include "firmware/localization/robot_mask.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace ivfm {
namespace {

constexpr TimeUs kNow = 10'000'000;
// Looks west from (1 m, 2 m): what it sees straight ahead at 1 m is at (0, 2 m).
const Pose kPose{{1'000'000, 2'000'000}, BinaryAngle::from_degrees(180)};

class RobotMask : public testing::Test {
 protected:
  // What a hit at (x, y) in the map frame becomes when a robot told so long ago that it is in the
  // origin.
  Echo echo_at(std::int32_t x_um, std::int32_t y_um, TimeUs age_us, Echo echo = Echo::kHit) {
    const double dx = x_um - kPose.position.x_um, dy = y_um - kPose.position.y_um;
    const BinaryAngle bearing = BinaryAngle::from_radians(std::atan2(dy, dx)) - kPose.heading;
    Scan scan;
    scan.push({bearing, static_cast<std::uint16_t>(std::hypot(dx, dy) / 1000), echo, 40});
    const std::array peers{PeerRobot{{-2'000'000, 0}, kNow}, PeerRobot{{0, 0}, kNow - age_us}};
    mark_robots(config_, peers, kPose, kNow, scan);
    return scan.storage[0].echo;
  }
  RobotMaskConfig config_{100'000, 150'000, 200'000, 400'000};
};

TEST_F(RobotMask, HitsWhereARobotIsAreMarked) {
  EXPECT_EQ(echo_at(100'000, 0, 0), Echo::kRobot);
  EXPECT_EQ(echo_at(0, 240'000, 0), Echo::kRobot);
  EXPECT_EQ(echo_at(0, 260'000, 0), Echo::kHit);
  EXPECT_EQ(echo_at(-190'000, 190'000, 0), Echo::kHit);  // in the square, not in the disc
  EXPECT_EQ(echo_at(-1'900'000, 0, 0), Echo::kRobot);    // the other one
}

TEST_F(RobotMask, ItMayHaveDrivenSinceItTold) {
  EXPECT_EQ(echo_at(0, 440'000, 1'000'000), Echo::kRobot);
  EXPECT_EQ(echo_at(0, 460'000, 1'000'000), Echo::kHit);
}

TEST_F(RobotMask, AnOldPlaceSaysNothing) {
  EXPECT_EQ(echo_at(0, 0, 2'000'000), Echo::kRobot);
  EXPECT_EQ(echo_at(0, 0, 2'010'000), Echo::kHit);
  EXPECT_EQ(echo_at(0, 0, kNow), Echo::kHit);
}

TEST_F(RobotMask, OnlyHitsAreMarked) {
  EXPECT_EQ(echo_at(0, 0, 0, Echo::kClear), Echo::kClear);
  EXPECT_EQ(echo_at(0, 0, 0, Echo::kNothing), Echo::kNothing);
}

TEST_F(RobotMask, PlacesAtTheEdgeOfTheWorldDoNoHarm) {
  Scan scan;
  scan.push({{}, 1000, Echo::kHit, 40});
  const std::array peers{PeerRobot{{INT32_MIN, INT32_MAX}, kNow}};
  mark_robots(config_, peers, kPose, kNow, scan);
  EXPECT_EQ(scan.storage[0].echo, Echo::kHit);
}

}  // namespace
}  // namespace ivfm
