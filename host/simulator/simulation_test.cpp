#include "host/simulator/simulation.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <cmath>

#include "firmware/hal/fake/fake_can_bus.h"
#include "firmware/hal/linux/linux_serial_port.h"
#include "firmware/lidar/rplidar_driver.h"
#include "firmware/wheel_drive/wheel_drive.h"

namespace ivfm::host {
namespace {

// A room of 6 m x 6 m around the origin, walls 0.1 m thick inside its edge, robots in the middle.
PreparedWorld room(std::vector<Pose> starts) {
  PreparedWorld prepared;
  prepared.world = {
      "room", 50'000, 120, 120, {-3'000'000, -3'000'000}, std::vector<std::uint8_t>(120 * 120, 0)};
  for (std::size_t i = 0; i < 120; ++i) {
    for (const std::size_t edge : {0u, 1u, 118u, 119u}) {
      prepared.world.occupied[edge * 120 + i] = prepared.world.occupied[i * 120 + edge] = 1;
    }
  }
  prepared.starts = std::move(starts);
  return prepared;
}

SimulationConfig exact() {
  SimulationConfig config;
  config.lidar = LidarModel::preset("none");
  return config;
}

// One simulated robot with the firmware's own drivers at the other ends, in lockstep.
class RobotInRoom : public testing::Test {
 protected:
  RobotInRoom() {
    std::string pattern = (std::filesystem::temp_directory_path() / "ivfm_sim_XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  ~RobotInRoom() override {
    simulation_.reset();
    std::filesystem::remove_all(folder_);
  }

  void start(const PreparedWorld& world, const SimulationConfig& config) {
    const auto link = folder_ / "robot1.lidar";
    simulation_ = std::make_unique<Simulation>(world, config, std::vector{link},
                                               std::vector<CanBus*>{&wire_.end(1)});
    port_ = std::make_unique<LinuxSerialPort>(link.string());
    lidar_ = std::make_unique<RplidarDriver>(*port_, RplidarConfig{});
    lidar_->start(now_us_);
  }

  void run(double seconds, const Velocity& velocity) {
    for (const TimeUs end = now_us_ + static_cast<TimeUs>(seconds * 1e6); now_us_ < end;) {
      now_us_ += 5'000;
      wire_.advance_to(now_us_);
      wheels_.set_velocity(velocity);
      wheels_.step(now_us_);
      simulation_->advance_to(now_us_);
      lidar_->step(now_us_);
      if (const Scan* scan = lidar_->take_scan()) scan_ = *scan;
    }
  }

  const RobotBody& body() const { return simulation_->robots()[0]->body(); }

  std::filesystem::path folder_;
  fake::FakeCanWire<2> wire_;
  WheelDrive wheels_{WheelDriveConfig{}, wire_.end(0)};
  std::unique_ptr<Simulation> simulation_;
  std::unique_ptr<LinuxSerialPort> port_;
  std::unique_ptr<RplidarDriver> lidar_;
  Scan scan_;
  TimeUs now_us_ = 0;
};

TEST_F(RobotInRoom, DrivesWhatTheFirmwareCommands) {
  start(room({Pose{}}), exact());
  run(1, {});
  ASSERT_TRUE(wheels_.enabled(now_us_));
  run(5, {200'000, 0});
  run(1, {});
  EXPECT_NEAR(body().pose().x_m, 1, 0.08);  // less the ramps
  EXPECT_NEAR(body().pose().y_m, 0, 1e-3);
  run(2, {0, 500});
  run(1, {});
  EXPECT_NEAR(body().pose().heading_rad, 1, 0.1);
  EXPECT_EQ(simulation_->collisions(), 0);
}

TEST_F(RobotInRoom, TheLidarShowsTheWallsWhereTheyAre) {
  start(room({{{1'000'000, 0}, BinaryAngle(std::uint16_t{0x4000})}}), exact());
  run(2, {});
  ASSERT_GT(scan_.size, 300u);
  int hits = 0;
  for (const ScanPoint& point : scan_.points()) {
    if (point.echo != Echo::kHit) continue;
    // The point in the room: the robot looks along +y.
    const double angle = M_PI / 2 + point.bearing.radians();
    const double x = 1 + point.range_mm / 1e3 * std::cos(angle);
    const double y = point.range_mm / 1e3 * std::sin(angle);
    EXPECT_NEAR(std::max(std::abs(x), std::abs(y)), 2.9, 0.04);
    ++hits;
  }
  EXPECT_GT(hits, 300);
}

TEST_F(RobotInRoom, ARecordingHoldsEveryTurnOfTheLidar) {
  start(room({{{1'000'000, 0}, BinaryAngle(std::uint16_t{0x4000})}}), exact());
  ScanRecorder recorder("a room");
  simulation_->robots()[0]->record_scans(recorder);
  run(4, {});
  const auto& scans = recorder.recording().scans;
  ASSERT_GT(scans.size(), 15u);  // 5.5 Hz, less the start of the motor and the first turn
  EXPECT_EQ(scans[0].time_us, 0u);
  EXPECT_NEAR(static_cast<double>(recorder.recording().duration_us()) / 1e6 /
                  static_cast<double>(scans.size() - 1),
              0.18, 0.02);
  for (const RecordedScan& scan : scans) {
    EXPECT_EQ(scan.lidar_pose, (Pose{{1'000'000, 0}, BinaryAngle(std::uint16_t{0x4000})}));
    ASSERT_EQ(scan.ranges_mm.size(), ScanRecorder::kRays);
    for (std::size_t i = 0; i < scan.ranges_mm.size(); ++i) {
      const double angle = M_PI / 2 + scan.bearing_of(i).radians();
      const double x = 1 + scan.ranges_mm[i] / 1e3 * std::cos(angle);
      const double y = scan.ranges_mm[i] / 1e3 * std::sin(angle);
      EXPECT_NEAR(std::max(std::abs(x), std::abs(y)), 2.9, 0.06) << i;
    }
  }
}

TEST_F(RobotInRoom, StopsAtTheWallAndCountsIt) {
  start(room({{{2'000'000, 0}, BinaryAngle()}}), exact());
  run(1, {});
  run(8, {200'000, 0});
  EXPECT_NEAR(body().pose().x_m, 2.9 - 0.105, 0.01);
  EXPECT_EQ(simulation_->collisions(), 1);
}

TEST_F(RobotInRoom, FaultsComeAndGoOnTime) {
  SimulationConfig config = exact();
  config.faults = parse_faults({"lidar-silence@3s+3s", "drive-silence@10s+500ms"});
  start(room({Pose{}}), config);
  run(2.8, {});
  EXPECT_EQ(lidar_->state(), RplidarState::kScanning);
  EXPECT_TRUE(wheels_.healthy(now_us_));
  run(2, {});
  EXPECT_NE(lidar_->state(), RplidarState::kScanning);
  run(5, {});
  EXPECT_EQ(lidar_->state(), RplidarState::kScanning);
  EXPECT_TRUE(wheels_.healthy(now_us_));
  run(0.6, {});
  EXPECT_FALSE(wheels_.healthy(now_us_));
}

TEST_F(RobotInRoom, LostFramesAreSurvived) {
  SimulationConfig config = exact();
  config.faults = parse_faults({"can-drop=0.05"});
  start(room({Pose{}}), config);
  run(20, {50'000, 0});
  EXPECT_GT(body().pose().x_m, 0.1);
}

TEST(Simulation, RobotsSeeAndStopAtEachOther) {
  std::string pattern = (std::filesystem::temp_directory_path() / "ivfm_sim_XXXXXX").string();
  const std::filesystem::path folder = mkdtemp(pattern.data());
  fake::FakeCanWire<2> first, second;
  {
    Simulation simulation(room({Pose{}, {{1'000'000, 0}, BinaryAngle()}}), exact(),
                          {folder / "1", folder / "2"}, {&first.end(1), &second.end(1)});
    WheelDrive wheels(WheelDriveConfig{}, first.end(0));
    for (TimeUs now = 5'000; now < 8'000'000; now += 5'000) {
      first.advance_to(now);
      wheels.set_velocity({200'000, 0});
      wheels.step(now);
      simulation.advance_to(now);
    }
    EXPECT_NEAR(simulation.robots()[0]->body().pose().x_m, 1 - 0.21, 0.01);
    EXPECT_EQ(simulation.collisions(), 1);
  }
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace ivfm::host
