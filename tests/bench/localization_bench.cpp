// How far the agent's pose is from the truth, by odometry alone and by matching, along the same
// drives: the whole agent in process and in simulated time explores a world. Deterministic.
// Usage: localization_bench WORLD PRESET SEEDS METRES [odometry|matching]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <numbers>
#include <random>
#include <string>

#include "firmware/agent/agent.h"
#include "firmware/agent/linux/agent_setup.h"
#include "firmware/hal/fake/fake_can_bus.h"
#include "host/environment/ray_caster.h"
#include "host/simulator/cia402_emulator.h"
#include "host/simulator/corridor_world.h"
#include "host/simulator/emulated_serial_port.h"
#include "host/simulator/robot_body.h"

namespace ivfm::host {
namespace {

constexpr TimeUs kTickUs = 2'000;
constexpr TimeUs kStartUs = 5'000'000;
constexpr double kMetresPerCount = 2 * std::numbers::pi * 0.033 / 4096;

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

// Errors against the truth, sampled at an even pace.
class Errors {
 public:
  void add(double position_m, double heading_deg) {
    ++count_;
    squares_ += position_m * position_m;
    heading_squares_ += heading_deg * heading_deg;
    max_m = std::max(max_m, position_m);
    max_deg = std::max(max_deg, std::abs(heading_deg));
  }
  double rms_m() const { return std::sqrt(squares_ / std::max(count_, 1)); }
  double rms_deg() const { return std::sqrt(heading_squares_ / std::max(count_, 1)); }
  double max_m = 0, max_deg = 0;

 private:
  int count_ = 0;
  double squares_ = 0, heading_squares_ = 0;
};

// The map frame of a run, placed in the world: every run has its walls at other angles and other
// places within the cells.
struct MapFrame {
  double x_m = 0, y_m = 0, heading_rad = 0;
  TruePose from_world(const TruePose& p) const {
    const double dx = p.x_m - x_m, dy = p.y_m - y_m;
    const double c = std::cos(heading_rad), s = std::sin(heading_rad);
    return {c * dx + s * dy, c * dy - s * dx, p.heading_rad - heading_rad};
  }
};

struct Run {
  Errors odometry, estimate;
  double driven_m = 0, occupied_m2 = 0, seen_m2 = 0;
  int collisions = 0;
  LocalizationCounters matches;
};

struct BenchOptions {
  std::string world, preset;
  unsigned seeds = 10;
  double metres = 100;
  bool matching = true;
};

class Drive {
 public:
  Drive(std::shared_ptr<const World> world, const TruePose& start, const BenchOptions& options,
        unsigned seed)
      : world_(std::move(world)),
        rays_(world_),
        frame_{0.013 * seed, 0.029 * seed, 0.13 * (seed - 1)},
        body_({}, start, OdometryNoise::preset(options.preset), seed),
        random_(seed) {
    lidar_.set_beam_source([this](TimeUs, std::span<ScanPoint> beams) { measure(beams); });
    serial_.set_now(clock_.now);
    const TruePose in_map = frame_.from_world(start);
    AgentOptions agent_options;
    AgentConfig config = make_agent_config(agent_options, RobotProfile::kCellUm, 1);
    config.start = {
        {static_cast<std::int32_t>(in_map.x_m * 1e6), static_cast<std::int32_t>(in_map.y_m * 1e6)},
        BinaryAngle::from_radians(in_map.heading_rad)};
    config.localization.matching = options.matching;
    agent_ = std::make_unique<AgentFor<RobotProfile>>(
        config, AgentPorts{serial_, wire_.end(0), radio_, clock_});
  }

  // Until so far was driven, or nothing is left to explore, or it takes far too long.
  Run run(double metres) {
    Run result;
    const TimeUs end_us = clock_.now + static_cast<TimeUs>(metres / 0.05 * 1e6);
    while (clock_.now < end_us && body_.travelled_m() < metres &&
           agent_->state() != RobotState::kExplored) {
      tick();
      if (clock_.now % 100'000 == 0) {
        record(agent_->odometry().pose(), result.odometry);
        record(agent_->pose(), result.estimate);
      }
    }
    result.driven_m = body_.travelled_m();
    result.collisions = body_.collisions();
    result.matches = agent_->localization().counters();
    for (const std::uint8_t flags : agent_->explorer().map().layers().flags) {
      result.occupied_m2 += (flags & cell_flag::kOwnObstacle) != 0 ? 0.0025 : 0;
    }
    for (const std::uint8_t visits : agent_->explorer().map().layers().own_visits) {
      result.seen_m2 += visits != 0 ? 0.0025 : 0;
    }
    return result;
  }

