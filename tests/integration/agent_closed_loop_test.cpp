// The whole agent in one process and in simulated time: emulated lidar and drives on fake wires, a
// body in a small world. Explores it, allocates nothing, and stops its wheels when it has to.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <optional>

#include "firmware/agent/agent.h"
#include "firmware/agent/linux/agent_setup.h"
#include "firmware/agent/linux/telemetry.h"
#include "firmware/hal/fake/fake_can_bus.h"
#include "host/environment/ray_caster.h"
#include "host/simulator/cia402_emulator.h"
#include "host/simulator/emulated_serial_port.h"
#include "host/simulator/robot_body.h"
#include "tests/support/heap_counter.h"

namespace ivfm {
namespace {

using host::Cia402Emulator;
using host::RayCaster;
using host::World;

constexpr TimeUs kTickUs = 2'000;          // of the simulation
constexpr TimeUs kAgentPeriodUs = 10'000;  // of Agent::step()
constexpr TimeUs kSecondUs = 1'000'000;

// A room of 4 m by 3 m with a wall that reaches from the south to its middle; cells of 25 mm.
std::shared_ptr<World> make_room() {
  auto world = std::make_shared<World>();
  world->name = "room";
  world->cell_um = 25'000;
  world->width = 168;
  world->height = 128;
  world->origin = {-100'000, -100'000};
  world->occupied.assign(168 * 128, 1);
  const auto fill = [&](int x0, int y0, int x1, int y1, std::uint8_t value) {
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) {
        world->occupied[static_cast<std::size_t>(y * world->width + x)] = value;
      }
    }
  };
  fill(4, 4, 164, 124, 0);
  fill(80, 4, 86, 64, 1);
  return world;
}

// What the agent does on its devices is not its own heap use: the fakes may allocate.
class UncountedSerialPort final : public SerialPort {
 public:
  explicit UncountedSerialPort(host::EmulatedSerialPort& port) : port_(port) {}
  Result<std::size_t> read(std::span<std::uint8_t> buffer) override {
    test::HeapCounterPause pause;
    return port_.read(buffer);
  }
  Status write(std::span<const std::uint8_t> bytes) override {
    test::HeapCounterPause pause;
    return port_.write(bytes);
  }
  Status set_motor(bool on) override {
    test::HeapCounterPause pause;
    return port_.set_motor(on);
  }

 private:
  host::EmulatedSerialPort& port_;
};

// A server that never answers.
class SilentRadio final : public DatagramSocket {
 public:
  Result<std::size_t> receive(std::span<std::uint8_t>) override { return Status::kEmpty; }
  Status send(std::span<const std::uint8_t> datagram) override {
    bytes_sent += datagram.size();
    return Status::kOk;
  }
  std::size_t bytes_sent = 0;
};

class SimulatedClock final : public Clock {
 public:
  TimeUs now_us() override { return now; }
  TimeUs now = 0;
};

AgentOptions burger_options(LocalizationChoice localization, bool rough_start) {
  AgentOptions options;
  options.start_x_m = 0.5;
  options.start_y_m = 0.5;
  options.localization = localization;
  options.rough_start = rough_start;
  return options;
}

class AgentInARoom : public testing::Test {
 protected:
  using TestedAgent = AgentFor<McuProfile>;
  enum End : std::size_t { kAgentEnd, kDrivesEnd, kListenerEnd };

  explicit AgentInARoom(LocalizationChoice localization = LocalizationChoice::kOdometry,
                        bool rough_start = false) {
    rplidar_.set_beam_source([this](TimeUs, std::span<ScanPoint> beams) { measure(beams); });
    clock_.now = now_us_;
    serial_.set_now(now_us_);
    agent_ = std::make_unique<TestedAgent>(
        make_agent_config(burger_options(localization, rough_start), McuProfile::kCellUm, 1),
        AgentPorts{lidar_port_, wire_.end(kAgentEnd), radio_, clock_});
  }

  Agent& agent() { return *agent_; }

  void measure(std::span<ScanPoint> beams) const {
    const host::TruePose& pose = body_.pose();
    const Point from{static_cast<std::int32_t>(pose.x_m * 1e6),
                     static_cast<std::int32_t>(pose.y_m * 1e6)};
    const BinaryAngle heading = BinaryAngle::from_radians(pose.heading_rad);
    for (ScanPoint& beam : beams) {
      const std::int32_t range_um = rays_->cast_um(from, heading + beam.bearing, 12'000'000);
      beam.range_mm = static_cast<std::uint16_t>(range_um / 1000);
      beam.echo = range_um < 12'000'000 ? Echo::kHit : Echo::kNothing;
      beam.quality = 40;
    }
  }

