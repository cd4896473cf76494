#include "host/demo/rehearsal.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "firmware/agent/agent.h"
#include "firmware/agent/linux/agent_setup.h"
#include "firmware/hal/fake/fake_can_bus.h"
#include "host/environment/random.h"
#include "host/map_server/team_radio.h"
#include "host/simulator/cia402_emulator.h"
#include "host/simulator/emulated_serial_port.h"
#include "host/simulator/rplidar_emulator.h"

namespace ivfm::host {
namespace {

constexpr TimeUs kTickUs = 2'000;
constexpr TimeUs kAgentPeriodUs = 10'000;
constexpr TimeUs kRadioPeriodUs = 20'000;
constexpr TimeUs kJudgePeriodUs = 1'000'000;
constexpr TimeUs kBeginUs = 5'000'000;

// Of one of a robot's independent random streams.
std::uint64_t seed_of(const RehearsalOptions& options, int robot, std::uint64_t purpose) {
  return Random(options.world.seed, 2 * static_cast<std::uint64_t>(robot) + purpose).next();
}

class SimulatedClock final : public Clock {
 public:
  TimeUs now_us() override { return now; }
  TimeUs now = kBeginUs;
};

// An agent, what it is connected to, and its body.
class RehearsedRobot {
 public:
  RehearsedRobot(int number, const PreparedWorld& world, const RehearsalOptions& options)
      : world_(world),
        config_(config_of(number, world, options)),
        body_(world.body, to_true_pose(start_of(number, world)), options.odometry,
              seed_of(options, number, 0)),
        rays_(world.world, options.lidar, seed_of(options, number, 1)),
        agent_(std::make_unique<AgentFor<RobotProfile>>(
            config_, AgentPorts{serial_, wire_.end(0), radio_, clock_})) {
    rplidar_.set_beam_source([this](TimeUs, std::span<ScanPoint> beams) {
      rays_.measure(body_.pose(), beams, others_, body_.shape().radius_m);
    });
    serial_.set_now(kBeginUs);
    if (options.model.empty()) return;
    const ModelStatus loaded = agent_->load_model(options.model);
    if (!ok(loaded.status)) throw std::invalid_argument(std::string("model: ") + loaded.reason);
  }

  void tick(TimeUs now_us, std::vector<TruePose> others) {
    others_ = std::move(others);
    clock_.now = now_us;
    wire_.advance_to(now_us);
    drives_.step(now_us);
    roll_wheels();
    serial_.set_now(now_us);
    if (now_us % kAgentPeriodUs == 0) agent_->step(now_us);
  }

  const Agent& agent() const { return *agent_; }
  const RobotBody& body() const { return body_; }
  RadioQueue& radio() { return radio_; }
  bool is_apart() const { return agent_->start_pose() == StartPose::kApart; }
  double error_rad() const {
    return std::abs(
        std::remainder(body_.pose().heading_rad - agent_->pose().heading.radians(), 2 * M_PI));
  }
  double error_m() const {
    const Point believed = agent_->pose().position;
    return std::hypot(body_.pose().x_m - believed.x_um / 1e6,
                      body_.pose().y_m - believed.y_um / 1e6);
  }

 private:
  static const Pose& start_of(int number, const PreparedWorld& world) {
    return world.starts[static_cast<std::size_t>(number - 1)];
  }

  static AgentConfig config_of(int number, const PreparedWorld& world,
                               const RehearsalOptions& options) {
    AgentOptions agent = options.agent;
    agent.robot_id = number;
    agent.robot_radius_m = world.body.radius_m;
    agent.wheel_radius_m = world.body.wheel_radius_m;
    agent.wheel_base_m = world.body.wheel_base_m;
    AgentConfig config = make_agent_config(agent, RobotProfile::kCellUm, 1);
    config.unknown_start = options.unknown_starts && number > 1;
    if (!config.unknown_start) config.start = start_of(number, world);
    return config;
  }

  void roll_wheels() {
    const WheelGeometry& wheels = config_.wheels.geometry;
    const double metres_per_count = wheels.wheel_circumference_um * 1e-6 / wheels.counts_per_turn;
    body_.roll_to(left_.ground_position(), right_.ground_position(), metres_per_count, world_.world,
                  others_);
  }

