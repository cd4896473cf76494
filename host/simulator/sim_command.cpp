#include "host/simulator/sim_command.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "firmware/hal/linux/can_port.h"
#include "firmware/hal/linux/linux_clock.h"
#include "host/canbus/can_server.h"
#include "host/cli/progress_line.h"
#include "host/simulator/simulation.h"
#include "host/simulator/truth_log.h"

namespace ivfm::host {
namespace {

std::atomic<bool> g_stop{false};

void on_signal(int) { g_stop = true; }

struct SimOptions {
  WorldRequest world;
  std::vector<std::string> starts;
  double resolution_m = 0;
  std::string can;  // empty: by what the kernel has
  std::string lidar_dir = "lidars";
  double time_scale = 1;
  double duration_s = 0;  // 0: until it is stopped
  std::string odometry_noise = "none";
  std::string lidar_noise = "mild";
  int walkers = 0;
  std::vector<std::string> doors;
  std::vector<std::string> faults;
  std::string truth;
  std::string record;
};

// A user-space bus in a thread of this process.
class OwnCanBus {
 public:
  explicit OwnCanBus(double time_scale) : server_(options(time_scale)) {
    thread_ = std::thread([this] { server_.run(); });
  }
  ~OwnCanBus() {
    server_.stop();
    thread_.join();
  }
  std::string url() const {
    return "socketcand:127.0.0.1:" + std::to_string(server_.port()) + "/robot{robot}";
  }

 private:
  static CanServerOptions options(double time_scale) {
    CanServerOptions options;
    options.port = "0";
    options.time_scale = time_scale;
    return options;
  }

