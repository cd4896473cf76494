// A robot in one process: agent, emulated lidar and drives, a body in a world, and a recorder on
// the agent's ports. Host only.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "firmware/hal/fake/fake_can_bus.h"
#include "host/environment/random.h"
#include "host/environment/ray_caster.h"
#include "host/map_server/team_radio.h"
#include "host/simulator/cia402_emulator.h"
#include "host/simulator/emulated_serial_port.h"
#include "host/simulator/robot_body.h"
#include "tests/replay/recording_ports.h"

namespace ivfm::replay {

class SimulatedRobot {
 public:
  // It stands at `start`, whatever `config` says.
  SimulatedRobot(const AgentConfig& config, const Pose& start,
                 std::shared_ptr<const host::World> world, const host::OdometryNoise& noise,
                 std::uint64_t seed, ProfileId profile = ProfileId::kMcu);

  // Lets 2 ms pass; every 10 ms the agent makes a step.
  void tick(TimeUs now_us);
  // From now on it is in this world.
  void enter(std::shared_ptr<const host::World> world);
  // Where other robots are from now on: its lidar sees them, and it drives into none of them.
  void meet(std::vector<host::TruePose> others) { others_ = std::move(others); }

  // As RobotBody's.
  void carry_to(const host::TruePose& pose) { body_.carry_to(pose); }
  void set_grip(double left, double right) { body_.set_grip(left, right); }

  Agent& agent() { return *agent_; }
  const host::RobotBody& body() const { return body_; }
  const ReplayWriter& writer() const { return writer_; }
  host::RadioQueue& radio() { return radio_; }
  std::vector<std::uint8_t> recording() { return writer_.finish(); }

 private:
  class StillClock final : public Clock {  // as in a replay: decisions take no time
   public:
    TimeUs now_us() override { return now; }
    TimeUs now = 0;
  };

  void measure(std::span<ScanPoint> beams);
  void roll_wheels();

  std::shared_ptr<const host::World> world_;
  host::RayCaster rays_;
  host::Random random_;
  host::RobotBody body_;
  std::vector<host::TruePose> others_;
  host::RplidarEmulator rplidar_;
  host::EmulatedSerialPort serial_{rplidar_};
  fake::FakeCanWire<2> wire_;
  host::Cia402Emulator left_{{.node_id = 1}}, right_{{.node_id = 2}};
  host::DriveGroup drives_{wire_.end(1), {&left_, &right_}};
  host::RadioQueue radio_;
  StillClock clock_;
  ReplayWriter writer_;
  PortRecorder recorder_{writer_, serial_, wire_.end(0), radio_};
  std::shared_ptr<Agent> agent_;
};

// `config` as a replay file keeps it: what the file has no place for is as by default.
AgentConfig as_stored(const AgentConfig& config);

}  // namespace ivfm::replay
