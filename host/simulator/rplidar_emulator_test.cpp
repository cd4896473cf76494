#include "host/simulator/rplidar_emulator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "firmware/lidar/rplidar_driver.h"
#include "host/simulator/emulated_serial_port.h"

namespace ivfm::host {
namespace {

using Bytes = std::vector<std::uint8_t>;
using testing::ElementsAre;

Bytes ask(RplidarEmulator& emulator, const Bytes& request, TimeUs now_us = 1000) {
  emulator.receive(request, now_us);
  return emulator.transmit(now_us);
}

// A get-configuration request as rplidar_sdk sends it: u32 type, u16 mode, reserved to 36 bytes.
Bytes configuration_request(std::uint32_t type, std::uint8_t mode = 0) {
  Bytes payload(36, 0);
  payload[0] = static_cast<std::uint8_t>(type);
  payload[4] = mode;
  Bytes bytes(64);
  bytes.resize(*rplidar::encode_request(rplidar::Request::kGetConfiguration, payload, bytes));
  return bytes;
}

const Bytes kScan = {0xa5, 0x20};
const Bytes kExpressScan = {0xa5, 0x82, 5, 0, 0, 0, 0, 0, 0x22};

// A room whose range tells the direction: 1000 mm plus 5 mm a degree of counter-clockwise bearing.
std::uint16_t range_towards(BinaryAngle bearing) {
  const double degrees = bearing.raw() * 360.0 / 65536;
  return static_cast<std::uint16_t>(std::lround(1000 + 5 * degrees));
}

void look_around(TimeUs, std::span<ScanPoint> beams) {
  for (ScanPoint& beam : beams) {
    beam.range_mm = range_towards(beam.bearing);
    beam.echo = Echo::kHit;
    beam.quality = 30;
  }
}

TEST(RplidarEmulator, AnswersInfoAndHealthByteForByte) {
  RplidarEmulator emulator;
  EXPECT_THAT(ask(emulator, {0xa5, 0x50}),
              ElementsAre(0xa5, 0x5a, 0x14, 0, 0, 0, 0x04, 24, 29, 1, 7, 0x1f, 0xf7, 0x17, 0, 0, 0,
                          0, 0, 0, 0, 0, 0, 0, 0, 0, 0));
  EXPECT_THAT(ask(emulator, {0xa5, 0x52}), ElementsAre(0xa5, 0x5a, 3, 0, 0, 0, 0x06, 0, 0, 0));
  EXPECT_THAT(ask(emulator, {0xa5, 0x59}),
              ElementsAre(0xa5, 0x5a, 4, 0, 0, 0, 0x15, 0xfc, 0x01, 0xfe, 0x00));
}

TEST(RplidarEmulator, AnswersTheConfigurationRequestsOfSlamtecsSdk) {
  RplidarEmulator emulator;
  EXPECT_THAT(ask(emulator, configuration_request(0x70)),
              ElementsAre(0xa5, 0x5a, 6, 0, 0, 0, 0x20, 0x70, 0, 0, 0, 2, 0));
  EXPECT_THAT(ask(emulator, configuration_request(0x7c)),
              ElementsAre(0xa5, 0x5a, 6, 0, 0, 0, 0x20, 0x7c, 0, 0, 0, 1, 0));
  // 254 us in Q8 is 0xfe00; 12 m in Q8 is 0xc00.
  EXPECT_THAT(ask(emulator, configuration_request(0x71, 1)),
              ElementsAre(0xa5, 0x5a, 8, 0, 0, 0, 0x20, 0x71, 0, 0, 0, 0x00, 0xfe, 0, 0));
  EXPECT_THAT(ask(emulator, configuration_request(0x74, 1)),
              ElementsAre(0xa5, 0x5a, 8, 0, 0, 0, 0x20, 0x74, 0, 0, 0, 0x00, 0x0c, 0, 0));
  EXPECT_THAT(ask(emulator, configuration_request(0x75, 1)),
              ElementsAre(0xa5, 0x5a, 5, 0, 0, 0, 0x20, 0x75, 0, 0, 0, 0x82));
  EXPECT_THAT(ask(emulator, configuration_request(0x7f, 1)),
              ElementsAre(0xa5, 0x5a, 12, 0, 0, 0, 0x20, 0x7f, 0, 0, 0, 'E', 'x', 'p', 'r', 'e',
                          's', 's', 0));
  EXPECT_TRUE(ask(emulator, configuration_request(0x71, 7)).empty()) << "there is no mode 7";
}

TEST(RplidarEmulator, SendsGivenPointsAsStandardNodes) {
  RplidarEmulator emulator;
  // 90 degrees to the right is 90 degrees on the wire; 12.5 m is beyond an A1.
  const ScanPoint points[] = {{BinaryAngle::from_degrees(-90), 1234, Echo::kHit, 47},
                              {BinaryAngle::from_degrees(0), 12500, Echo::kHit, 47},
                              {BinaryAngle::from_degrees(90), 3000, Echo::kClear, 47}};
  emulator.set_revolution(points);
  EXPECT_THAT(ask(emulator, kScan, 0),
              ElementsAre(0xa5, 0x5a, 5, 0, 0, 0x40, 0x81, 0x01, 0x01, 0x00, 0, 0));
  // 90 deg: 5760 << 1 | 1 = 0x2d01; 1234 mm: 4936 = 0x1348. 270 deg: 17280 << 1 | 1 = 0x8701.
  EXPECT_THAT(emulator.transmit(508 * 3), ElementsAre(0xbe, 0x01, 0x2d, 0x48, 0x13, 0x02, 0x01,
                                                      0x87, 0, 0, 0x01, 0x01, 0, 0, 0));
}

TEST(RplidarEmulator, KeepsTheSampleRateAtAnyStepWidth) {
  for (const TimeUs step_us : {100u, 10'000u, 300'000u}) {
    RplidarEmulator emulator;
    emulator.set_source(look_around);
    emulator.receive(kScan, 0);
    for (TimeUs now = 0; now <= 3'000'000; now += step_us) emulator.transmit(now);
    EXPECT_EQ(emulator.counters().samples, 3'000'000u / 508 + 1) << step_us;
  }
}

TEST(RplidarEmulator, LeavesOutSamplesAfterALongPauseInsteadOfFloodingTheLine) {
  RplidarEmulator emulator;
  emulator.receive(kScan, 0);
  emulator.transmit(0);
  EXPECT_LT(emulator.transmit(3'600'000'000).size(), 12'000u);
}

TEST(RplidarEmulator, StopsAndResetsWithItsBootText) {
  RplidarEmulator emulator;
  emulator.receive(kScan, 0);
  EXPECT_TRUE(emulator.scanning());
  emulator.transmit(10'000);
  emulator.receive(Bytes{0xa5, 0x25}, 10'000);
  EXPECT_FALSE(emulator.scanning());
  EXPECT_TRUE(emulator.transmit(90'000).empty());
  emulator.receive(Bytes{0xa5, 0x40}, 100'000);
  EXPECT_TRUE(emulator.transmit(101'000).empty());
  const Bytes text = emulator.transmit(102'000);
  EXPECT_EQ(std::string(text.begin(), text.end()),
            "RP LIDAR System.\r\nFirmware Ver 1.29 - rtm, HW Ver 7\r\nModel: 18\r\n");
}

TEST(RplidarEmulator, RefusesToScanInErrorUntilReset) {
  RplidarEmulator emulator;
  emulator.set_health({RplidarHealth::kError, 0x1234});
  EXPECT_TRUE(ask(emulator, kScan).empty());
  EXPECT_THAT(ask(emulator, {0xa5, 0x52}),
              ElementsAre(0xa5, 0x5a, 3, 0, 0, 0, 0x06, 2, 0x34, 0x12));
  ask(emulator, {0xa5, 0x40}, 1000);
  emulator.transmit(10'000);
  EXPECT_FALSE(ask(emulator, kScan, 20'000).empty());
}

TEST(RplidarEmulator, WaitsForTheMotorWhenDtrIsWired) {
  RplidarEmulatorConfig config;
  config.motor_by_dtr = true;
  config.spin_up_us = 50'000;
  RplidarEmulator emulator(config);
  EXPECT_EQ(ask(emulator, kScan, 0).size(), 7u) << "the descriptor only";
  EXPECT_TRUE(emulator.transmit(20'000).empty());
  emulator.set_motor(true, 20'000);
  EXPECT_TRUE(emulator.transmit(60'000).empty());
  emulator.transmit(71'000);
  EXPECT_FALSE(emulator.transmit(80'000).empty());
  // Force scan does not look at the motor.
  emulator.set_motor(false, 80'000);
  EXPECT_GT(ask(emulator, {0xa5, 0x21}, 90'000).size(), 7u);
}

TEST(RplidarEmulator, KnowsNoExpressScanWithOldFirmware) {
  RplidarEmulatorConfig config;
  config.info.firmware_minor = 15;
  RplidarEmulator emulator(config);
  EXPECT_TRUE(ask(emulator, kExpressScan).empty());
  EXPECT_TRUE(ask(emulator, {0xa5, 0x59}).empty());
  EXPECT_EQ(emulator.counters().bad_requests, 2u);
}

TEST(RplidarEmulator, IgnoresBrokenRequestsAndHearsTheNextOne) {
  RplidarEmulator emulator;
  Bytes broken = kExpressScan;
  broken.back() ^= 1;
  EXPECT_TRUE(ask(emulator, broken).empty());
  EXPECT_TRUE(ask(emulator, {0xa5, 0x82, 200, 1, 2, 3}, 2000).empty());
  EXPECT_EQ(ask(emulator, {0xa5, 0xa5, 0x52}, 1'000'000).size(), 10u) << "after a pause";
}

TEST(RplidarEmulator, GoesOnScanningThroughAnUnknownRequest) {
  RplidarEmulator emulator;
  ask(emulator, kScan, 0);
  // What rplidar_sdk asks an A2's accessory board; an A1 does not know it.
  ask(emulator, {0xa5, 0xff, 4, 0, 0, 0, 0, 0x5e}, 1000);
  EXPECT_TRUE(emulator.scanning());
  EXPECT_EQ(emulator.counters().bad_requests, 1u);
}

TEST(RplidarEmulator, SurvivesRandomBytes) {
  std::mt19937 random(3);
  RplidarEmulator emulator;
  emulator.set_source(look_around);
  Bytes bytes(64);
  for (TimeUs now = 0; now < 2'000'000; now += 1000) {
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() & 3 ? random() : 0xa5);
    emulator.receive(bytes, now);
    ASSERT_LT(emulator.transmit(now).size(), 100'000u);
  }
}

// The core's driver on the emulator: what goes in must come out.
class DriverOnEmulator : public testing::Test {
 protected:
  void run(TimeUs for_us) {
    for (const TimeUs end = now_ + for_us; now_ < end; now_ += 10'000) {
      port_.set_now(now_);
      driver_.step(now_);
      if (const Scan* scan = driver_.take_scan()) scans_.push_back(*scan);
    }
  }
  void expect_scans_of_the_room(std::size_t points, int tolerance_mm) {
    ASSERT_GE(scans_.size(), 2u);
    const Scan& scan = scans_.back();
    EXPECT_NEAR(static_cast<double>(scan.size), static_cast<double>(points), 1.0);
    for (const ScanPoint& point : scan.points()) {
      ASSERT_EQ(point.echo, Echo::kHit);
      const int error = point.range_mm - range_towards(point.bearing);
      // Next to zero the room's range jumps by 1800 mm.
      const double degrees = std::abs(point.bearing.degrees());
      if (degrees < 1) continue;
      ASSERT_LE(std::abs(error), tolerance_mm) << point.bearing.degrees();
    }
  }

  RplidarEmulator emulator_;
  EmulatedSerialPort port_{emulator_};
  RplidarConfig config_;
  RplidarDriver driver_{port_, config_};
  TimeUs now_ = 5'000'000;
  std::vector<Scan> scans_;
};

TEST_F(DriverOnEmulator, GetsEveryExpressPointWhereItIs) {
  emulator_.set_source(look_around);
  driver_.start(now_);
  run(2'000'000);
  EXPECT_TRUE(driver_.uses_express());
  EXPECT_GE(scans_.size(), 9u);
  expect_scans_of_the_room(716, 1);  // 1e6 / (5.5 * 254); an angle is off by 1/8 degree at most
  EXPECT_EQ(driver_.counters().resyncs, 0u);
  EXPECT_EQ(driver_.counters().dropped_frames, 0u);
}

TEST_F(DriverOnEmulator, GetsEveryStandardPointWhereItIs) {
  config_.prefer_express = false;
  RplidarDriver driver(port_, config_);
  emulator_.set_source(look_around);
  driver.start(now_);
  for (int i = 0; i < 200; ++i, now_ += 10'000) {
    port_.set_now(now_);
    driver.step(now_);
    if (const Scan* scan = driver.take_scan()) scans_.push_back(*scan);
  }
  expect_scans_of_the_room(358, 1);
}

TEST_F(DriverOnEmulator, GetsFixedPointsThroughAnExpressScan) {
  std::vector<ScanPoint> points;
  for (int i = 0; i < 361; ++i) {
    const auto bearing = BinaryAngle::from_degrees(-90 + 0.5 * i);
    points.push_back({bearing, range_towards(bearing), Echo::kHit, 20});
  }
  emulator_.set_revolution(points);
  driver_.start(now_);
  run(1'000'000);
  ASSERT_GE(scans_.size(), 2u);
  int hits = 0;
  for (const ScanPoint& point : scans_.back().points()) {
    if (point.echo != Echo::kHit) continue;
    ++hits;
    EXPECT_LE(std::abs(point.bearing.degrees()), 90.2);
    if (std::abs(point.bearing.degrees()) > 1) {
      EXPECT_NEAR(point.range_mm, range_towards(point.bearing), 1);
    }
  }
  EXPECT_NEAR(hits, 361, 5);
}

TEST_F(DriverOnEmulator, ComesBackAfterSilence) {
  emulator_.set_source(look_around);
  driver_.start(now_);
  run(1'000'000);
  emulator_.set_silent(true);
  run(5'000'000);
  EXPECT_NE(driver_.state(), RplidarState::kScanning);
  emulator_.set_silent(false);
  scans_.clear();
  run(4'000'000);
  EXPECT_EQ(driver_.state(), RplidarState::kScanning);
  expect_scans_of_the_room(716, 1);
}

TEST_F(DriverOnEmulator, LosesLittleToGarbageAndLostBytes) {
  emulator_.set_source(look_around);
  driver_.start(now_);
  run(1'000'000);
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    emulator_.inject_garbage(100 + seed, seed);
    emulator_.drop_bytes(seed);
    run(200'000);
  }
  EXPECT_EQ(driver_.counters().reconnects, 0u);
  EXPECT_GE(driver_.counters().resyncs, 15u);
  EXPECT_GE(scans_.size(), 24u);
  for (const Scan& scan : scans_) {
    for (const ScanPoint& point : scan.points()) {
      if (point.echo != Echo::kHit || std::abs(point.bearing.degrees()) < 1) continue;
      EXPECT_NEAR(point.range_mm, range_towards(point.bearing), 1);
    }
  }
}

TEST_F(DriverOnEmulator, HealsADeviceInError) {
  emulator_.set_source(look_around);
  emulator_.set_health({RplidarHealth::kError, 1});
  driver_.start(now_);
  run(3'000'000);
  EXPECT_EQ(driver_.state(), RplidarState::kScanning);
  EXPECT_EQ(driver_.counters().resets, 1u);
}

}  // namespace
}  // namespace ivfm::host