  CanServer server_;
  std::thread thread_;
};

// `url` with {robot} replaced. Robots' node ids are alike, so that each needs a bus of its own.
std::string bus_of_robot(const std::string& url, int robot) {
  const std::size_t at = url.find("{robot}");
  if (at == std::string::npos) return url;
  return std::string(url).replace(at, 7, std::to_string(robot));
}

bool kernel_has_virtual_buses(int robots) {
  for (int robot = 1; robot <= robots; ++robot) {
    CanPort port;
    std::string error;
    if (!ok(port.open("socketcan:vcan" + std::to_string(robot), 0, error))) return false;
  }
  return true;
}

// Everything the robots are connected to, opened in the right order.
class Buses {
 public:
  Buses(const SimOptions& options, int robots) {
    std::string url = options.can;
    if (url.empty() && kernel_has_virtual_buses(robots)) url = "socketcan:vcan{robot}";
    if (url.empty()) {
      own_.emplace(options.time_scale);
      url = own_->url();
    }
    if (robots > 1 && url.find("{robot}") == std::string::npos) {
      throw std::invalid_argument("--can " + url + ": each of the " + std::to_string(robots) +
                                  " robots needs its own bus; write {robot} where its number goes,"
                                  " such as socketcand:127.0.0.1:28600/robot{robot}");
    }
    for (int robot = 1; robot <= robots; ++robot) {
      urls_.push_back(bus_of_robot(url, robot));
      ports_.push_back(std::make_unique<CanPort>());
      std::string error;
      if (!ok(ports_.back()->open(urls_.back(), 5'000, error))) {
        throw std::runtime_error("--can " + urls_.back() + ": " + error);
      }
    }
  }

  std::vector<CanBus*> buses() const {
    std::vector<CanBus*> out;
    for (const auto& port : ports_) out.push_back(port.get());
    return out;
  }
  const std::string& url(std::size_t robot) const { return urls_[robot]; }

 private:
  std::optional<OwnCanBus> own_;
  std::vector<std::string> urls_;
  std::vector<std::unique_ptr<CanPort>> ports_;
};

SimulationConfig simulation_config(const SimOptions& options) {
  SimulationConfig config;
  config.odometry = OdometryNoise::preset(options.odometry_noise);
  config.lidar = LidarModel::preset(options.lidar_noise);
  config.walkers = options.walkers;
  for (const std::string& door : options.doors) config.doors.push_back(parse_door(door));
  config.faults = parse_faults(options.faults);
  config.seed = options.world.seed;
  return config;
}

// Lets simulated time pass at the clock's pace, a tick at a time.
class Pacer {
 public:
  explicit Pacer(double time_scale) : time_scale_(time_scale), clock_(time_scale) {}

  // Waits until the tick after `simulated_us` and returns the time it is then.
  TimeUs wait_for_tick(TimeUs simulated_us) {
    const TimeUs due_us = simulated_us + Simulation::kTickUs;
    clock_.sleep_until(due_us);
    const TimeUs now_us = clock_.now_us();
    if (now_us > due_us) largest_lag_us_ = std::max(largest_lag_us_, now_us - due_us);
    return now_us;
  }

  // The wall clock's time at a moment of the simulation.
  std::int64_t unix_us_at(TimeUs simulated_us) const {
    return start_unix_us_ +
           static_cast<std::int64_t>(static_cast<double>(simulated_us) / time_scale_);
  }

  double largest_lag_ms() const { return static_cast<double>(largest_lag_us_) / 1e3 / time_scale_; }

 private:
  double time_scale_;
  LinuxClock clock_;
  std::int64_t start_unix_us_ = std::chrono::duration_cast<std::chrono::microseconds>(
                                    std::chrono::system_clock::now().time_since_epoch())
                                    .count();
  TimeUs largest_lag_us_ = 0;
};

void print_connections(const Simulation& simulation, const Buses& buses) {
  const PreparedWorld& world = simulation.world();
  std::printf("world %s: %.1f x %.1f m, %zu robots\n", world.world.name.c_str(),
              world.world.width * (world.world.cell_um / 1e6),
              world.world.height * (world.world.cell_um / 1e6), world.starts.size());
  for (std::size_t i = 0; i < world.starts.size(); ++i) {
    std::printf("robot %zu: --lidar %s --can %s --start %s\n", i + 1,
                simulation.robots()[i]->lidar().terminal().link().c_str(), buses.url(i).c_str(),
                format_pose(world.starts[i]).c_str());
  }
  std::printf("simulation ready\n");
  std::fflush(stdout);
}

// Says when a robot has run into something, once a contact.
class CollisionReporter {
 public:
  explicit CollisionReporter(std::size_t robots) : counts_(robots, 0) {}
  void report(const Simulation& simulation) {
    for (std::size_t i = 0; i < counts_.size(); ++i) {
      const RobotBody& body = simulation.robots()[i]->body();
      if (body.collisions() == counts_[i]) continue;
      counts_[i] = body.collisions();
      std::printf("collision: robot %zu at %.2f,%.2f after %.1f s\n", i + 1, body.pose().x_m,
                  body.pose().y_m, static_cast<double>(simulation.now_us()) / 1e6);
      std::fflush(stdout);
    }
  }

 private:
  std::vector<int> counts_;
};

void print_summary(const Simulation& simulation, const Pacer& pacer) {
  for (const auto& robot : simulation.robots()) {
    std::printf("robot %d: %.2f m driven, %d collisions, %llu lidar bytes not read\n",
                robot->number(), robot->body().travelled_m(), robot->body().collisions(),
                static_cast<unsigned long long>(robot->lidar().lost_bytes()));
  }
  std::printf("simulated %.1f s, largest lag %.1f ms of real time\n",
              static_cast<double>(simulation.now_us()) / 1e6, pacer.largest_lag_ms());
}

// A recording a robot, if the folder is given.
class ScanRecordings {
 public:
  ScanRecordings(std::string folder, Simulation& simulation) : folder_(std::move(folder)) {
    if (folder_.empty()) return;
    std::filesystem::create_directories(folder_);
    for (const auto& robot : simulation.robots()) {
      recorders_.push_back(std::make_unique<ScanRecorder>(
          "robot " + std::to_string(robot->number()) + " in the simulated world " +
          simulation.world().world.name + ", true poses"));
      robot->record_scans(*recorders_.back());
    }
  }
  void write() const {
    for (std::size_t i = 0; i < recorders_.size(); ++i) {
      write_recording(folder_ / ("robot" + std::to_string(i + 1) + ".recording"),
                      recorders_[i]->recording());
    }
  }

 private:
  std::filesystem::path folder_;
  std::vector<std::unique_ptr<ScanRecorder>> recorders_;
};

int simulate(SimOptions options) {
  for (const std::string& start : options.starts) {
    options.world.starts.push_back(parse_pose(start));
  }
  if (options.resolution_m > 0) options.world.resolution_m = options.resolution_m;
  const SimulationConfig config = simulation_config(options);
  PreparedWorld world = prepare_world(options.world);

  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);

  std::filesystem::create_directories(options.lidar_dir);
  std::vector<std::filesystem::path> links;
  for (int robot = 1; robot <= options.world.robots; ++robot) {
    links.push_back(std::filesystem::path(options.lidar_dir) /
                    ("robot" + std::to_string(robot) + ".lidar"));
  }
  std::optional<TruthLog> truth;
  if (!options.truth.empty()) truth.emplace(options.truth);
  const Buses buses(options, options.world.robots);
  Simulation simulation(std::move(world), config, links, buses.buses());
  print_connections(simulation, buses);

  const ScanRecordings recordings(options.record, simulation);
  Pacer pacer(options.time_scale);
  CollisionReporter collisions(simulation.robots().size());
  const auto end_us =
      options.duration_s > 0 ? static_cast<TimeUs>(options.duration_s * 1e6) : ~TimeUs{0};
  ProgressLine progress(static_cast<std::uint64_t>(options.duration_s), "simulated seconds");
  while (!g_stop && simulation.now_us() < end_us) {
    simulation.advance_to(std::min(end_us, pacer.wait_for_tick(simulation.now_us())));
    if (truth) truth->record(simulation, pacer.unix_us_at(simulation.now_us()));
    collisions.report(simulation);
    if (options.duration_s > 0) progress(simulation.now_us() / 1'000'000);
  }
  recordings.write();
  print_summary(simulation, pacer);
  return 0;
}

}  // namespace

void add_sim_command(CLI::App& app, CommandAction& action) {
  auto options = std::make_shared<SimOptions>();
  CLI::App* command =
      app.add_subcommand("sim", "Simulate robots: lidars on serial lines, drives on CAN");
  command
      ->add_option("--world", options->world.name,
                   "1x, 2x, divider, divider-released, building, corridor, malaga, or a map "
                   "file (.yaml, .pgm, .png)")
      ->capture_default_str();
  command->add_option("--resolution", options->resolution_m, "metres a pixel of a bare image")
      ->check(CLI::PositiveNumber);
  command->add_option("--robots", options->world.robots, "how many")
      ->capture_default_str()
      ->check(CLI::Range(1, 8));
  command->add_option("--start", options->starts,
                      "start pose x,y,heading in metres and degrees; once a robot");
  command->add_flag("--random-starts", options->world.random_starts,
                    "draw the start poses in the corridor from the seed");
  command->add_option("--seed", options->world.seed, "of everything random")->capture_default_str();
  command->add_option("--can", options->can,
                      "bus of each robot, {robot} is its number [vcan1, vcan2, ... where the "
                      "kernel has them, else an own user-space bus]");
  command->add_option("--lidar-dir", options->lidar_dir, "where robotN.lidar appear")
      ->capture_default_str();
  command->add_option("--time-scale", options->time_scale, "simulated seconds in a real one")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 50.0));
  command->add_option("--duration", options->duration_s, "simulated seconds, then end [endless]")
      ->check(CLI::PositiveNumber);
  command->add_option("--odometry-noise", options->odometry_noise, "none, mild, turtlebot or harsh")
      ->capture_default_str()
      ->check(CLI::IsMember({"none", "mild", "turtlebot", "harsh"}));
  command->add_option("--lidar-noise", options->lidar_noise, "none or mild")
      ->capture_default_str()
      ->check(CLI::IsMember({"none", "mild"}));
  command->add_option("--walkers", options->walkers, "people who cross the world")
      ->capture_default_str()
      ->check(CLI::Range(0, 50));
  command->add_option("--door", options->doors,
                      "X0,Y0,X1,Y1@CLOSES[+LENGTH]: a rectangle that is closed for a time, such as "
                      "3,1,3.1,2@20s+15s; repeatable");
  command->add_option("--fault", options->faults,
                      "such as lidar-silence@12s+3s, lidar-garbage#2@5s+1s, can-drop=0.1, "
                      "drive-fault@20s, drive-silence@30s+500ms; repeatable");
  command->add_option("--truth", options->truth, "CSV file for the true poses, 10 Hz");
  command->add_option("--record", options->record,
                      "folder for robotN.recording, what each lidar measured; ivfm replay and ivfm "
                      "log export read them");
  command->footer("Example: ivfm sim --world corridor --robots 2 --lidar-dir /tmp/lidars");
  command->callback([options, &action] { action = [options] { return simulate(*options); }; });
}

}  // namespace ivfm::host
