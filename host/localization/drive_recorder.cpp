#include "host/localization/drive_recorder.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <vector>

#include "firmware/agent/agent.h"
#include "firmware/agent/linux/agent_setup.h"
#include "firmware/hal/fake/fake_can_bus.h"
#include "host/environment/ray_caster.h"
#include "host/simulator/cia402_emulator.h"
#include "host/simulator/corridor_world.h"
#include "host/simulator/emulated_serial_port.h"

namespace ivfm::host {
namespace {

constexpr TimeUs kTickUs = 2'000;
constexpr TimeUs kStepUs = 10'000;  // of the agent
constexpr TimeUs kStartUs = 5'000'000;
constexpr std::int32_t kLidarRangeUm = 12'000'000;
constexpr std::int32_t kBlindUm = 150'000;

class SilentRadio final : public DatagramSocket {
 public:
  Result<std::size_t> receive(std::span<std::uint8_t>) override { return Status::kEmpty; }
  Status send(std::span<const std::uint8_t>) override { return Status::kOk; }
};

class SimulatedClock final : public Clock {
 public:
  TimeUs now_us() override { return now; }
  TimeUs now = kStartUs;
};

// Passes the lidar's bytes on to the agent, and the same bytes to a second driver.
class SerialTap final : public SerialPort {
 public:
  explicit SerialTap(SerialPort& port) : port_(port) {}
  Result<std::size_t> read(std::span<std::uint8_t> buffer) override {
    const Result<std::size_t> got = port_.read(buffer);
    if (got.ok()) {
      heard_.insert(heard_.end(), buffer.begin(),
                    buffer.begin() + static_cast<std::ptrdiff_t>(*got));
    }
    return got;
  }
  Status write(std::span<const std::uint8_t> bytes) override { return port_.write(bytes); }
  Status set_motor(bool on) override { return port_.set_motor(on); }
  std::vector<std::uint8_t>& heard() { return heard_; }

 private:
  SerialPort& port_;
  std::vector<std::uint8_t> heard_;
};

// What a SerialTap has heard; says nothing itself.
class ListeningPort final : public SerialPort {
 public:
  explicit ListeningPort(SerialTap& tap) : tap_(tap) {}
  Result<std::size_t> read(std::span<std::uint8_t> buffer) override {
    std::vector<std::uint8_t>& heard = tap_.heard();
    const std::size_t size = std::min(buffer.size(), heard.size());
    const auto end = heard.begin() + static_cast<std::ptrdiff_t>(size);
    std::copy(heard.begin(), end, buffer.begin());
    heard.erase(heard.begin(), end);
    return size;
  }
  Status write(std::span<const std::uint8_t>) override { return Status::kOk; }
  Status set_motor(bool) override { return Status::kOk; }

 private:
  SerialTap& tap_;
};

// The map frame of a drive, placed in the world.
struct MapFrame {
  TruePose in_world;
  TruePose from_world(const TruePose& p) const {
    const double dx = p.x_m - in_world.x_m, dy = p.y_m - in_world.y_m;
    const double c = std::cos(in_world.heading_rad), s = std::sin(in_world.heading_rad);
    return {c * dx + s * dy, c * dy - s * dx,
            std::remainder(p.heading_rad - in_world.heading_rad, 2 * std::numbers::pi)};
  }
};

class Recorder {
 public:
  Recorder(std::shared_ptr<const World> world, const TruePose& start, std::uint64_t seed)
      : world_(std::move(world)), rays_(world_), body_({}, start, {}, seed) {
    const double n = static_cast<double>(seed);
    frame_ = {{0.013 * n, 0.029 * n, 0.13 * (n - 1)}};
    lidar_.set_beam_source([this](TimeUs, std::span<ScanPoint> beams) { measure(beams); });
    serial_.set_now(clock_.now);
    AgentOptions options;
    options.localization = LocalizationChoice::kOdometry;  // exact here
    AgentConfig config = make_agent_config(options, RobotProfile::kCellUm, 1);
    config.start = to_pose(frame_.from_world(start));
    log_.start = config.start;
    log_.wheels = config.wheels.geometry;
    listener_.emplace(listening_, config.lidar);
    agent_ = std::make_unique<AgentFor<RobotProfile>>(
        config, AgentPorts{tap_, wire_.end(0), radio_, clock_});
  }

