// Acceptance by a driver that was not written for it: Slamtec's own SDK, as Debian ships it inside
// MRPT's libmrpt-hwdrivers (behind mrpt::hwdrivers::CRoboPeakLidar), talks to the emulated lidar
// through a pseudo-terminal, call by call what its program ultra_simple does.
//
// Debian ships no header of the SDK. The declarations below name what the library exports; a wrong
// one does not link. They are called without virtual dispatch, so no class layout is assumed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <mrpt/hwdrivers/CRoboPeakLidar.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "host/simulator/rplidar_terminal.h"

// The SDK's structures on the wire and in its interface (rplidar_cmd.h, rplidar_driver.h).
struct [[gnu::packed]] _rplidar_response_device_info_t {
  std::uint8_t model;
  std::uint16_t firmware_version;
  std::uint8_t hardware_version;
  std::uint8_t serialnum[16];
};
struct [[gnu::packed]] _rplidar_response_device_health_t {
  std::uint8_t status;
  std::uint16_t error_code;
};
struct [[gnu::packed]] rplidar_response_measurement_node_hq_t {
  std::uint16_t angle_z_q14;
  std::uint32_t dist_mm_q2;
  std::uint8_t quality;
  std::uint8_t flag;
};

namespace rp::standalone::rplidar {

struct RplidarScanMode {
  std::uint16_t id;
  float us_per_sample;
  float max_distance;
  std::uint8_t ans_type;
  char scan_mode[64];
};

class RPlidarDriver {
 public:
  static RPlidarDriver* CreateDriver(unsigned kind);
  static void DisposeDriver(RPlidarDriver* driver);
};

class RPlidarDriverImplCommon {
 public:
  unsigned getDeviceInfo(_rplidar_response_device_info_t& info, unsigned timeout_ms);
  unsigned getHealth(_rplidar_response_device_health_t& health, unsigned timeout_ms);
  unsigned startMotor();
  unsigned stopMotor();
  unsigned startScan(bool force, bool typical, unsigned options, RplidarScanMode* used);
  unsigned stop(unsigned timeout_ms);
  unsigned grabScanDataHq(rplidar_response_measurement_node_hq_t* nodes, std::size_t& count,
                          unsigned timeout_ms);
  unsigned ascendScanData(rplidar_response_measurement_node_hq_t* nodes, std::size_t count);
};

class RPlidarDriverSerial : public RPlidarDriverImplCommon {
 public:
  unsigned connect(const char* path, unsigned baud, unsigned flag);
};

}  // namespace rp::standalone::rplidar

// The SDK forgets to free its serial channel.
extern "C" const char* __lsan_default_suppressions() { return "leak:libmrpt-hwdrivers"; }

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;
namespace sdk = rp::standalone::rplidar;

constexpr unsigned kSerialDriver = 0, kOk = 0, kTimeoutMs = 4000;

// 1000 mm plus 5 mm a degree, clockwise.
double range_mm_at(double clockwise_deg) { return 1000 + 5 * clockwise_deg; }

void look_around(TimeUs, std::span<ScanPoint> beams) {
  for (ScanPoint& beam : beams) {
    const double clockwise_deg = (-beam.bearing).raw() * 360.0 / 65536;
    beam.range_mm = static_cast<std::uint16_t>(std::lround(range_mm_at(clockwise_deg)));
    beam.echo = Echo::kHit;
    beam.quality = 30;
  }
}

