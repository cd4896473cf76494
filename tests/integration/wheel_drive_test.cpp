// The wheel drive against two emulated CiA 402 drives on a CAN wire in memory, in simulated time.
#include "firmware/wheel_drive/wheel_drive.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "firmware/hal/fake/fake_can_bus.h"
#include "host/simulator/cia402_emulator.h"

namespace ivfm {
namespace {

using cia402::State;

constexpr TimeUs kStepUs = 1'000;

class WheelDriveOnTheBus : public testing::Test {
 protected:
  WheelDriveOnTheBus() { wheels_.emplace(config_, wire_.end(0)); }

  // Runs both sides for `duration_us`, 1 ms at a time; the setpoint is renewed as an agent does.
  void run(TimeUs duration_us) {
    for (const TimeUs end = now_us_ + duration_us; now_us_ < end;) {
      now_us_ += kStepUs;
      wire_.advance_to(now_us_);
      drives_.step(now_us_);
      if (renew_ && wheels_) wheels_->set_velocity(setpoint_);
      if (wheels_) wheels_->step(now_us_);
    }
  }
  // Steps until `condition` holds; the time it took, or `limit_us` if it never did.
  template <typename Condition>
  TimeUs run_until(Condition condition, TimeUs limit_us) {
    const TimeUs start_us = now_us_;
    while (!condition() && now_us_ - start_us < limit_us) run(kStepUs);
    return now_us_ - start_us;
  }
  void boot() {
    ASSERT_LT(run_until([&] { return wheels_->enabled(now_us_); }, 3'000'000), 1'000'000u);
  }
  void drive(const Velocity& velocity) {
    setpoint_ = velocity;
    renew_ = true;
  }

