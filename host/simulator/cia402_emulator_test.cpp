#include "host/simulator/cia402_emulator.h"

#include <gtest/gtest.h>

#include <initializer_list>
#include <vector>

namespace ivfm::host {
namespace {

using canopen::NmtState;
using cia402::State;

CanFrame bytes(std::uint16_t id, std::initializer_list<std::uint8_t> data) {
  CanFrame frame{.id = id, .size = static_cast<std::uint8_t>(data.size())};
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

// Drive 1, spoken to in hand-written frames.
class Drive : public testing::Test {
 protected:
  void SetUp() override {
    drive_.step(now_us_);
    run(20'000);
    sent_.clear();
  }
  void collect() {
    while (const auto frame = drive_.transmit()) sent_.push_back(*frame);
  }
  void run(TimeUs duration_us) {
    for (const TimeUs end = now_us_ + duration_us; now_us_ < end;) {
      drive_.step(now_us_ += 1'000);
      collect();
    }
  }
  // Sends a frame; the last frame that came back, or an empty one.
  CanFrame ask(const CanFrame& frame) {
    sent_.clear();
    drive_.receive(frame, now_us_);
    collect();
    return sent_.empty() ? CanFrame{} : sent_.back();
  }
  void control(std::uint8_t low) {
    const CanFrame answer = ask(bytes(0x601, {0x2b, 0x40, 0x60, 0, low, 0, 0, 0}));
    EXPECT_EQ(answer, bytes(0x581, {0x60, 0x40, 0x60, 0, 0, 0, 0, 0}));
  }
  void enable() {
    for (const int word : {0x06, 0x07, 0x0f}) control(static_cast<std::uint8_t>(word));
    EXPECT_EQ(drive_.state(), State::kOperationEnabled);
  }
  void set_u32(std::uint16_t index, std::uint32_t value) {
    CanFrame frame = bytes(0x601, {0x23, 0, 0, 0, 0, 0, 0, 0});
    canopen::put_u16(frame, 1, index);
    canopen::put_u32(frame, 4, value);
    EXPECT_EQ(ask(frame).data[0], 0x60);
  }
  void spin(std::uint32_t target) {
    EXPECT_EQ(ask(bytes(0x601, {0x2f, 0x60, 0x60, 0, 3, 0, 0, 0})).data[0], 0x60);
    set_u32(0x60ff, target);
    enable();
  }

  Cia402Emulator drive_{{.node_id = 1}};
  std::vector<CanFrame> sent_;
  TimeUs now_us_ = 1'000'000;
};

TEST(DriveBoot, AnnouncesItselfOnce) {
  Cia402Emulator drive({.node_id = 9});
  drive.step(0);
  EXPECT_FALSE(drive.transmit().has_value());
  drive.step(20'000);
  EXPECT_EQ(drive.transmit(), bytes(0x709, {0x00}));
  EXPECT_FALSE(drive.transmit().has_value());
  EXPECT_EQ(drive.nmt_state(), NmtState::kPreOperational);
  EXPECT_EQ(drive.state(), State::kSwitchOnDisabled);
}

TEST_F(Drive, SaysItIsAServoDriveOfProfile402) {
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x00, 0x10, 0, 0, 0, 0, 0})),
            bytes(0x581, {0x43, 0x00, 0x10, 0, 0x92, 0x01, 0x02, 0x00}));
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x02, 0x65, 0, 0, 0, 0, 0})),
            bytes(0x581, {0x43, 0x02, 0x65, 0, 0x04, 0, 0, 0}));
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x17, 0x10, 0, 0, 0, 0, 0})),
            bytes(0x581, {0x4b, 0x17, 0x10, 0, 0, 0, 0, 0}));
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x01, 0x10, 0, 0, 0, 0, 0})),
            bytes(0x581, {0x4f, 0x01, 0x10, 0, 0, 0, 0, 0}));
}