class SlamtecSdk : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "ivfm-sdk-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    dir_ = pattern;
    lidar_ = std::make_unique<RplidarTerminal>(dir_ / "robot1.lidar");
    lidar_->emulator().set_source(look_around);
    device_ = std::jthread([this](std::stop_token stop) {
      const auto start = std::chrono::steady_clock::now();
      while (!stop.stop_requested()) {
        const auto elapsed = std::chrono::steady_clock::now() - start;
        {
          const std::lock_guard lock(mutex_);
          lidar_->step(static_cast<TimeUs>(elapsed / std::chrono::microseconds(1)));
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(2));
      }
    });
    driver_ = sdk::RPlidarDriver::CreateDriver(kSerialDriver);
    ASSERT_NE(driver_, nullptr);
  }
  void TearDown() override {
    if (driver_ != nullptr) sdk::RPlidarDriver::DisposeDriver(driver_);
    device_.request_stop();
    device_.join();
    lidar_.reset();
    fs::remove_all(dir_);
  }
  sdk::RPlidarDriverSerial& driver() {
    return *static_cast<sdk::RPlidarDriverSerial*>(static_cast<void*>(driver_));
  }
  unsigned connect() { return driver().connect((dir_ / "robot1.lidar").c_str(), 115200, 0); }
  // One revolution, sorted by angle; every sample must lie where the emulator put it.
  std::size_t grab_and_check(double tolerance_mm) {
    std::vector<rplidar_response_measurement_node_hq_t> nodes(8192);
    std::size_t count = nodes.size();
    EXPECT_EQ(driver().grabScanDataHq(nodes.data(), count, kTimeoutMs), kOk);
    EXPECT_EQ(driver().ascendScanData(nodes.data(), count), kOk);
    for (std::size_t i = 0; i < count; ++i) {
      const double angle_deg = nodes[i].angle_z_q14 * 90.0 / 16384;
      if (angle_deg < 1 || angle_deg > 359) continue;
      EXPECT_NEAR(nodes[i].dist_mm_q2 / 4.0, range_mm_at(angle_deg), tolerance_mm) << angle_deg;
    }
    return count;
  }

  fs::path dir_;
  std::mutex mutex_;  // guards lidar_
  std::unique_ptr<RplidarTerminal> lidar_;
  sdk::RPlidarDriver* driver_ = nullptr;
  std::jthread device_;
};

TEST_F(SlamtecSdk, ConnectsReadsInfoAndHealthAndGetsExpressScans) {
  ASSERT_EQ(connect(), kOk);
  _rplidar_response_device_info_t info{};
  ASSERT_EQ(driver().getDeviceInfo(info, kTimeoutMs), kOk);
  EXPECT_EQ(info.model, 24);
  EXPECT_EQ(info.firmware_version, (1 << 8) + 29);
  EXPECT_EQ(info.serialnum[1], 0xf7);
  _rplidar_response_device_health_t health{9, 9};
  ASSERT_EQ(driver().getHealth(health, kTimeoutMs), kOk);
  EXPECT_EQ(health.status, 0);

  driver().startMotor();
  sdk::RplidarScanMode mode{};
  ASSERT_EQ(driver().startScan(false, true, 0, &mode), kOk);
  EXPECT_EQ(std::string(mode.scan_mode), "Express");
  EXPECT_EQ(mode.us_per_sample, 254);
  EXPECT_EQ(mode.max_distance, 12);
  EXPECT_EQ(mode.ans_type, 0x82);
  grab_and_check(2);  // the first one may have begun before the motor was steady
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(static_cast<double>(grab_and_check(2)), 716, 2);
  EXPECT_EQ(driver().stop(kTimeoutMs), kOk);
  driver().stopMotor();
}

TEST_F(SlamtecSdk, GetsStandardScans) {
  ASSERT_EQ(connect(), kOk);
  sdk::RplidarScanMode mode{};
  ASSERT_EQ(driver().startScan(false, false, 0, &mode), kOk);
  EXPECT_EQ(std::string(mode.scan_mode), "Standard");
  grab_and_check(2);
  for (int i = 0; i < 2; ++i) EXPECT_NEAR(static_cast<double>(grab_and_check(2)), 358, 1);
}

TEST_F(SlamtecSdk, SeesTheErrorOfASickDevice) {
  {
    const std::lock_guard lock(mutex_);
    lidar_->emulator().set_health({RplidarHealth::kError, 0x1234});
  }
  ASSERT_EQ(connect(), kOk);
  _rplidar_response_device_health_t health{};
  ASSERT_EQ(driver().getHealth(health, kTimeoutMs), kOk);
  EXPECT_EQ(health.status, 2);
  EXPECT_EQ(health.error_code, 0x1234);
}

// MRPT's class around the SDK. Its scans are not looked at: in MRPT 2.5.8 it reads the SDK's
// 90 * angle / 2^14 as if it were degrees * 64, and so puts 360 degrees into 512 slots.
TEST_F(SlamtecSdk, LetsMrptTurnTheLidarOn) {
  mrpt::hwdrivers::CRoboPeakLidar lidar;
  lidar.setSerialPort((dir_ / "robot1.lidar").string());
  EXPECT_TRUE(lidar.turnOn());  // connects, reads info and health, starts a scan and the motor
  EXPECT_TRUE(lidar.turnOff());
}

}  // namespace
}  // namespace ivfm::host
