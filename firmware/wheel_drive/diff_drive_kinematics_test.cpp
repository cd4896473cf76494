#include "firmware/wheel_drive/diff_drive_kinematics.h"

#include <gtest/gtest.h>

#include <limits>

namespace ivfm {
namespace {

// 0.2 m track, 0.25 m circumference, 1000 counts a turn: 4 counts a millimetre.
const DiffDriveKinematics kDrive({200'000, 250'000, 1'000}, 500'000);

TEST(DiffDriveKinematics, StraightTurnsBothWheelsAlike) {
  EXPECT_EQ(kDrive.wheel_speeds({100'000, 0}), (WheelSpeeds{400, 400}));
  EXPECT_EQ(kDrive.wheel_speeds({-100'000, 0}), (WheelSpeeds{-400, -400}));
}

TEST(DiffDriveKinematics, CounterClockwiseTurnsTheRightWheelForward) {
  // 1 rad/s on 0.1 m: 0.1 m/s at each wheel.
  EXPECT_EQ(kDrive.wheel_speeds({0, 1'000}), (WheelSpeeds{-400, 400}));
  EXPECT_EQ(kDrive.wheel_speeds({100'000, 1'000}), (WheelSpeeds{0, 800}));
}

TEST(DiffDriveKinematics, TooFastKeepsTheCurve) {
  // 0.5 m/s and 2 rad/s want 0.3 and 0.7 m/s; scaled by 5/7.
  EXPECT_EQ(kDrive.wheel_speeds({500'000, 2'000}), (WheelSpeeds{857, 2'000}));
  EXPECT_EQ(kDrive.wheel_speeds({0, -100'000}), (WheelSpeeds{2'000, -2'000}));
}

TEST(DiffDriveKinematics, MeasuredSpeedsGiveTheBodysVelocity) {
  EXPECT_EQ(kDrive.body_velocity({400, 400}), (Velocity{100'000, 0}));
  EXPECT_EQ(kDrive.body_velocity({-400, 400}), (Velocity{0, 1'000}));
  EXPECT_EQ(kDrive.body_velocity({0, 800}), (Velocity{100'000, 1'000}));
}

TEST(DiffDriveKinematics, ExtremeInputsSaturate) {
  constexpr std::int32_t kMax = std::numeric_limits<std::int32_t>::max();
  constexpr std::int32_t kMin = std::numeric_limits<std::int32_t>::min();
  const DiffDriveKinematics big({10'000'000, 10'000'000, kMax}, 10'000'000);
  for (const std::int32_t v : {kMin, -1, 0, 1, kMax}) {
    for (const std::int32_t omega : {kMin, -1, 0, 1, kMax}) {
      const WheelSpeeds speeds = kDrive.wheel_speeds({v, omega});
      EXPECT_LE(std::abs(speeds.left), 2'000);
      EXPECT_LE(std::abs(speeds.right), 2'000);
      (void)big.wheel_speeds({v, omega});
      (void)big.body_velocity({v, omega});
      (void)kDrive.body_velocity({v, omega});
    }
  }
}

}  // namespace
}  // namespace ivfm