// CiA 301 section 7.2.4.3.17.
TEST_F(Drive, AbortsWithTheStandardsCodes) {
  struct Case {
    CanFrame request;
    std::uint32_t code;
  };
  for (const Case& c : {
           Case{bytes(0x601, {0x40, 0x00, 0x50, 0, 0, 0, 0, 0}), 0x06020000},
           Case{bytes(0x601, {0x40, 0x18, 0x10, 9, 0, 0, 0, 0}), 0x06090011},
           Case{bytes(0x601, {0x2b, 0x41, 0x60, 0, 0, 0, 0, 0}), 0x06010002},
           Case{bytes(0x601, {0x23, 0x17, 0x10, 0, 0, 0, 0, 0}), 0x06070012},
           Case{bytes(0x601, {0x2f, 0x17, 0x10, 0, 0, 0, 0, 0}), 0x06070013},
           Case{bytes(0x601, {0x2f, 0x60, 0x60, 0, 1, 0, 0, 0}), 0x06090030},  // no position mode
           Case{bytes(0x601, {0x21, 0x17, 0x10, 0, 8, 0, 0, 0}), 0x05040001},  // segmented
           Case{bytes(0x601, {0x60, 0x00, 0x00, 0, 0, 0, 0, 0}), 0x05040001},
           Case{bytes(0x601, {0x23, 0x00, 0x1a, 1, 0x10, 0, 0x41, 0x60}), 0x06010000},  // valid PDO
       }) {
    const CanFrame answer = ask(c.request);
    EXPECT_EQ(answer.id, 0x581);
    EXPECT_EQ(answer.data[0], 0x80);
    EXPECT_EQ(canopen::get_u32(answer, 4), c.code) << int{c.request.data[1]};
  }
  EXPECT_EQ(ask(bytes(0x601, {0x80, 0x17, 0x10, 0, 0, 0, 4, 5})), CanFrame{}) << "a client's abort";
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x00})), CanFrame{}) << "too short for SDO";
}

TEST_F(Drive, AMappingIsCheckedEntryByEntry) {
  const auto code = [&](const CanFrame& f) { return canopen::get_u32(ask(f), 4); };
  ask(bytes(0x601, {0x23, 0x00, 0x1a, 0, 0, 0, 0, 0}));
  EXPECT_EQ(ask(bytes(0x601, {0x23, 0x00, 0x18, 1, 0x81, 0x01, 0, 0xc0})).data[0], 0x60);
  EXPECT_EQ(code(bytes(0x601, {0x23, 0x00, 0x1a, 1, 0x20, 0, 0x64, 0x60})), 0x06010000u)
      << "the count must be 0 first";
  EXPECT_EQ(ask(bytes(0x601, {0x2f, 0x00, 0x1a, 0, 0, 0, 0, 0})).data[0], 0x60);
  EXPECT_EQ(code(bytes(0x601, {0x23, 0x00, 0x1a, 1, 0x20, 0, 0x83, 0x60})), 0x06040041u);
  EXPECT_EQ(code(bytes(0x601, {0x23, 0x00, 0x1a, 1, 0x10, 0, 0x64, 0x60})), 0x06040041u);
  for (std::uint8_t slot = 1; slot <= 3; ++slot) {
    EXPECT_EQ(ask(bytes(0x601, {0x23, 0x00, 0x1a, slot, 0x20, 0, 0x64, 0x60})).data[0], 0x60);
  }
  EXPECT_EQ(code(bytes(0x601, {0x2f, 0x00, 0x1a, 0, 3, 0, 0, 0})), 0x06040042u) << "96 bits";
  EXPECT_EQ(ask(bytes(0x601, {0x2f, 0x00, 0x1a, 0, 2, 0, 0, 0})).data[0], 0x60);
}