  DriveLog run(double metres) {
    const TimeUs end_us = clock_.now + static_cast<TimeUs>(metres / 0.05 * 1e6);
    while (clock_.now < end_us && body_.travelled_m() < metres &&
           agent_->state() != RobotState::kExplored) {
      tick();
    }
    log_.driven_m = body_.travelled_m();
    return std::move(log_);
  }

 private:
  void tick() {
    clock_.now += kTickUs;
    wire_.advance_to(clock_.now);
    drives_.step(clock_.now);
    const double metres_per_count =
        log_.wheels.wheel_circumference_um * 1e-6 / log_.wheels.counts_per_turn;
    body_.roll_to(left_.ground_position(), right_.ground_position(), metres_per_count, *world_, {});
    serial_.set_now(clock_.now);
    if (clock_.now % kStepUs != 0) return;
    agent_->step(clock_.now);
    record();
  }

  void record() {
    const WheelDrive::Positions& wheels = agent_->wheels().positions();
    if (wheels.valid && wheels.measured_us != positions_us_) {
      positions_us_ = wheels.measured_us;
      log_.wheel_samples.push_back({clock_.now, wheels.measured_us, wheels.left, wheels.right});
      log_.truth.push_back({clock_.now, sampled_});
    }
    sampled_ = frame_.from_world(body_.pose());
    listener_->start(clock_.now);
    (void)listener_->step(clock_.now);
    const Scan* scan = listener_->take_scan();
    if (scan == nullptr) return;
    const auto points = scan->points();
    log_.revolutions.push_back({clock_.now,
                                listener_->scan_start_us(),
                                listener_->scan_end_us(),
                                {points.begin(), points.end()}});
  }

  void measure(std::span<ScanPoint> beams) {
    const Pose pose = to_pose(body_.pose());
    for (ScanPoint& beam : beams) {
      const std::int32_t range_um =
          rays_.cast_um(pose.position, pose.heading + beam.bearing, kLidarRangeUm);
      beam.range_mm = static_cast<std::uint16_t>((range_um + 500) / 1000);
      beam.echo = range_um < kLidarRangeUm && range_um > kBlindUm ? Echo::kHit : Echo::kNothing;
      beam.quality = 40;
    }
  }

  std::shared_ptr<const World> world_;
  RayCaster rays_;
  MapFrame frame_;
  RobotBody body_;
  RplidarEmulator lidar_;
  EmulatedSerialPort serial_{lidar_};
  SerialTap tap_{serial_};
  ListeningPort listening_{tap_};
  std::optional<RplidarDriver> listener_;
  fake::FakeCanWire<3> wire_;
  Cia402Emulator left_{{.node_id = 1}}, right_{{.node_id = 2}};
  DriveGroup drives_{wire_.end(1), {&left_, &right_}};
  SilentRadio radio_;
  SimulatedClock clock_;
  TimeUs positions_us_ = 0;
  TruePose sampled_;  // at the last step, when the drives took the positions that come next
  DriveLog log_;
  std::unique_ptr<AgentFor<RobotProfile>> agent_;
};

}  // namespace

DriveLog record_drive(const DriveRequest& request) {
  const bool corridor = request.world == "corridor";
  if (!corridor && request.world != "malaga") {
    throw std::invalid_argument("world '" + request.world + "' is unknown: use corridor or malaga");
  }
  const auto world = std::make_shared<World>(corridor ? corridor_world() : malaga_world());
  TruePose start = corridor ? TruePose{2.4, -11, 0} : TruePose{};
  if (request.second_robot) start.heading_rad = std::numbers::pi;
  const auto recorder = std::make_unique<Recorder>(world, start, request.seed);
  return recorder->run(request.metres);
}

}  // namespace ivfm::host
