#include "tests/replay/simulated_robot.h"

#include <algorithm>
#include <numbers>

namespace ivfm::replay {

namespace {

constexpr TimeUs kAgentPeriodUs = 10'000;
constexpr std::int32_t kLidarRangeUm = 12'000'000;

// Half of an A1's sample rate in express mode: some 360 points a revolution, half the bytes.
constexpr host::RplidarEmulatorConfig half_rate_lidar() {
  host::RplidarEmulatorConfig config;
  config.express_sample_us = 508;
  return config;
}

std::shared_ptr<Agent> make_agent(ProfileId profile, const AgentConfig& config,
                                  const AgentPorts& ports) {
  if (profile == ProfileId::kRobot) return std::make_shared<AgentFor<RobotProfile>>(config, ports);
  return std::make_shared<AgentFor<McuProfile>>(config, ports);
}

}  // namespace

AgentConfig as_stored(const AgentConfig& config) {
  std::vector<std::int32_t> values;
  for_each_setting(config, [&](const auto& setting) { values.push_back(to_stored(setting)); });
  AgentConfig stored;
  auto value = values.begin();
  for_each_setting(stored, [&](auto& setting) { from_stored(*value++, setting); });
  return stored;
}

SimulatedRobot::SimulatedRobot(const AgentConfig& config, const Pose& start,
                               std::shared_ptr<const host::World> world,
                               const host::OdometryNoise& noise, std::uint64_t seed,
                               ProfileId profile)
    : world_(world),
      rays_(world),
      random_(seed, config.link.robot),
      body_({}, host::to_true_pose(start), noise, seed + config.link.robot),
      rplidar_(half_rate_lidar()),
      writer_({Subject::kAgent, profile, config}),
      agent_(
          make_agent(profile, config,
                     AgentPorts{recorder_.serial(), recorder_.can(), recorder_.radio(), clock_})) {
  rplidar_.set_beam_source([this](TimeUs, std::span<ScanPoint> beams) { measure(beams); });
}

void SimulatedRobot::enter(std::shared_ptr<const host::World> world) {
  world_ = std::move(world);
  rays_ = host::RayCaster(world_);
}

// An A1's noise, roughly: a few millimetres and half a percent of the range, 1 % lost.
void SimulatedRobot::measure(std::span<ScanPoint> beams) {
  const host::TruePose& pose = body_.pose();
  const Point from{static_cast<std::int32_t>(pose.x_m * 1e6),
                   static_cast<std::int32_t>(pose.y_m * 1e6)};
  const BinaryAngle heading = BinaryAngle::from_radians(pose.heading_rad);
  for (ScanPoint& beam : beams) {
    std::int32_t range_um = rays_.cast_um(from, heading + beam.bearing, kLidarRangeUm);
    for (const host::TruePose& other : others_) {
      const double metres = host::ray_to_disc_m(
          pose.x_m, pose.y_m, (heading + beam.bearing).radians(), other, body_.shape().radius_m);
      if (metres < range_um * 1e-6) range_um = static_cast<std::int32_t>(metres * 1e6);
    }
    const std::int32_t noise_um = 3'000 + range_um / 200;
    const std::int32_t measured_um = range_um + random_.between(-noise_um, noise_um);
    const bool lost = random_.chance(1) || range_um >= kLidarRangeUm;
    beam.range_mm = static_cast<std::uint16_t>(std::clamp(measured_um / 1000, 1, 12'000));
    beam.echo = lost ? Echo::kNothing : Echo::kHit;
    beam.quality = 40;
  }
}

void SimulatedRobot::roll_wheels() {
  const double metres_per_count = 2 * std::numbers::pi * body_.shape().wheel_radius_m / 4096;
  body_.roll_to(left_.ground_position(), right_.ground_position(), metres_per_count, *world_,
                others_);
}

void SimulatedRobot::tick(TimeUs now_us) {
  clock_.now = now_us;
  wire_.advance_to(now_us);
  drives_.step(now_us);
  roll_wheels();
  serial_.set_now(now_us);
  if (now_us % kAgentPeriodUs != 0) return;
  agent_->step(now_us);
  recorder_.end_step(now_us);
}

}  // namespace ivfm::replay