 private:
  void measure(std::span<ScanPoint> beams) {
    const TruePose& pose = body_.pose();
    const Point from{static_cast<std::int32_t>(pose.x_m * 1e6),
                     static_cast<std::int32_t>(pose.y_m * 1e6)};
    const BinaryAngle heading = BinaryAngle::from_radians(pose.heading_rad);
    for (ScanPoint& beam : beams) {  // the noise of LidarModel, `mild`
      const std::int32_t range_um = rays_.cast_um(from, heading + beam.bearing, 12'000'000);
      const double range_m = range_um * 1e-6;
      const double noisy_m = range_m + (0.002 + 0.004 * range_m) * normal_(random_);
      beam.range_mm = static_cast<std::uint16_t>(std::clamp(noisy_m * 1000, 0.0, 65'000.0));
      const bool measured = range_um < 12'000'000 && range_um > 150'000 && share_(random_) > 0.005;
      beam.echo = measured ? Echo::kHit : Echo::kNothing;
      beam.quality = 40;
    }
  }

  void tick() {
    clock_.now += kTickUs;
    wire_.advance_to(clock_.now);
    drives_.step(clock_.now);
    const double left = left_.ground_position(), right = right_.ground_position();
    body_.roll((left - left_counts_) * kMetresPerCount, (right - right_counts_) * kMetresPerCount,
               *world_, {});
    left_counts_ = left;
    right_counts_ = right;
    serial_.set_now(clock_.now);
    if (clock_.now % 10'000 == 0) agent_->step(clock_.now);
  }

  void record(const Pose& estimate, Errors& errors) const {
    const TruePose truth = frame_.from_world(body_.pose());
    const TruePose guess = to_true_pose(estimate);
    const double turn = std::remainder(guess.heading_rad - truth.heading_rad, 2 * M_PI);
    errors.add(std::hypot(guess.x_m - truth.x_m, guess.y_m - truth.y_m), turn * 180 / M_PI);
  }

  std::shared_ptr<const World> world_;
  RayCaster rays_;
  MapFrame frame_;
  RobotBody body_;
  RplidarEmulator lidar_;
  EmulatedSerialPort serial_{lidar_};
  fake::FakeCanWire<3> wire_;
  Cia402Emulator left_{{.node_id = 1}};
  Cia402Emulator right_{{.node_id = 2}};
  DriveGroup drives_{wire_.end(1), {&left_, &right_}};
  SilentRadio radio_;
  SimulatedClock clock_;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> share_;
  double left_counts_ = 0, right_counts_ = 0;
  std::unique_ptr<AgentFor<RobotProfile>> agent_;
};

void print(unsigned seed, const Run& run) {
  std::printf(
      "%4u %6.1f m %3d hits | odometry %6.3f m %6.2f deg max %6.3f m | estimate %6.3f m %5.2f deg "
      "max %6.3f m %5.2f deg | matched %u undecided %u poor %u | occupied %.2f seen %.1f m2\n",
      seed, run.driven_m, run.collisions, run.odometry.rms_m(), run.odometry.rms_deg(),
      run.odometry.max_m, run.estimate.rms_m(), run.estimate.rms_deg(), run.estimate.max_m,
      run.estimate.max_deg, run.matches.matched, run.matches.undecided, run.matches.poor,
      run.occupied_m2, run.seen_m2);
  std::fflush(stdout);
}

int bench(const BenchOptions& options) {
  const bool corridor = options.world == "corridor";
  const auto world = std::make_shared<World>(corridor ? corridor_world() : malaga_world());
  const TruePose start = corridor ? TruePose{2.4, -11, 0} : TruePose{};
  double squares = 0, heading_squares = 0, odometry_squares = 0, worst = 0;
  for (unsigned seed = 1; seed <= options.seeds; ++seed) {
    const auto drive = std::make_unique<Drive>(world, start, options, seed);
    const Run run = drive->run(options.metres);
    print(seed, run);
    squares += run.estimate.rms_m() * run.estimate.rms_m();
    odometry_squares += run.odometry.rms_m() * run.odometry.rms_m();
    heading_squares += run.estimate.rms_deg() * run.estimate.rms_deg();
    worst = std::max(worst, run.estimate.max_m);
  }
  std::printf("%s %s %s, all seeds: odometry rms %.3f m; estimate rms %.3f m %.2f deg max %.3f m\n",
              options.world.c_str(), options.preset.c_str(),
              options.matching ? "matching" : "odometry",
              std::sqrt(odometry_squares / options.seeds), std::sqrt(squares / options.seeds),
              std::sqrt(heading_squares / options.seeds), worst);
  return 0;
}

}  // namespace
}  // namespace ivfm::host

int main(int argc, char** argv) {
  if (argc < 5) {
    std::fprintf(stderr,
                 "usage: localization_bench corridor|malaga none|mild|turtlebot|harsh SEEDS METRES "
                 "[odometry|matching]\n");
    return 2;
  }
  ivfm::host::BenchOptions options{argv[1], argv[2], static_cast<unsigned>(std::atoi(argv[3])),
                                   std::atof(argv[4]),
                                   argc < 6 || std::strcmp(argv[5], "odometry") != 0};
  return ivfm::host::bench(options);
}
