// The simulated world in motion: robots' bodies, their lidars and drives, faults, ground truth.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <random>
#include <span>
#include <vector>

#include "firmware/hal/can_bus.h"
#include "firmware/wheel_drive/diff_drive_kinematics.h"
#include "host/simulator/cia402_emulator.h"
#include "host/simulator/doors.h"
#include "host/simulator/fault_plan.h"
#include "host/simulator/mrpt_lidar.h"
#include "host/simulator/robot_body.h"
#include "host/simulator/rplidar_terminal.h"
#include "host/simulator/scan_recorder.h"
#include "host/simulator/walkers.h"
#include "host/simulator/world_catalog.h"

namespace ivfm::host {

struct SimulationConfig {
  WheelGeometry wheels;  // must be the agents'
  OdometryNoise odometry;
  LidarModel lidar;
  RplidarEmulatorConfig rplidar;
  std::vector<Fault> faults;
  int walkers = 0;
  std::vector<Door> doors;
  std::uint64_t seed = 1;
};

// A bus that loses frames both ways with a probability.
class LossyCanBus final : public CanBus {
 public:
  LossyCanBus(CanBus& bus, std::uint64_t seed) : bus_(bus), random_(seed) {}
  void set_loss(double probability) { loss_ = probability; }
  Result<CanFrame> receive() override;
  Status send(const CanFrame& frame) override;

 private:
  bool lose();

  CanBus& bus_;
  double loss_ = 0;
  std::mt19937_64 random_;
};

// One simulated robot: what its agent is connected to, and its body.
class SimulatedRobot {
 public:
  // `number`: 1 .. ; `lidar_link`: the path that becomes the lidar's serial line; `bus`: where its
  // two drives are. `world` and `bus` must outlive this object.
  SimulatedRobot(int number, const PreparedWorld& world, const SimulationConfig& config,
                 std::filesystem::path lidar_link, CanBus& bus);
  SimulatedRobot(const SimulatedRobot&) = delete;
  SimulatedRobot& operator=(const SimulatedRobot&) = delete;

  // Moves this robot on to `now_us`; `others`: where the other robots and people's legs are.
  void step(TimeUs now_us, std::span<const TruePose> others);

  int number() const { return number_; }
  const RobotBody& body() const { return body_; }
  RplidarTerminal& lidar() { return terminal_; }
  // From now on `recorder` is told what the lidar measures. It must outlive this object.
  void record_scans(ScanRecorder& recorder) { recorder_ = &recorder; }
  // A door has opened or closed.
  void take_world() { rays_.take_world(world_); }
  std::uint32_t lost_frames() const { return drives_.lost_frames(); }

 private:
  void apply_faults(TimeUs now_us);
  void measure(TimeUs now_us, std::span<ScanPoint> beams);

  int number_;
  const World& world_;
  const SimulationConfig& config_;
  RobotBody body_;
  MrptLidar rays_;
  RplidarTerminal terminal_;
  LossyCanBus bus_;
  Cia402Emulator left_, right_;
  DriveGroup drives_;
  double metres_per_count_;
  TimeUs next_garbage_us_ = 0;
  ScanRecorder* recorder_ = nullptr;
  std::vector<bool> fault_begun_;
  std::vector<TruePose> others_;
};

// All robots in one world.
class Simulation {
 public:
  static constexpr TimeUs kTickUs = 5'000;  // 200 Hz

  // `lidar_links` and `buses`: one a robot. Buses must outlive this object.
  Simulation(PreparedWorld world, SimulationConfig config,
             const std::vector<std::filesystem::path>& lidar_links,
             const std::vector<CanBus*>& buses);

  // One more fault, besides those of the configuration.
  void add_fault(const Fault& fault) { config_.faults.push_back(fault); }

  // Moves everything on to `now_us` of simulated time, in ticks of kTickUs.
  void advance_to(TimeUs now_us);

  TimeUs now_us() const { return now_us_; }
  const PreparedWorld& world() const { return world_; }
  const std::vector<std::unique_ptr<SimulatedRobot>>& robots() const { return robots_; }
  const Walkers& walkers() const { return walkers_; }
  int collisions() const;

 private:
  void move_doors(std::span<const TruePose> robots);

  PreparedWorld world_;
  SimulationConfig config_;
  std::vector<std::unique_ptr<SimulatedRobot>> robots_;
  Walkers walkers_;
  Doors doors_;
  TimeUs now_us_ = 0;
};

}  // namespace ivfm::host
