#include "firmware/lidar/rplidar_driver.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "firmware/hal/fake/fake_serial_port.h"

namespace ivfm {
namespace {

using Bytes = std::vector<std::uint8_t>;

const Bytes kStop = {0xa5, 0x25}, kReset = {0xa5, 0x40}, kScan = {0xa5, 0x20};
const Bytes kGetInfo = {0xa5, 0x50}, kGetHealth = {0xa5, 0x52};
const Bytes kExpressScan = {0xa5, 0x82, 0x05, 0, 0, 0, 0, 0, 0x22};
constexpr TimeUs kTick = 10'000;

// A device in a few lines: answers what is asked, sends nodes on demand.
class RplidarDriverTest : public testing::Test {
 protected:
  void step() {
    now_ += kTick;
    driver_.step(now_);
    for (; seen_ < port_.written.size(); ++seen_) answer(port_.written[seen_]);
  }
  void run_until(RplidarState state, int limit = 2000) {
    for (int i = 0; i < limit && driver_.state() != state; ++i) step();
    ASSERT_EQ(driver_.state(), state) << to_string(driver_.state());
  }
  void answer(const Bytes& request) {
    if (silent_) return;
    if (request == kGetInfo) {
      port_.feed(Bytes{0xa5, 0x5a, 0x14, 0, 0, 0, 0x04, 24, firmware_minor_, 1, 7});
      port_.feed(Bytes(16, 0xee));
    } else if (request == kGetHealth) {
      port_.feed(Bytes{0xa5, 0x5a, 0x03, 0, 0, 0, 0x06, health_, 0, 0});
    } else if (request == kScan) {
      port_.feed(Bytes{0xa5, 0x5a, 0x05, 0, 0, 0x40, 0x81});
    } else if (request == kExpressScan) {
      port_.feed(Bytes{0xa5, 0x5a, 0x54, 0, 0, 0x40, 0x82});
    } else if (request == kReset) {
      health_ = health_after_reset_;
    }
  }
  // A revolution of 36 nodes, one every 10 degrees, all at `range_mm`.
  void feed_revolution(unsigned range_mm) {
    for (unsigned i = 0; i < 36; ++i) feed_node(i * 10, range_mm, i == 0);
  }
  void feed_node(unsigned angle_deg, unsigned range_mm, bool start) {
    const unsigned angle = (angle_deg * 64) << 1 | 1u, distance = range_mm * 4;
    port_.feed(Bytes{static_cast<std::uint8_t>(20 << 2 | (start ? 1 : 2)),
                     static_cast<std::uint8_t>(angle), static_cast<std::uint8_t>(angle >> 8),
                     static_cast<std::uint8_t>(distance),
                     static_cast<std::uint8_t>(distance >> 8)});
  }
  void start_standard() {
    firmware_minor_ = 15;  // before EXPRESS_SCAN
    driver_.start(now_);
    run_until(RplidarState::kStarting);
    step();
  }

