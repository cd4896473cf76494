#include "firmware/wheel_drive/canopen_node.h"

#include <gtest/gtest.h>

#include <initializer_list>
#include <vector>

namespace ivfm {
namespace {

// Remembers what was sent; refuses when told.
class RecordingBus final : public CanBus {
 public:
  Result<CanFrame> receive() override { return Status::kEmpty; }
  Status send(const CanFrame& frame) override {
    if (!ok(answer)) return answer;
    sent.push_back(frame);
    return Status::kOk;
  }
  std::vector<CanFrame> sent;
  Status answer = Status::kOk;
};

CanFrame bytes(std::uint16_t id, std::initializer_list<std::uint8_t> data) {
  CanFrame frame{.id = id, .size = static_cast<std::uint8_t>(data.size())};
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

class SdoClientTest : public testing::Test {
 protected:
  RecordingBus bus_;
  SdoClient sdo_{4, 100'000};
};

// The trace of CANopenNode's documentation: heartbeat 1017h of node 4 set to 5000 ms.
TEST_F(SdoClientTest, WritesTwoBytesAsCanopennodesTraceShows) {
  ASSERT_EQ(sdo_.download({0x1017, 0}, 2, 5000), Status::kOk);
  sdo_.step(0, bus_);
  ASSERT_EQ(bus_.sent.size(), 1u);
  EXPECT_EQ(bus_.sent[0], bytes(0x604, {0x2b, 0x17, 0x10, 0x00, 0x88, 0x13, 0x00, 0x00}));
  EXPECT_EQ(sdo_.on_frame(bytes(0x584, {0x60, 0x17, 0x10, 0x00, 0, 0, 0, 0})), Status::kOk);
  EXPECT_EQ(sdo_.state(), SdoClient::State::kDone);
  EXPECT_EQ(sdo_.status(), Status::kOk);
}

// CiA 301 section 7.2.4.3.3: 23h, 27h, 2Bh, 2Fh for 4, 3, 2, 1 bytes.
TEST_F(SdoClientTest, MarksTheSizeOfADownload) {
  const std::uint8_t commands[] = {0x2f, 0x2b, 0x27, 0x23};
  for (std::uint8_t size = 1; size <= 4; ++size) {
    ASSERT_EQ(sdo_.download({0x6060, 0}, size, 0xfffffffd), Status::kOk);
    sdo_.step(0, bus_);
    EXPECT_EQ(bus_.sent.back().data[0], commands[size - 1]);
    EXPECT_EQ(bus_.sent.back().data[4], 0xfd);
    EXPECT_EQ(bus_.sent.back().data[5], size > 1 ? 0xff : 0x00);
    EXPECT_EQ(bus_.sent.back().data[7], size > 3 ? 0xff : 0x00);
    sdo_.cancel();
  }
  EXPECT_EQ(sdo_.download({0x6060, 0}, 0, 0), Status::kInvalidArgument);
  EXPECT_EQ(sdo_.download({0x6060, 0}, 5, 0), Status::kInvalidArgument);
}

TEST_F(SdoClientTest, ReadsExpeditedAnswersOfEverySize) {
  struct Case {
    std::uint8_t command, size;
    std::uint32_t value;
  };
  for (const Case& c : {Case{0x43, 4, 0x00020192}, Case{0x47, 3, 0x020192}, Case{0x4b, 2, 0x0192},
                        Case{0x4f, 1, 0x92}, Case{0x42, 4, 0x00020192}}) {
    ASSERT_EQ(sdo_.upload({0x1000, 0}), Status::kOk);
    sdo_.step(0, bus_);
    EXPECT_EQ(bus_.sent.back(), bytes(0x604, {0x40, 0x00, 0x10, 0x00, 0, 0, 0, 0}));
    EXPECT_EQ(sdo_.on_frame(bytes(0x584, {c.command, 0x00, 0x10, 0x00, 0x92, 0x01, 0x02, 0x00})),
              Status::kOk);
    EXPECT_EQ(sdo_.status(), Status::kOk);
    EXPECT_EQ(sdo_.value(), c.value);
    EXPECT_EQ(sdo_.value_size(), c.size);
  }
}

TEST_F(SdoClientTest, ReportsTheServersAbort) {
  ASSERT_EQ(sdo_.upload({0x5000, 0}), Status::kOk);
  sdo_.step(0, bus_);
  EXPECT_EQ(sdo_.on_frame(bytes(0x584, {0x80, 0x00, 0x50, 0x00, 0x00, 0x00, 0x02, 0x06})),
            Status::kOk);
  EXPECT_EQ(sdo_.status(), Status::kRefused);
  EXPECT_EQ(sdo_.abort_code(), 0x06020000u);
}

// A device name (1008h) of 10 bytes: 41h announces segments, which this client does not take.
TEST_F(SdoClientTest, AbortsASegmentedTransfer) {
  ASSERT_EQ(sdo_.upload({0x1008, 0}), Status::kOk);
  sdo_.step(0, bus_);
  EXPECT_EQ(sdo_.on_frame(bytes(0x584, {0x41, 0x08, 0x10, 0x00, 10, 0, 0, 0})), Status::kOk);
  EXPECT_EQ(sdo_.status(), Status::kUnsupported);
  sdo_.step(1, bus_);
  EXPECT_EQ(bus_.sent.back(), bytes(0x604, {0x80, 0x08, 0x10, 0x00, 0x05, 0x00, 0x04, 0x05}));
}

TEST_F(SdoClientTest, TimesOutAndAborts) {
  ASSERT_EQ(sdo_.upload({0x1000, 0}), Status::kOk);
  sdo_.step(1'000, bus_);
  sdo_.step(100'999, bus_);
  EXPECT_TRUE(sdo_.busy());
  sdo_.step(101'000, bus_);
  EXPECT_EQ(sdo_.status(), Status::kTimeout);
  EXPECT_EQ(bus_.sent.back(), bytes(0x604, {0x80, 0x00, 0x10, 0x00, 0x00, 0x00, 0x04, 0x05}));
}

TEST_F(SdoClientTest, KeepsTryingAFullBusUntilTheTimeout) {
  ASSERT_EQ(sdo_.upload({0x1000, 0}), Status::kOk);
  EXPECT_EQ(sdo_.upload({0x1000, 0}), Status::kFull);
  bus_.answer = Status::kFull;
  sdo_.step(0, bus_);
  EXPECT_EQ(sdo_.state(), SdoClient::State::kQueued);
  bus_.answer = Status::kOk;
  sdo_.step(1'000, bus_);
  EXPECT_EQ(sdo_.state(), SdoClient::State::kWaiting);
  EXPECT_EQ(bus_.sent.size(), 1u);
}

TEST_F(SdoClientTest, IgnoresWhatItDidNotAsk) {
  EXPECT_EQ(sdo_.on_frame(bytes(0x584, {0x60, 0, 0, 0, 0, 0, 0, 0})), Status::kEmpty);
  ASSERT_EQ(sdo_.download({0x6060, 0}, 1, 3), Status::kOk);
  sdo_.step(0, bus_);
  EXPECT_EQ(sdo_.on_frame(bytes(0x584, {0x60, 0x61, 0x60, 0, 0, 0, 0, 0})), Status::kEmpty);
  EXPECT_EQ(sdo_.on_frame(bytes(0x584, {0x43, 0x60, 0x60, 0, 0, 0, 0, 0})), Status::kEmpty);
  EXPECT_EQ(sdo_.on_frame(bytes(0x584, {0x60, 0x60, 0x60, 0, 0, 0, 0})), Status::kCorrupt);
  EXPECT_EQ(sdo_.on_frame(bytes(0x584, {0xff, 0x60, 0x60, 0, 0, 0, 0, 0})), Status::kCorrupt);
  EXPECT_TRUE(sdo_.busy());
}

TEST(CanopenNode, FollowsBootUpHeartbeatsAndEmergencies) {
  CanopenNode node(5, 1000);
  EXPECT_TRUE(node.on_frame(bytes(0x705, {0x00}), 10));
  EXPECT_TRUE(node.take_boot_up());
  EXPECT_FALSE(node.take_boot_up());
  EXPECT_TRUE(node.on_frame(bytes(0x705, {0x7f}), 20));
  EXPECT_EQ(node.nmt_state(), canopen::NmtState::kPreOperational);
  EXPECT_EQ(node.last_heartbeat_us(), 20u);
  EXPECT_TRUE(node.on_frame(bytes(0x085, {0x10, 0x23, 0x03, 0, 0, 0, 0, 0}), 30));
  EXPECT_EQ(node.last_emergency().error_code, 0x2310);
  EXPECT_EQ(node.last_emergency().error_register, 0x03);
  EXPECT_TRUE(node.on_frame(bytes(0x085, {0, 0, 0, 0, 0, 0, 0, 0}), 40));
  EXPECT_EQ(node.counters().emergencies, 1u) << "an error reset is none";
  EXPECT_FALSE(node.on_frame(bytes(0x706, {0x05}), 50)) << "another node's";
}

TEST(CanopenNode, CountsMalformedFramesAndTakesNothingFromThem) {
  CanopenNode node(5, 1000);
  EXPECT_TRUE(node.on_frame(bytes(0x705, {}), 10));
  EXPECT_TRUE(node.on_frame(bytes(0x705, {0x85}), 10)) << "node guarding's toggle bit";
  EXPECT_TRUE(node.on_frame(bytes(0x705, {0x05, 0x05}), 10));
  EXPECT_TRUE(node.on_frame(bytes(0x085, {0x10, 0x23}), 10));
  EXPECT_TRUE(node.on_frame(CanFrame{.id = 0x705, .size = 1, .remote = true}, 10));
  EXPECT_EQ(node.counters().malformed, 5u);
  EXPECT_EQ(node.last_heartbeat_us(), 0u);
}

TEST(CanopenNode, SendsNmtCommandsToItsNode) {
  RecordingBus bus;
  CanopenNode node(5, 1000);
  EXPECT_EQ(node.send_nmt(canopen::NmtCommand::kStart, bus), Status::kOk);
  EXPECT_EQ(node.send_nmt(canopen::NmtCommand::kResetCommunication, bus), Status::kOk);
  EXPECT_EQ(bus.sent[0], bytes(0x000, {0x01, 0x05}));
  EXPECT_EQ(bus.sent[1], bytes(0x000, {0x82, 0x05}));
}

}  // namespace
}  // namespace ivfm
