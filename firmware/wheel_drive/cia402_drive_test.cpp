#include "firmware/wheel_drive/cia402_drive.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <initializer_list>
#include <vector>

namespace ivfm {
namespace {

using cia402::Goal;
using cia402::State;

CanFrame bytes(std::uint16_t id, std::initializer_list<std::uint8_t> data) {
  CanFrame frame{.id = id, .size = static_cast<std::uint8_t>(data.size())};
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

// A foreign drive, node 3, played by hand: it acknowledges every SDO write.
class ForeignDrive final : public CanBus {
 public:
  Result<CanFrame> receive() override { return Status::kEmpty; }
  Status send(const CanFrame& frame) override {
    sent.push_back(frame);
    return Status::kOk;
  }
  std::vector<CanFrame> sent;
};

class DriveMaster : public testing::Test {
 protected:
  void step(TimeUs later_us = 1'000) {
    now_us_ += later_us;
    drive_.step(now_us_, bus_);
  }
  // Answers the last request as a drive would: 1000h says CiA 402, writes are good.
  void answer_sdo() {
    const CanFrame request = bus_.sent.back();
    CanFrame answer = request;
    answer.id = 0x583;
    std::fill(answer.data.begin() + 4, answer.data.end(), std::uint8_t{0});
    answer.data[0] = 0x60;
    if (request.data[0] == 0x40) {
      answer = bytes(0x583, {0x43, 0x00, 0x10, 0x00, 0x92, 0x01, 0x02, 0x00});
    }
    drive_.on_frame(answer, now_us_);
  }
  void configure() {
    step();
    drive_.on_frame(bytes(0x703, {0x00}), now_us_);
    for (int i = 0; i < 100 && drive_.phase() != Cia402Drive::Phase::kStarting; ++i) {
      step();
      if (bus_.sent.back().id == 0x603) answer_sdo();
    }
  }
  void run() {
    configure();
    step();
    drive_.on_frame(bytes(0x703, {0x05}), now_us_ + 1);
    step();
  }
  void report(std::uint16_t statusword) {
    drive_.on_frame(bytes(0x183, {static_cast<std::uint8_t>(statusword & 0xff),
                                  static_cast<std::uint8_t>(statusword >> 8), 0, 0, 0, 0}),
                    now_us_);
    drive_.on_frame(bytes(0x283, {1, 0, 0, 0}), now_us_);
  }
  CanFrame rpdo(Goal goal) { return drive_.next_rpdo(goal, 0x01020304, now_us_); }

  static Cia402DriveConfig config() {
    Cia402DriveConfig config;
    config.node_id = 3;
    return config;
  }
  Cia402Drive drive_{config()};
  ForeignDrive bus_;
  TimeUs now_us_ = 1'000'000;
};

TEST_F(DriveMaster, AsksForARestartAndIdentifiesTheDriveFirst) {
  step();
  ASSERT_EQ(bus_.sent.size(), 1u);
  EXPECT_EQ(bus_.sent[0], bytes(0x000, {0x82, 0x03}));
  drive_.on_frame(bytes(0x703, {0x00}), now_us_);
  step();
  EXPECT_EQ(bus_.sent.back(), bytes(0x603, {0x40, 0x00, 0x10, 0x00, 0, 0, 0, 0}));
}

// The whole configuration as CiA 301 and 402 write it, byte for byte, by hand.
TEST_F(DriveMaster, ConfiguresWithTheStandardsBytes) {
  configure();
  std::vector<CanFrame> writes;
  std::copy_if(bus_.sent.begin(), bus_.sent.end(), std::back_inserter(writes),
               [](const CanFrame& f) { return f.id == 0x603 && f.data[0] != 0x40; });
  const std::vector<CanFrame> expected = {
      bytes(0x603, {0x23, 0x16, 0x10, 0x01, 0x96, 0x00, 0x7f, 0x00}),  // watch node 127, 150 ms
      bytes(0x603, {0x2b, 0x17, 0x10, 0x00, 0x64, 0x00, 0x00, 0x00}),  // heartbeat 100 ms
      bytes(0x603,
            {0x2b, 0x07, 0x60, 0x00, 0x03, 0x00, 0x00, 0x00}),  // connection lost: quick stop
      bytes(0x603, {0x2b, 0x5a, 0x60, 0x00, 0x02, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x2b, 0x5e, 0x60, 0x00, 0x02, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x2f, 0x60, 0x60, 0x00, 0x03, 0x00, 0x00, 0x00}),  // profile velocity
      bytes(0x603, {0x23, 0x83, 0x60, 0x00, 0x20, 0x4e, 0x00, 0x00}),  // 20,000
      bytes(0x603, {0x23, 0x84, 0x60, 0x00, 0x40, 0x9c, 0x00, 0x00}),  // 40,000
      bytes(0x603, {0x23, 0x85, 0x60, 0x00, 0x80, 0x38, 0x01, 0x00}),  // 80,000
      bytes(0x603, {0x23, 0xff, 0x60, 0x00, 0x00, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x23, 0x00, 0x14, 0x01, 0x03, 0x02, 0x00, 0x80}),  // RPDO1 off
      bytes(0x603, {0x2f, 0x00, 0x16, 0x00, 0x00, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x23, 0x00, 0x16, 0x01, 0x10, 0x00, 0x40, 0x60}),  // 6040h, 16 bit
      bytes(0x603, {0x23, 0x00, 0x16, 0x02, 0x20, 0x00, 0xff, 0x60}),  // 60FFh, 32 bit
      bytes(0x603, {0x2f, 0x00, 0x16, 0x00, 0x02, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x2f, 0x00, 0x14, 0x02, 0x01, 0x00, 0x00, 0x00}),  // with SYNC
      bytes(0x603, {0x23, 0x00, 0x14, 0x01, 0x03, 0x02, 0x00, 0x00}),  // on: 203h
      bytes(0x603, {0x23, 0x00, 0x18, 0x01, 0x83, 0x01, 0x00, 0xc0}),  // TPDO1 off
      bytes(0x603, {0x2f, 0x00, 0x1a, 0x00, 0x00, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x23, 0x00, 0x1a, 0x01, 0x10, 0x00, 0x41, 0x60}),  // 6041h, 16 bit
      bytes(0x603, {0x23, 0x00, 0x1a, 0x02, 0x20, 0x00, 0x6c, 0x60}),  // 606Ch, 32 bit
      bytes(0x603, {0x2f, 0x00, 0x1a, 0x00, 0x02, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x2f, 0x00, 0x18, 0x02, 0x01, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x23, 0x00, 0x18, 0x01, 0x83, 0x01, 0x00, 0x40}),  // on: 183h, no RTR
      bytes(0x603, {0x23, 0x01, 0x18, 0x01, 0x83, 0x02, 0x00, 0xc0}),  // TPDO2 off
      bytes(0x603, {0x2f, 0x01, 0x1a, 0x00, 0x00, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x23, 0x01, 0x1a, 0x01, 0x20, 0x00, 0x64, 0x60}),  // 6064h, 32 bit
      bytes(0x603, {0x2f, 0x01, 0x1a, 0x00, 0x01, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x2f, 0x01, 0x18, 0x02, 0x01, 0x00, 0x00, 0x00}),
      bytes(0x603, {0x23, 0x01, 0x18, 0x01, 0x83, 0x02, 0x00, 0x40}),
      bytes(0x603, {0x23, 0x02, 0x18, 0x01, 0x83, 0x03, 0x00, 0x80}),  // TPDO3, TPDO4 off
      bytes(0x603, {0x23, 0x03, 0x18, 0x01, 0x83, 0x04, 0x00, 0x80}),
  };
  ASSERT_EQ(writes.size(), expected.size());
  for (std::size_t i = 0; i < writes.size(); ++i) EXPECT_EQ(writes[i], expected[i]) << i;
  step();
  EXPECT_EQ(bus_.sent.back(), bytes(0x000, {0x01, 0x03})) << "then NMT start";
}

TEST_F(DriveMaster, WalksTheDriveToOperationEnabled) {
  run();
  ASSERT_TRUE(drive_.running());
  report(0x0250);
  EXPECT_EQ(rpdo(Goal::kOperate), bytes(0x203, {0x06, 0x00, 0, 0, 0, 0}));
  report(0x0231);
  EXPECT_EQ(rpdo(Goal::kOperate), bytes(0x203, {0x07, 0x00, 0, 0, 0, 0}));
  report(0x0233);
  EXPECT_EQ(rpdo(Goal::kOperate), bytes(0x203, {0x0f, 0x00, 0, 0, 0, 0}));
  report(0x0637);
  EXPECT_EQ(rpdo(Goal::kOperate), bytes(0x203, {0x0f, 0x00, 0x04, 0x03, 0x02, 0x01}));
  EXPECT_EQ(rpdo(Goal::kQuickStop), bytes(0x203, {0x02, 0x00, 0, 0, 0, 0}));
  EXPECT_EQ(rpdo(Goal::kOff), bytes(0x203, {0x00, 0x00, 0, 0, 0, 0}));
}

TEST_F(DriveMaster, ResetsAFaultByARisingEdgeAfterThePause) {
  run();
  report(0x0218);
  EXPECT_EQ(drive_.counters().faults, 1u);
  EXPECT_EQ(rpdo(Goal::kOperate).data[0], 0x00);
  for (int i = 0; i < 5; ++i) {
    step(20'000);
    drive_.on_frame(bytes(0x703, {0x05}), now_us_);
    report(0x0218);
  }
  EXPECT_EQ(rpdo(Goal::kOperate).data[0], 0x80);
  EXPECT_EQ(drive_.counters().fault_resets, 1u);
  report(0x0250);
  EXPECT_EQ(rpdo(Goal::kOperate).data[0], 0x06);
}

TEST_F(DriveMaster, StaleReportsMeanQuickStop) {
  run();
  report(0x0637);
  step(61'000);
  EXPECT_FALSE(drive_.fresh(now_us_));
  EXPECT_EQ(rpdo(Goal::kOperate), bytes(0x203, {0x02, 0x00, 0, 0, 0, 0}));
}

TEST_F(DriveMaster, ADeviceOfAnotherProfileIsRejected) {
  step();
  drive_.on_frame(bytes(0x703, {0x00}), now_us_);
  step();
  drive_.on_frame(bytes(0x583, {0x43, 0x00, 0x10, 0x00, 0x91, 0x01, 0x0f, 0x00}), now_us_);  // 401
  step();
  EXPECT_EQ(drive_.phase(), Cia402Drive::Phase::kRejected);
}

TEST_F(DriveMaster, AMissingOptionalObjectIsFineAndAMissingNeededOneIsNot) {
  step();
  drive_.on_frame(bytes(0x703, {0x00}), now_us_);
  step();
  for (int i = 0; i < 100 && drive_.phase() == Cia402Drive::Phase::kConfiguring; ++i) {
    const CanFrame& request = bus_.sent.back();
    if (request.data[2] == 0x60 && (request.data[1] == 0x07 || request.data[1] == 0x83)) {
      drive_.on_frame(bytes(0x583, {0x80, request.data[1], 0x60, 0x00, 0x00, 0x00, 0x02, 0x06}),
                      now_us_);
    } else {
      answer_sdo();
    }
    step();
    if (bus_.sent.back().data[1] == 0x84) FAIL() << "went on past 6083h";
  }
  EXPECT_EQ(drive_.phase(), Cia402Drive::Phase::kRejected);
  EXPECT_EQ(drive_.last_abort_code(), 0x06020000u);
  EXPECT_EQ(drive_.counters().sdo_failures, 1u);
}

TEST_F(DriveMaster, CountsMalformedPdos) {
  run();
  drive_.on_frame(bytes(0x183, {0x37, 0x06}), now_us_);
  drive_.on_frame(bytes(0x283, {1, 2, 3}), now_us_);
  drive_.on_frame(CanFrame{.id = 0x283, .size = 4, .remote = true}, now_us_);
  EXPECT_EQ(drive_.counters().malformed_pdos, 3u);
  EXPECT_FALSE(drive_.has_position());
}

}  // namespace
}  // namespace ivfm