  const PreparedWorld& world_;
  AgentConfig config_;
  RobotBody body_;
  MrptLidar rays_;
  RplidarEmulator rplidar_;
  EmulatedSerialPort serial_{rplidar_};
  fake::FakeCanWire<2> wire_;
  Cia402Emulator left_{{.node_id = 1}}, right_{{.node_id = 2}};
  DriveGroup drives_{wire_.end(1), {&left_, &right_}};
  RadioQueue radio_;
  SimulatedClock clock_;
  std::vector<TruePose> others_;
  std::unique_ptr<AgentFor<RobotProfile>> agent_;
};

class Rehearsal {
 public:
  explicit Rehearsal(const RehearsalOptions& options)
      : options_(options),
        world_(prepare_world(options.world)),
        meter_(world_.world, world_.starts.front().position, RobotProfile::kCellUm) {
    for (int i = 1; i <= static_cast<int>(world_.starts.size()); ++i) {
      robots_.push_back(std::make_unique<RehearsedRobot>(i, world_, options));
      team_.add(robots_.back()->radio());
      apart_.push_back(robots_.back()->is_apart());
    }
  }

  RehearsalResult run() {
    const auto limit_us = kBeginUs + static_cast<TimeUs>(options_.time_limit_s * 1e6);
    TimeUs now_us = kBeginUs;
    while (now_us < limit_us && !result_.goal_reached && !all_are_idle() && !is_interrupted()) {
      now_us += kTickUs;
      tick(now_us);
      if (now_us % kJudgePeriodUs == 0) judge(now_us);
    }
    judge(now_us);
    result_.apart = static_cast<int>(std::ranges::count(apart_, true));
    result_.simulated_s = static_cast<double>(now_us - kBeginUs) / 1e6;
    result_.rms_error_m = std::sqrt(squared_errors_ / std::max(1.0, errors_));
    return result_;
  }

 private:
  void tick(TimeUs now_us) {
    std::vector<TruePose> poses;
    for (const auto& robot : robots_) poses.push_back(robot->body().pose());
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      std::vector<TruePose> others = poses;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
      robots_[i]->tick(now_us, std::move(others));
    }
    if (now_us % kRadioPeriodUs == 0) team_.exchange(now_us);
  }

  bool is_interrupted() const { return options_.interrupted != nullptr && *options_.interrupted; }

  bool all_are_idle() const {
    return std::ranges::all_of(
        robots_, [](const auto& robot) { return robot->agent().state() == RobotState::kExplored; });
  }

  // A robot that is apart is nowhere in the team's map frame.
  bool is_placed(std::size_t i, TimeUs now_us) {
    const RehearsedRobot& robot = *robots_[i];
    if (apart_[i] && !robot.is_apart()) {
      apart_[i] = false;
      result_.joined.push_back(
          {static_cast<double>(now_us - kBeginUs) / 1e6, robot.error_m(), robot.error_rad()});
    }
    return !apart_[i];
  }

  void judge(TimeUs now_us) {
    result_.actions = 0, result_.driven_m = 0, result_.collisions = 0;
    std::vector<LayerMap> maps;
    const MapStore& store = team_.server().map();
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      const RehearsedRobot& robot = *robots_[i];
      result_.actions += robot.agent().progress().actions;
      result_.driven_m += robot.body().travelled_m();
      result_.collisions += robot.body().collisions();
      maps.push_back(robot_map(store, static_cast<std::uint16_t>(i + 1), RobotProfile::kCellUm));
      if (!is_placed(i, now_us)) continue;
      const double error_m = robot.error_m();
      squared_errors_ += error_m * error_m, errors_ += 1;
      result_.largest_error_m = std::max(result_.largest_error_m, error_m);
    }
    result_.scores =
        score_run(merged_map(store, RobotProfile::kCellUm), maps, meter_, result_.driven_m);
    result_.goal_reached = result_.scores.coverage >= options_.until;
  }

  const RehearsalOptions& options_;
  PreparedWorld world_;
  CoverageMeter meter_;
  std::vector<std::unique_ptr<RehearsedRobot>> robots_;
  TeamRadio team_;
  RehearsalResult result_;
  std::vector<bool> apart_;  // by robot
  double squared_errors_ = 0, errors_ = 0;
};

}  // namespace

RehearsalResult rehearse(const RehearsalOptions& options) {
  return std::make_unique<Rehearsal>(options)->run();
}

}  // namespace ivfm::host