  // One tick of the world, and the agent's step when it is due.
  void tick() {
    now_us_ += kTickUs;
    clock_.now = now_us_;
    wire_.advance_to(now_us_);
    drives_.step(now_us_);
    roll_wheels();
    serial_.set_now(now_us_);
    if (now_us_ % kAgentPeriodUs == 0) step_agent();
    listen();
  }
  void step_agent() {
    char line[1024];
    test::HeapCounter::start();
    agent_->step(now_us_);
    if (now_us_ % kSecondUs == 0) {
      EXPECT_GT(format_telemetry_line(*agent_, now_us_, line), 0u);
      EXPECT_GT(format_telemetry_json(*agent_, now_us_, line), 0u);
    }
    allocations_ += test::HeapCounter::stop();
  }
  void roll_wheels() {
    const double metres_per_count = 2 * std::numbers::pi * 0.033 / 4096;
    const double left = left_.ground_position(), right = right_.ground_position();
    body_.roll((left - left_counts_) * metres_per_count, (right - right_counts_) * metres_per_count,
               *world_, {});
    left_counts_ = left;
    right_counts_ = right;
  }
  // Notes when the last target velocity other than zero went over the bus.
  void listen() {
    for (auto frame = wire_.end(kListenerEnd).receive(); frame.ok();
         frame = wire_.end(kListenerEnd).receive()) {
      const bool setpoint =
          frame->id == canopen::kRpdo1Base + 1 || frame->id == canopen::kRpdo1Base + 2;
      if (setpoint && frame->size >= 6 && canopen::get_i32(*frame, 2) != 0) moving_us_ = now_us_;
    }
  }
  void run_for(TimeUs duration_us) {
    for (const TimeUs end = now_us_ + duration_us; now_us_ < end;) tick();
  }
  template <typename Condition>
  bool run_until(Condition condition, TimeUs limit_us) {
    for (const TimeUs end = now_us_ + limit_us; now_us_ < end;) {
      tick();
      if (condition()) return true;
    }
    return false;
  }
  // Puts obstacles where `there`(x, y in metres) says so.
  template <typename Place>
  void put_up(Place there) {
    for (std::int32_t row = 0; row < world_->height; ++row) {
      for (std::int32_t column = 0; column < world_->width; ++column) {
        const double x = (world_->origin.x_um + (column + 0.5) * world_->cell_um) * 1e-6;
        const double y = (world_->origin.y_um + (row + 0.5) * world_->cell_um) * 1e-6;
        if (!there(x, y)) continue;
        world_->occupied[static_cast<std::size_t>(row * world_->width + column)] = 1;
      }
    }
    rays_ = std::make_shared<RayCaster>(world_);
  }
  bool wheels_turn() const { return left_.wheel_speed() != 0 || right_.wheel_speed() != 0; }
  bool drives_straight() const {
    return left_.wheel_speed() > 3'000 && right_.wheel_speed() > 3'000;
  }
  void drive_off() {
    ASSERT_TRUE(run_until([&] { return drives_straight(); }, 30 * kSecondUs));
  }
  // From now on the last setpoint with motion may come no later than `deadline_us` and 100 ms from
  // now, and then both wheels stand, too.
  void expect_wheels_stop_within(TimeUs deadline_us) {
    const TimeUs begin_us = now_us_;
    run_for(deadline_us + 100'000);
    EXPECT_LE(moving_us_, begin_us + deadline_us + 50'000) << "setpoints on the bus";
    EXPECT_EQ(left_.wheel_speed(), 0);
    EXPECT_EQ(right_.wheel_speed(), 0);
    run_for(200'000);
    EXPECT_FALSE(wheels_turn()) << "and stays";
  }
  void expect_drives_again() {
    EXPECT_TRUE(run_until([&] { return wheels_turn(); }, 20 * kSecondUs));
    EXPECT_EQ(agent().state(), RobotState::kExploring);
  }

  std::shared_ptr<World> world_ = make_room();
  std::shared_ptr<RayCaster> rays_ = std::make_shared<RayCaster>(world_);
  host::RobotBody body_{{}, {0.5, 0.5, 0}, host::OdometryNoise::preset("none"), 1};
  host::RplidarEmulator rplidar_;
  host::EmulatedSerialPort serial_{rplidar_};
  UncountedSerialPort lidar_port_{serial_};
  fake::FakeCanWire<3> wire_;
  Cia402Emulator left_{{.node_id = 1}};
  Cia402Emulator right_{{.node_id = 2}};
  host::DriveGroup drives_{wire_.end(kDrivesEnd), {&left_, &right_}};
  SilentRadio radio_;
  SimulatedClock clock_;
  std::unique_ptr<TestedAgent> agent_;
  double left_counts_ = 0, right_counts_ = 0;
  std::size_t allocations_ = 0;
  TimeUs now_us_ = 5 * kSecondUs;
  TimeUs moving_us_ = 0;
};

TEST_F(AgentInARoom, ExploresEverythingWithoutACollisionOrAHeapAllocation) {
  EXPECT_TRUE(run_until([&] { return agent().state() == RobotState::kExplored; }, 240 * kSecondUs));
  EXPECT_EQ(allocations_, 0u);
  EXPECT_EQ(body_.collisions(), 0);
  EXPECT_GT(radio_.bytes_sent, 0u);
  EXPECT_LE(agent_->progress().stuck, 2u);
  int free_cells = 0, known = 0;
  const ExplorationMap& map = agent_->explorer().map();
  for (std::int32_t y = 0; y < 60; ++y) {
    for (std::int32_t x = 0; x < 80; ++x) {
      if (world_->is_occupied(map.frame().center_of({x, y}))) continue;
      ++free_cells;
      known += map.is_known_free({x, y}) || map.is_obstacle({x, y}) ? 1 : 0;
    }
  }
  EXPECT_GT(known, free_cells * 95 / 100);
  run_for(kSecondUs);
  EXPECT_FALSE(wheels_turn());
}

TEST_F(AgentInARoom, StopsWhenTheLidarFallsSilentAndGoesOnAfterwards) {
  drive_off();
  rplidar_.set_silent(true);
  expect_wheels_stop_within(455'000);
  EXPECT_TRUE(agent_->supervisor().reasons().has(StopReason::kLidarStale));
  rplidar_.set_silent(false);
  expect_drives_again();
}

TEST_F(AgentInARoom, StopsWhenOdometryFallsSilent) {
  drive_off();
  wire_.faults(kDrivesEnd).drop_id = canopen::kTpdo2Base + 1;
  expect_wheels_stop_within(100'000);
  wire_.faults(kDrivesEnd).drop_id = 0xffff;
  expect_drives_again();
}

TEST_F(AgentInARoom, StopsBothWheelsWhenOneDriveIsLost) {
  drive_off();
  right_.raise_fault(0x7305);  // incremental encoder
  expect_wheels_stop_within(100'000);
  expect_drives_again();
}

TEST_F(AgentInARoom, StopsTheOtherWheelWhenADriveFallsSilent) {
  drive_off();
  right_.set_silent(true);
  run_for(200'000);
  EXPECT_EQ(left_.wheel_speed(), 0);
}

TEST_F(AgentInARoom, StopsBeforeAnObstacleThatAppearsInItsWay) {
  drive_off();
  // A box of 0.1 m across whose near side is 0.2 m before the robot's front.
  const host::TruePose pose = body_.pose();
  const double ahead = body_.shape().radius_m + 0.2 + 0.05;
  const double x = pose.x_m + ahead * std::cos(pose.heading_rad);
  const double y = pose.y_m + ahead * std::sin(pose.heading_rad);
  put_up([&](double cx, double cy) { return std::abs(cx - x) < 0.05 && std::abs(cy - y) < 0.05; });
  run_for(60 * kSecondUs);
  EXPECT_EQ(body_.collisions(), 0);
}

// As when other robots stand around it: there is nothing to do until they have left.
TEST_F(AgentInARoom, GoesOnWhenWhatBoxedItInHasLeft) {
  const World room = *world_;
  put_up([](double x, double y) { return std::abs(std::hypot(x - 0.5, y - 0.5) - 0.3) < 0.05; });
  ASSERT_TRUE(run_until([&] { return agent().state() == RobotState::kExplored; }, 60 * kSecondUs));
  run_for(10 * kSecondUs);
  EXPECT_EQ(agent().state(), RobotState::kExplored);
  *world_ = room;
  rays_ = std::make_shared<RayCaster>(world_);
  EXPECT_TRUE(run_until([&] { return body_.travelled_m() > 2; }, 60 * kSecondUs));
  EXPECT_EQ(allocations_, 0u);
}

TEST_F(AgentInARoom, StopsOnAStopCommandForGood) {
  drive_off();
  agent_->request_stop();
  expect_wheels_stop_within(0);
  run_for(3 * kSecondUs);
  EXPECT_FALSE(wheels_turn());
  EXPECT_EQ(agent().state(), RobotState::kStopped);
}

TEST_F(AgentInARoom, StopsWhenTimeGoesBackAndRecovers) {
  drive_off();
  agent_->step(now_us_ - kSecondUs);
  const TimeUs begin_us = now_us_;
  run_for(100'000);
  EXPECT_LE(moving_us_, begin_us + 50'000);
  EXPECT_FALSE(wheels_turn());
  expect_drives_again();
}

class RoughlyPlacedAgent : public AgentInARoom {
 protected:
  RoughlyPlacedAgent() : AgentInARoom(LocalizationChoice::kMatching, true) {}
};

TEST_F(RoughlyPlacedAgent, StandsAndPaintsNothingUntilItKnowsWhetherOthersKnowThePlace) {
  run_for(3 * kSecondUs);
  EXPECT_EQ(agent().start_pose(), StartPose::kSearching);
  EXPECT_EQ(agent().state(), RobotState::kBoot);
  EXPECT_EQ(agent().progress().scans_fused, 0u);
  EXPECT_EQ(agent().odometry().travelled_um(), 0u);
  ASSERT_TRUE(
      run_until([&] { return agent().start_pose() == StartPose::kNotFound; }, 30 * kSecondUs));
  EXPECT_TRUE(run_until([&] { return agent().state() == RobotState::kExploring; }, 5 * kSecondUs));
  EXPECT_EQ(allocations_, 0u);
}

class MatchingAgentInARoom : public AgentInARoom {
 protected:
  MatchingAgentInARoom() : AgentInARoom(LocalizationChoice::kMatching) {}
};

TEST_F(MatchingAgentInARoom, ExploresTheWholeRoom) {
  EXPECT_TRUE(run_until([&] { return agent().state() == RobotState::kExplored; }, 240 * kSecondUs));
  EXPECT_EQ(agent().localization().counters().lost, 0u);
  EXPECT_EQ(body_.collisions(), 0);
  EXPECT_EQ(allocations_, 0u);
}

TEST_F(MatchingAgentInARoom, FindsItsPlaceAgainAfterBeingCarriedAway) {
  ASSERT_TRUE(
      run_until([&] { return agent().odometry().travelled_um() > 2'000'000; }, 120 * kSecondUs));
  const std::uint32_t fused = agent().progress().scans_fused;
  const host::TruePose there{1.2, 2.2, 2.0};
  body_ = host::RobotBody({}, there, host::OdometryNoise::preset("none"), 1);
  ASSERT_TRUE(run_until([&] { return agent().localization().lost(); }, 2 * kSecondUs));
  EXPECT_LE(agent().progress().scans_fused, fused + 1) << "nothing is painted in a wrong place";
  run_for(150'000);
  EXPECT_FALSE(wheels_turn());
  EXPECT_EQ(agent().state(), RobotState::kFault);
  EXPECT_TRUE(agent().supervisor().reasons().has(StopReason::kLost));
  ASSERT_TRUE(run_until([&] { return !agent().localization().lost(); }, 30 * kSecondUs));
  EXPECT_NEAR(agent().pose().position.x_um * 1e-6, body_.pose().x_m, 0.05);
  EXPECT_NEAR(agent().pose().position.y_um * 1e-6, body_.pose().y_m, 0.05);
  EXPECT_NEAR(std::remainder(agent().pose().heading.radians() - body_.pose().heading_rad,
                             2 * std::numbers::pi),
              0, 0.02);
  EXPECT_EQ(allocations_, 0u);
  ASSERT_TRUE(run_until([&] { return agent().state() != RobotState::kFault; }, 5 * kSecondUs));
  EXPECT_TRUE(run_until([&] { return agent().state() == RobotState::kExplored; }, 240 * kSecondUs));
  EXPECT_EQ(body_.collisions(), 0);
}

TEST_F(MatchingAgentInARoom, SaysThatItIsLostInAPlaceThatIsNotInItsMap) {
  drive_off();
  const std::uint32_t fused = agent().progress().scans_fused;
  // Another room: round, 3 m across.
  for (std::int32_t row = 0; row < world_->height; ++row) {
    for (std::int32_t column = 0; column < world_->width; ++column) {
      const double dx = column - 84, dy = row - 64;
      world_->occupied[static_cast<std::size_t>(row * world_->width + column)] =
          std::hypot(dx, dy) > 60 ? 1 : 0;
    }
  }
  rays_ = std::make_shared<RayCaster>(world_);
  body_ = host::RobotBody({}, {2.0, 1.5, 0}, host::OdometryNoise::preset("none"), 1);
  ASSERT_TRUE(
      run_until([&] { return agent().localization().counters().searches > 0; }, 60 * kSecondUs));
  EXPECT_TRUE(agent().localization().lost());
  EXPECT_EQ(agent().state(), RobotState::kFault);
  EXPECT_FALSE(wheels_turn());
  EXPECT_LE(agent().progress().scans_fused, fused + 2);
}

TEST(AgentSize, TheMcuProfileFitsInto300KiB) {
  EXPECT_LE(sizeof(AgentFor<McuProfile>), 300u * 1024);
  std::printf("sizeof(Agent): paper %zu, robot %zu, mcu %zu bytes\n",
              sizeof(AgentFor<PaperProfile>), sizeof(AgentFor<RobotProfile>),
              sizeof(AgentFor<McuProfile>));
}

}  // namespace
}  // namespace ivfm