TEST_F(Drive, FollowsNmtAndSendsPdosOnlyWhenOperational) {
  EXPECT_EQ(ask(bytes(0x080, {})), CanFrame{});
  ask(bytes(0x000, {0x01, 0x01}));
  EXPECT_EQ(drive_.nmt_state(), NmtState::kOperational);
  EXPECT_EQ(ask(bytes(0x080, {})), bytes(0x181, {0x50, 0x12}))
      << "remote, voltage, disabled, still";
  ask(bytes(0x000, {0x80, 0x02}));
  EXPECT_EQ(drive_.nmt_state(), NmtState::kOperational) << "meant for another node";
  ask(bytes(0x000, {0x02, 0x00}));
  EXPECT_EQ(drive_.nmt_state(), NmtState::kStopped);
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x00, 0x10, 0, 0, 0, 0, 0})), CanFrame{}) << "no SDO";
  ask(bytes(0x000, {0x82, 0x01}));
  run(30'000);
  EXPECT_EQ(drive_.nmt_state(), NmtState::kPreOperational);
  EXPECT_EQ(sent_.back(), bytes(0x701, {0x00}));
}

TEST_F(Drive, ReachesTheTargetOnTheProfileRampAndCounts) {
  set_u32(0x6083, 10'000);
  spin(5'000);
  run(250'000);
  EXPECT_NEAR(drive_.wheel_speed(), 2'500, 1);
  run(250'000);
  EXPECT_NEAR(drive_.wheel_speed(), 5'000, 1);
  EXPECT_NEAR(drive_.encoder_position(), 1'250, 2) << "0.5 * 10000 * 0.25";
  run(1'000'000);
  EXPECT_NEAR(drive_.encoder_position(), 6'250, 2);
  EXPECT_EQ(drive_.statusword() & 0x0400, 0x0400) << "target reached";
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x6c, 0x60, 0, 0, 0, 0, 0})),
            bytes(0x581, {0x43, 0x6c, 0x60, 0, 0x88, 0x13, 0, 0}));
}

TEST_F(Drive, SlipMovesTheGroundLessThanTheWheel) {
  spin(4'000);
  drive_.set_slip(0.25);
  run(2'000'000);
  EXPECT_NEAR(drive_.ground_position(), 0.75 * drive_.encoder_position(), 2);
  EXPECT_NEAR(drive_.ground_speed(), 3'000, 1);
  drive_.set_blocked(true);
  run(10'000);
  EXPECT_EQ(drive_.wheel_speed(), 0);
}

TEST_F(Drive, AFaultBrakesThenWaitsForARisingEdge) {
  spin(5'000);
  run(1'000'000);
  drive_.raise_fault(0x2310);
  EXPECT_EQ(drive_.state(), State::kFaultReactionActive);
  collect();
  EXPECT_EQ(sent_.back(), bytes(0x081, {0x10, 0x23, 0x01, 0, 0, 0, 0, 0}));
  run(110'000);  // 5000 at 50000 counts/s^2: 0.1 s
  EXPECT_EQ(drive_.state(), State::kFault);
  EXPECT_EQ(drive_.object({0x603f, 0}), 0x2310u);
  control(0x0f);
  EXPECT_EQ(drive_.state(), State::kFault);
  sent_.clear();
  drive_.receive(bytes(0x601, {0x2b, 0x40, 0x60, 0, 0x80, 0, 0, 0}), now_us_);
  collect();
  EXPECT_EQ(drive_.state(), State::kSwitchOnDisabled);
  EXPECT_EQ(sent_.front(), bytes(0x081, {0, 0, 0, 0, 0, 0, 0, 0})) << "error reset";
  drive_.raise_fault(0x2310);
  control(0x80);
  EXPECT_EQ(drive_.state(), State::kFault) << "bit 7 did not rise";
}

TEST_F(Drive, QuickStopOptionsAreTheProfiles) {
  struct Case {
    std::uint8_t option;
    State at_once, standing;
  };
  for (const Case& c : {Case{0, State::kSwitchOnDisabled, State::kSwitchOnDisabled},
                        Case{1, State::kQuickStopActive, State::kSwitchOnDisabled},
                        Case{2, State::kQuickStopActive, State::kSwitchOnDisabled},
                        Case{6, State::kQuickStopActive, State::kQuickStopActive}}) {
    EXPECT_EQ(ask(bytes(0x601, {0x2b, 0x5a, 0x60, 0, c.option, 0, 0, 0})).data[0], 0x60);
    spin(2'000);
    run(500'000);
    control(0x02);
    EXPECT_EQ(drive_.state(), c.at_once) << int{c.option};
    run(500'000);
    EXPECT_EQ(drive_.wheel_speed(), 0) << int{c.option};
    EXPECT_EQ(drive_.state(), c.standing) << int{c.option};
    if (c.standing == State::kQuickStopActive) {
      control(0x0f);
      EXPECT_EQ(drive_.state(), State::kOperationEnabled) << "transition 16";
    }
    control(0x00);
  }
}

TEST_F(Drive, LosesItsMasterAfterTheConfiguredTime) {
  set_u32(0x6085, 50'000);
  EXPECT_EQ(ask(bytes(0x601, {0x23, 0x16, 0x10, 1, 0x64, 0, 0x7f, 0})).data[0], 0x60);  // 100 ms
  ask(bytes(0x000, {0x01, 0x01}));
  spin(2'000);
  run(500'000);
  EXPECT_EQ(drive_.counters().heartbeat_losses, 0u) << "not watched before its first heartbeat";
  ask(bytes(0x77f, {0x05}));
  run(99'000);
  EXPECT_EQ(drive_.counters().heartbeat_losses, 0u);
  sent_.clear();
  run(2'000);
  ASSERT_FALSE(sent_.empty());
  EXPECT_EQ(sent_.front(), bytes(0x081, {0x30, 0x81, 0x11, 0, 0, 0, 0, 0}));
  EXPECT_EQ(drive_.nmt_state(), NmtState::kPreOperational);
  run(100'000);
  EXPECT_EQ(drive_.state(), State::kFault) << "6007h = 1: a malfunction";
  EXPECT_EQ(drive_.wheel_speed(), 0);
}

TEST_F(Drive, ASilentDriveNeitherHearsNorSpeaks) {
  drive_.set_silent(true);
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x00, 0x10, 0, 0, 0, 0, 0})), CanFrame{});
  drive_.set_silent(false);
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x00, 0x10, 0, 0, 0, 0, 0})).data[0], 0x43);
}

TEST_F(Drive, APowerCycleForgetsEverything) {
  set_u32(0x6083, 77);
  spin(5'000);
  run(200'000);
  drive_.power_cycle(now_us_);
  run(30'000);
  EXPECT_EQ(drive_.object({0x6083, 0}), 10'000u);
  EXPECT_EQ(drive_.state(), State::kSwitchOnDisabled);
  EXPECT_EQ(drive_.counters().boots, 2u);
}

TEST_F(Drive, SurvivesRandomFrames) {
  std::uint32_t seed = 11;
  const auto random = [&seed] { return (seed = seed * 1664525u + 1013904223u) >> 8; };
  const std::uint16_t ids[] = {0x000, 0x080, 0x201, 0x601, 0x77f, 0x601, 0x601};
  for (int i = 0; i < 100'000; ++i) {
    CanFrame frame{.id = ids[random() % 7]};
    frame.size = static_cast<std::uint8_t>(random() % 9);
    for (auto& byte : frame.data) byte = static_cast<std::uint8_t>(random());
    if (random() % 2) frame.data[1] = static_cast<std::uint8_t>(random() % 2);
    if (random() % 2)
      canopen::put_u16(frame, 1,
                       drive_dictionary()[random() % drive_dictionary().size()].key.index);
    drive_.receive(frame, now_us_ += random() % 500);
    collect();
    if (sent_.size() > 1000) sent_.clear();
  }
  ask(bytes(0x000, {0x81, 0x01}));
  run(30'000);
  EXPECT_EQ(ask(bytes(0x601, {0x40, 0x00, 0x10, 0, 0, 0, 0, 0})).data[0], 0x43);
}

}  // namespace
}  // namespace ivfm::host