  WheelDriveConfig config_;
  fake::FakeCanWire<2> wire_;
  host::Cia402Emulator left_{{.node_id = 1}};
  host::Cia402Emulator right_{{.node_id = 2}};
  host::DriveGroup drives_{wire_.end(1), {&left_, &right_}};
  std::optional<WheelDrive> wheels_;
  Velocity setpoint_;
  bool renew_ = false;
  TimeUs now_us_ = 5'000'000;
};

// 0.2 m/s with 207,345 um and 4096 counts a turn: 3950.9 counts/s.
constexpr Velocity kStraight{.v_um_s = 200'000, .omega_mrad_s = 0};
constexpr double kStraightCounts = 3'951;

TEST_F(WheelDriveOnTheBus, BootsConfiguresAndEnablesBothDrives) {
  EXPECT_FALSE(wheels_->healthy(now_us_));
  boot();
  EXPECT_TRUE(wheels_->healthy(now_us_));
  EXPECT_EQ(left_.state(), State::kOperationEnabled);
  EXPECT_EQ(right_.state(), State::kOperationEnabled);
  EXPECT_EQ(left_.counters().sdo_aborts, 2u) << "only the third and fourth TPDO do not exist";
  EXPECT_EQ(left_.object({0x6060, 0}), 3u);
  EXPECT_EQ(left_.object({0x1016, 1}), 0x007f0096u);
  EXPECT_EQ(left_.object({0x1017, 0}), 100u);
  EXPECT_EQ(left_.object({0x1400, 1}), 0x201u);
  EXPECT_EQ(right_.object({0x1801, 1}), 0x40000282u);
  EXPECT_EQ(wheels_->drive(WheelDrive::kLeft).counters().configurations, 1u);
  EXPECT_EQ(wheels_->counters().frames_ignored, 0u);
  EXPECT_DOUBLE_EQ(left_.wheel_speed(), 0);
}

TEST_F(WheelDriveOnTheBus, FollowsAVelocityAndReportsPositions) {
  boot();
  drive(kStraight);
  run(1'000'000);
  EXPECT_NEAR(left_.wheel_speed(), kStraightCounts, 1);
  EXPECT_NEAR(right_.wheel_speed(), kStraightCounts, 1);
  const WheelDrive::Positions& positions = wheels_->positions();
  ASSERT_TRUE(positions.valid);
  EXPECT_LE(wheels_->positions_age_us(now_us_), 25'000u);
  EXPECT_NEAR(positions.left, left_.encoder_position(), 100);
  EXPECT_NEAR(positions.right, right_.encoder_position(), 100);
  EXPECT_NEAR(wheels_->measured_velocity().v_um_s, 200'000, 200);
}

TEST_F(WheelDriveOnTheBus, TurnsCounterClockwiseWithTheRightWheelForward) {
  boot();
  drive({.v_um_s = 0, .omega_mrad_s = 1'000});  // 1 rad/s, track 0.16 m: +-0.08 m/s
  run(1'000'000);
  EXPECT_NEAR(right_.wheel_speed(), 1'580.4, 1);
  EXPECT_NEAR(left_.wheel_speed(), -1'580.4, 1);
}

TEST_F(WheelDriveOnTheBus, AReversedWheelRollsTheSameWay) {
  config_.right_reversed = true;
  wheels_.emplace(config_, wire_.end(0));
  boot();
  drive(kStraight);
  run(1'000'000);
  EXPECT_NEAR(left_.wheel_speed(), kStraightCounts, 1);
  EXPECT_NEAR(right_.wheel_speed(), -kStraightCounts, 1);
  EXPECT_NEAR(wheels_->positions().right, wheels_->positions().left, 100);
}

TEST_F(WheelDriveOnTheBus, ASetpointThatIsNotRenewedEnds) {
  boot();
  drive(kStraight);
  run(500'000);
  renew_ = false;
  run(600'000);
  EXPECT_DOUBLE_EQ(left_.wheel_speed(), 0);
  EXPECT_EQ(left_.state(), State::kOperationEnabled);
}

TEST_F(WheelDriveOnTheBus, QuickStopBrakesBothAndTheNextVelocityReleasesIt) {
  boot();
  drive(kStraight);
  run(500'000);
  renew_ = false;
  wheels_->quick_stop();
  run(2'000);
  EXPECT_EQ(left_.state(), State::kQuickStopActive);
  EXPECT_EQ(right_.state(), State::kQuickStopActive);
  run(100'000);
  EXPECT_DOUBLE_EQ(left_.wheel_speed(), 0);
  EXPECT_EQ(left_.state(), State::kSwitchOnDisabled);
  run(500'000);
  EXPECT_EQ(left_.state(), State::kSwitchOnDisabled) << "a quick stop holds";
  EXPECT_TRUE(wheels_->healthy(now_us_));
  drive(kStraight);
  run(600'000);
  EXPECT_NEAR(left_.wheel_speed(), kStraightCounts, 1);
}

TEST_F(WheelDriveOnTheBus, ALostDriveStopsTheOtherWithin100Ms) {
  boot();
  drive(kStraight);
  run(500'000);
  left_.set_silent(true);
  const TimeUs reaction =
      run_until([&] { return right_.state() == State::kQuickStopActive; }, 1'000'000);
  EXPECT_LE(reaction, 100'000u);
  EXPECT_FALSE(wheels_->healthy(now_us_));
  run(60'000);
  EXPECT_DOUBLE_EQ(right_.wheel_speed(), 0);
  EXPECT_EQ(wheels_->counters().common_stops, 1u);
}

TEST_F(WheelDriveOnTheBus, ALostDriveStopsByItselfAndBothComeBackByThemselves) {
  boot();
  drive(kStraight);
  run(500'000);
  left_.set_silent(true);
  run(2'000'000);
  EXPECT_DOUBLE_EQ(left_.wheel_speed(), 0) << "its heartbeat consumer stopped it";
  EXPECT_EQ(left_.counters().heartbeat_losses, 1u);
  EXPECT_EQ(wheels_->drive(WheelDrive::kLeft).counters().losses, 1u);
  left_.set_silent(false);
  run(4'500'000);
  EXPECT_TRUE(wheels_->enabled(now_us_));
  EXPECT_NEAR(left_.wheel_speed(), kStraightCounts, 1);
  EXPECT_NEAR(right_.wheel_speed(), kStraightCounts, 1);
}

TEST_F(WheelDriveOnTheBus, AFaultStopsTheOtherAndIsResetAfterAPause) {
  boot();
  drive(kStraight);
  run(500'000);
  right_.raise_fault(0x2310);
  const TimeUs reaction =
      run_until([&] { return left_.state() == State::kQuickStopActive; }, 1'000'000);
  EXPECT_LE(reaction, 100'000u);
  const TimeUs recovery = run_until([&] { return wheels_->enabled(now_us_); }, 5'000'000);
  EXPECT_GE(recovery + reaction, 100'000u) << "not before the back-off";
  EXPECT_LE(recovery, 1'000'000u);
  EXPECT_EQ(wheels_->drive(WheelDrive::kRight).counters().faults, 1u);
  EXPECT_EQ(wheels_->drive(WheelDrive::kRight).counters().fault_resets, 1u);
  EXPECT_EQ(wheels_->drive(WheelDrive::kRight).node().counters().emergencies, 1u);
  run(600'000);
  EXPECT_NEAR(left_.wheel_speed(), kStraightCounts, 1);
}

TEST_F(WheelDriveOnTheBus, RepeatedFaultsAreResetLessAndLessOften) {
  boot();
  for (TimeUs end = now_us_ + 20'000'000; now_us_ < end;) {
    left_.raise_fault(0x2310);
    run(20'000);
  }
  const std::uint32_t resets = wheels_->drive(WheelDrive::kLeft).counters().fault_resets;
  EXPECT_GE(resets, 4u);
  EXPECT_LE(resets, 12u);
}

TEST_F(WheelDriveOnTheBus, APowerCycledDriveIsConfiguredAgain) {
  boot();
  drive(kStraight);
  run(500'000);
  right_.power_cycle(now_us_);
  EXPECT_LE(run_until([&] { return left_.state() == State::kQuickStopActive; }, 1'000'000),
            100'000u);
  run(1'500'000);
  EXPECT_TRUE(wheels_->enabled(now_us_));
  EXPECT_EQ(wheels_->drive(WheelDrive::kRight).counters().configurations, 2u);
  EXPECT_NEAR(right_.wheel_speed(), kStraightCounts, 1);
}

TEST_F(WheelDriveOnTheBus, DrivesStopByThemselvesWhenTheAgentDies) {
  boot();
  drive(kStraight);
  run(500'000);
  wheels_.reset();
  run(150'000 + 60'000);
  EXPECT_DOUBLE_EQ(left_.wheel_speed(), 0);
  EXPECT_DOUBLE_EQ(right_.wheel_speed(), 0);
  EXPECT_EQ(left_.nmt_state(), canopen::NmtState::kPreOperational);
  EXPECT_EQ(wire_.last(0x081).data[0], 0x30) << "EMCY 8130h, heartbeat error";
  EXPECT_EQ(wire_.last(0x081).data[1], 0x81);
}

TEST_F(WheelDriveOnTheBus, ARestartedAgentTakesOverMovingDrives) {
  boot();
  drive(kStraight);
  run(500'000);
  wheels_.emplace(config_, wire_.end(0));
  run(1'000'000);
  EXPECT_TRUE(wheels_->enabled(now_us_));
  EXPECT_NEAR(left_.wheel_speed(), kStraightCounts, 1);
}

TEST_F(WheelDriveOnTheBus, ADriveThatFallsToPreOperationalIsStartedAgain) {
  boot();
  left_.receive(canopen::nmt_frame(canopen::NmtCommand::kEnterPreOperational, 1), now_us_);
  run(600'000);
  EXPECT_TRUE(wheels_->enabled(now_us_));
  EXPECT_EQ(wheels_->drive(WheelDrive::kLeft).counters().configurations, 1u);
}

TEST_F(WheelDriveOnTheBus, BootsOnABusThatLosesFramesInBothDirections) {
  wire_.faults(0).drop_every = 11;
  wire_.faults(1).drop_every = 7;
  run_until([&] { return wheels_->enabled(now_us_); }, 20'000'000);
  EXPECT_TRUE(wheels_->enabled(now_us_));
}

TEST_F(WheelDriveOnTheBus, ADeadBusIsUnhealthyAndCountedAndComesBack) {
  boot();
  wire_.faults(0).receive_status = Status::kUnavailable;
  wire_.faults(0).send_status = Status::kUnavailable;
  run(1'000'000);
  EXPECT_FALSE(wheels_->healthy(now_us_));
  EXPECT_GT(wheels_->counters().bus_failures, 0u);
  EXPECT_GT(wheels_->counters().send_failures, 0u);
  wire_.faults(0) = {};
  run(1'000'000);
  EXPECT_TRUE(wheels_->enabled(now_us_));
}

TEST_F(WheelDriveOnTheBus, SurvivesRandomFramesFromAnybody) {
  boot();
  std::uint32_t seed = 1;
  const auto random = [&seed] { return (seed = seed * 1664525u + 1013904223u) >> 8; };
  for (int i = 0; i < 20'000; ++i) {
    CanFrame frame{.id = static_cast<std::uint16_t>(random() & 0x7ffu)};
    frame.size = static_cast<std::uint8_t>(random() % 9);
    frame.remote = random() % 16 == 0;
    for (auto& byte : frame.data) byte = static_cast<std::uint8_t>(random());
    (void)wire_.end(i % 2).send(frame);
    if (i % 50 == 0) run(1'000);
  }
  run_until([&] { return wheels_->enabled(now_us_); }, 30'000'000);
  EXPECT_TRUE(wheels_->enabled(now_us_));
}

}  // namespace
}  // namespace ivfm
