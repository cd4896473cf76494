#include "host/simulator/simulation.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace ivfm::host {
namespace {

// Independent random streams from one seed: robot and purpose make the difference.
std::uint64_t stream_seed(std::uint64_t seed, int robot, std::uint64_t purpose) {
  std::seed_seq mix{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                    static_cast<std::uint32_t>(robot), static_cast<std::uint32_t>(purpose)};
  std::uint32_t words[2];
  mix.generate(words, words + 2);
  return std::uint64_t{words[0]} << 32 | words[1];
}

constexpr std::uint16_t kOverCurrent =
    0x2310;  // CiA 402 table "Error codes": continuous over current
std::vector<TruePose> to_true_poses(const std::vector<Pose>& poses) {
  std::vector<TruePose> out;
  for (const Pose& pose : poses) out.push_back(to_true_pose(pose));
  return out;
}

constexpr TimeUs kGarbagePeriodUs = 50'000;
constexpr std::size_t kGarbageBytes = 40;

}  // namespace

Result<CanFrame> LossyCanBus::receive() {
  for (;;) {
    const Result<CanFrame> frame = bus_.receive();
    if (!frame.ok() || !lose()) return frame;
  }
}

Status LossyCanBus::send(const CanFrame& frame) { return lose() ? Status::kOk : bus_.send(frame); }

bool LossyCanBus::lose() {
  return loss_ > 0 && static_cast<double>(random_() >> 11) * 0x1p-53 < loss_;
}

SimulatedRobot::SimulatedRobot(int number, const PreparedWorld& world,
                               const SimulationConfig& config, std::filesystem::path lidar_link,
                               CanBus& bus)
    : number_(number),
      world_(world.world),
      config_(config),
      body_(world.body, to_true_pose(world.starts[static_cast<std::size_t>(number - 1)]),
            config.odometry, stream_seed(config.seed, number, 1)),
      rays_(world.world, config.lidar, stream_seed(config.seed, number, 2)),
      terminal_(std::move(lidar_link), config.rplidar),
      bus_(bus, stream_seed(config.seed, number, 3)),
      left_({.node_id = 1}),
      right_({.node_id = 2}),
      drives_(bus_, {&left_, &right_}),
      metres_per_count_(config.wheels.wheel_circumference_um / 1e6 /
                        config.wheels.counts_per_turn) {
  terminal_.emulator().set_beam_source(
      [this](TimeUs now_us, std::span<ScanPoint> beams) { measure(now_us, beams); });
}

void SimulatedRobot::step(TimeUs now_us, std::span<const TruePose> others) {
  others_.assign(others.begin(), others.end());
  apply_faults(now_us);
  drives_.step(now_us);
  body_.roll_to(left_.ground_position(), right_.ground_position(), metres_per_count_, world_,
                others);
  terminal_.step(now_us);
}

void SimulatedRobot::apply_faults(TimeUs now_us) {
  bool lidar_silent = false, left_silent = false, right_silent = false;
  double loss = 0;
  fault_begun_.resize(config_.faults.size());
  for (std::size_t i = 0; i < config_.faults.size(); ++i) {
    const Fault& fault = config_.faults[i];
    if (!fault.is_active(number_, now_us)) continue;
    switch (fault.kind) {
      case FaultKind::kLidarSilence: lidar_silent = true; break;
      case FaultKind::kLidarGarbage:
        if (now_us < next_garbage_us_) break;
        terminal_.emulator().inject_garbage(kGarbageBytes, static_cast<std::uint32_t>(now_us));
        next_garbage_us_ = now_us + kGarbagePeriodUs;
        break;
      case FaultKind::kCanDrop: loss = std::max(loss, fault.probability); break;
      case FaultKind::kDriveFault:
        if (!fault_begun_[i]) left_.raise_fault(kOverCurrent);
        break;
      case FaultKind::kDriveSilence: left_silent = right_silent = true; break;
      case FaultKind::kLeftDriveSilence: left_silent = true; break;
    }
    fault_begun_[i] = true;
  }
  terminal_.emulator().set_silent(lidar_silent);
  left_.set_silent(left_silent);
  right_.set_silent(right_silent);
  bus_.set_loss(loss);
}

void SimulatedRobot::measure(TimeUs now_us, std::span<ScanPoint> beams) {
  rays_.measure(body_.pose(), beams, others_, body_.shape().radius_m);
  if (recorder_ != nullptr) recorder_->take(now_us, body_.pose(), beams);
}

Simulation::Simulation(PreparedWorld world, SimulationConfig config,
                       const std::vector<std::filesystem::path>& lidar_links,
                       const std::vector<CanBus*>& buses)
    : world_(std::move(world)),
      config_(std::move(config)),
      walkers_(world_.world, to_true_poses(world_.starts), config_.walkers,
               stream_seed(config_.seed, 0, 4)),
      doors_(world_.world, config_.doors) {
  if (lidar_links.size() != world_.starts.size() || buses.size() != world_.starts.size()) {
    throw std::invalid_argument("Simulation: one lidar and one bus a robot");
  }
  for (std::size_t i = 0; i < world_.starts.size(); ++i) {
    robots_.push_back(std::make_unique<SimulatedRobot>(static_cast<int>(i) + 1, world_, config_,
                                                       lidar_links[i], *buses[i]));
  }
}

void Simulation::advance_to(TimeUs now_us) {
  std::vector<TruePose> others;
  while (now_us_ + kTickUs <= now_us) {
    now_us_ += kTickUs;
    others.clear();
    for (const auto& robot : robots_) others.push_back(robot->body().pose());
    move_doors(others);
    walkers_.step(kTickUs * 1e-6, world_.world, others);
    for (const auto& robot : robots_) {
      others = walkers_.legs();
      for (const auto& other : robots_) {
        if (other != robot) others.push_back(other->body().pose());
      }
      robot->step(now_us_, others);
    }
  }
}

void Simulation::move_doors(std::span<const TruePose> robots) {
  std::vector<TruePose> bodies = walkers_.legs();
  bodies.insert(bodies.end(), robots.begin(), robots.end());
  const double radius_m = world_.body.radius_m;
  if (!doors_.step(now_us_, world_.world, bodies, radius_m)) return;
  for (const auto& robot : robots_) robot->take_world();
}

int Simulation::collisions() const {
  int sum = 0;
  for (const auto& robot : robots_) sum += robot->body().collisions();
  return sum;
}

}  // namespace ivfm::host