  FakeSerialPort port_;
  RplidarConfig config_;
  RplidarDriver driver_{port_, config_};
  TimeUs now_ = 1'000'000;
  std::size_t seen_ = 0;
  bool silent_ = false;
  std::uint8_t firmware_minor_ = 29, health_ = 0, health_after_reset_ = 0;
};

TEST_F(RplidarDriverTest, ClimbsTheLadderToAnExpressScan) {
  driver_.start(now_);
  EXPECT_FALSE(port_.motor_on);
  run_until(RplidarState::kStarting);
  EXPECT_THAT(port_.written, testing::ElementsAre(kStop, kGetInfo, kGetHealth, kExpressScan));
  EXPECT_TRUE(port_.motor_on);
  EXPECT_TRUE(driver_.uses_express());
  EXPECT_EQ(driver_.info().firmware_minor, 29);
}

TEST_F(RplidarDriverTest, FallsBackToAStandardScanOnOldFirmware) {
  start_standard();
  EXPECT_EQ(port_.written.back(), kScan);
  EXPECT_FALSE(driver_.uses_express());
}

TEST_F(RplidarDriverTest, DeliversARevolutionCounterClockwise) {
  start_standard();
  feed_revolution(2000);
  feed_node(0, 2000, true);
  step();
  EXPECT_EQ(driver_.state(), RplidarState::kScanning);
  const Scan* scan = driver_.take_scan();
  ASSERT_NE(scan, nullptr);
  ASSERT_EQ(scan->size, 36u);
  EXPECT_EQ(scan->points()[0], (ScanPoint{BinaryAngle(), 2000, Echo::kHit, 20}));
  // 90 degrees clockwise is to the right: -90 degrees.
  EXPECT_EQ(scan->points()[9].bearing, BinaryAngle::from_degrees(-90));
  EXPECT_EQ(driver_.take_scan(), nullptr) << "a scan is taken once";
  EXPECT_EQ(driver_.counters().scans, 1u);
}

TEST_F(RplidarDriverTest, TurnsBearingsByTheMountingYaw) {
  config_.mounting_yaw = BinaryAngle::from_degrees(180);
  RplidarDriver driver(port_, config_);
  firmware_minor_ = 15;
  driver.start(now_);
  for (int i = 0; i < 10; ++i) {
    driver.step(now_ += kTick);
    for (; seen_ < port_.written.size(); ++seen_) answer(port_.written[seen_]);
  }
  feed_revolution(2000);
  feed_node(0, 2000, true);
  driver.step(now_ += kTick);
  const Scan* scan = driver.take_scan();
  ASSERT_NE(scan, nullptr);
  EXPECT_EQ(scan->points()[0].bearing, BinaryAngle::from_degrees(180));
  EXPECT_EQ(scan->points()[9].bearing, BinaryAngle::from_degrees(90));
}

TEST_F(RplidarDriverTest, CallsNothingAndRangesOutsideTheSensorNoMeasurement) {
  start_standard();
  for (unsigned i = 0; i < 36; ++i) {
    const unsigned range[] = {0, 149, 150, 12000, 12001, 16383};
    feed_node(i * 10, range[i % 6], i == 0);
  }
  feed_node(0, 1000, true);
  step();
  const Scan* scan = driver_.take_scan();
  ASSERT_NE(scan, nullptr);
  const Echo expected[] = {Echo::kNothing, Echo::kNothing, Echo::kHit,
                           Echo::kHit,     Echo::kNothing, Echo::kNothing};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(scan->points()[i].echo, expected[i]) << i;
}

TEST_F(RplidarDriverTest, TimesTheSweep) {
  start_standard();
  feed_node(350, 1000, false);  // the end of a revolution that began unseen
  feed_revolution(1000);
  step();
  const TimeUs begin = now_;
  for (int i = 0; i < 5; ++i) step();
  feed_node(0, 1000, true);
  step();
  ASSERT_NE(driver_.take_scan(), nullptr);
  EXPECT_EQ(driver_.scan_start_us(), begin);
  EXPECT_EQ(driver_.scan_end_us(), now_);
  EXPECT_EQ(driver_.counters().dropped_samples, 1u);
}

TEST_F(RplidarDriverTest, ResetsADeviceInErrorAndScansThen) {
  health_ = RplidarHealth::kError;
  driver_.start(now_);
  run_until(RplidarState::kResetting);
  EXPECT_EQ(port_.written.back(), kReset);
  run_until(RplidarState::kStarting);
  EXPECT_EQ(driver_.counters().resets, 1u);
}

TEST_F(RplidarDriverTest, NeverScansWithADeviceThatStaysInError) {
  health_ = health_after_reset_ = RplidarHealth::kError;
  driver_.start(now_);
  for (int i = 0; i < 1000; ++i) step();
  EXPECT_GE(driver_.counters().resets, 3u);
  EXPECT_THAT(port_.written, testing::Not(testing::Contains(kExpressScan)));
}

TEST_F(RplidarDriverTest, AsksAgainWithGrowingPausesWhenNobodyAnswers) {
  silent_ = true;
  driver_.start(now_);
  std::vector<TimeUs> attempts;
  for (int i = 0; i < 2000; ++i) {
    const std::size_t before = port_.written.size();
    step();
    if (port_.written.size() > before && port_.written[before] == kGetInfo) {
      attempts.push_back(now_);
    }
  }
  ASSERT_GE(attempts.size(), 6u);
  EXPECT_LT(attempts[1] - attempts[0], 700'000u);
  EXPECT_GE(attempts.back() - attempts[attempts.size() - 2], config_.max_backoff_us);
  EXPECT_GE(driver_.counters().reconnects, 5u);
}

TEST_F(RplidarDriverTest, ReconnectsAfterSilence) {
  start_standard();
  feed_revolution(1000);
  step();
  ASSERT_EQ(driver_.state(), RplidarState::kScanning);
  run_until(RplidarState::kWaiting, 101);
  run_until(RplidarState::kStarting);
  EXPECT_EQ(driver_.counters().reconnects, 1u);
}

TEST_F(RplidarDriverTest, ReconnectsAfterTheDeviceWasUnplugged) {
  start_standard();
  feed_revolution(1000);
  step();
  port_.status = Status::kUnavailable;
  now_ += kTick;
  EXPECT_EQ(driver_.step(now_), Status::kUnavailable);
  for (int i = 0; i < 300; ++i) step();
  EXPECT_GT(driver_.counters().port_errors, 0u);
  port_.status = Status::kOk;
  run_until(RplidarState::kStarting);
}

TEST_F(RplidarDriverTest, GoesOnScanningThroughGarbage) {
  start_standard();
  feed_revolution(1000);
  port_.feed(Bytes(333, 0x37));
  for (int i = 0; i < 3; ++i) feed_revolution(1500);
  step();
  ASSERT_NE(driver_.take_scan(), nullptr);
  EXPECT_GE(driver_.counters().resyncs, 1u);
  EXPECT_EQ(driver_.state(), RplidarState::kScanning);
}

TEST_F(RplidarDriverTest, DropsWhatDoesNotFitIntoAScan) {
  start_standard();
  for (unsigned i = 0; i < 2000; ++i) {
    feed_node(i * 360 / 2000, 1000, i == 0);
    if (i % 500 == 0) step();
  }
  feed_node(0, 1000, true);
  step();
  step();
  step();
  EXPECT_EQ(driver_.counters().dropped_samples, 2000u - Scan::kMaxPoints);
  EXPECT_EQ(driver_.counters().scans, 1u);
}

TEST_F(RplidarDriverTest, StopsTheMotorAndTheScan) {
  start_standard();
  feed_revolution(1000);
  step();
  driver_.stop(now_);
  EXPECT_EQ(port_.written.back(), kStop);
  EXPECT_FALSE(port_.motor_on);
  feed_revolution(1000);
  feed_revolution(1000);
  step();
  EXPECT_EQ(driver_.take_scan(), nullptr);
  EXPECT_EQ(driver_.state(), RplidarState::kStopped);
  driver_.start(now_);
  run_until(RplidarState::kStarting);
}

}  // namespace
}  // namespace ivfm
