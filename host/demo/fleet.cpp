#include "host/demo/fleet.h"

#include <signal.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>
#include <utility>

#include "host/map_server/keygen_command.h"

namespace ivfm::host {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;

constexpr seconds kStartTimeout{20};
constexpr seconds kGoodbyeTimeout{60};

// The text between `before` and the first of `end` after it; empty when `before` is not in `line`.
std::string between(std::string_view line, std::string_view before, std::string_view end) {
  const std::size_t begin = line.find(before);
  if (begin == std::string_view::npos) return {};
  const std::string_view rest = line.substr(begin + before.size());
  return std::string(rest.substr(0, rest.find_first_of(end)));
}

// x,y,heading up to 0.5 m and 15 degrees away, by what `seed` draws.
std::string roughly(const std::string& start, std::uint64_t seed) {
  double x_m = 0, y_m = 0, heading_deg = 0;
  std::sscanf(start.c_str(), "%lf,%lf,%lf", &x_m, &y_m, &heading_deg);
  std::mt19937_64 random(seed);
  const auto even = [&random] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  const double direction = even() * 2 * M_PI, off_m = 0.5 * std::sqrt(even());
  char text[96];
  std::snprintf(text, sizeof text, "%.6f,%.6f,%.2f", x_m + off_m * std::cos(direction),
                y_m + off_m * std::sin(direction), heading_deg + 30 * even() - 15);
  return text;
}

std::string shortest(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

}  // namespace

AgentCounters& AgentCounters::operator+=(const AgentCounters& other) {
  driven_m += other.driven_m;
  actions += other.actions;
  newly_seen_cells += other.newly_seen_cells;
  bytes_sent += other.bytes_sent;
  bytes_received += other.bytes_received;
  retransmissions += other.retransmissions;
  scans += other.scans;
  resyncs += other.resyncs;
  can_frames += other.can_frames;
  return *this;
}

void AgentReport::begin() {
  state = "starting";
  at_work = true;
  leaving = false;
  ++starts;
  earlier = *this;
}

void AgentReport::take(std::string_view line, double time_scale) {
  if (line.empty() || line.front() != '{') return;
  const auto json = nlohmann::json::parse(line, nullptr, false);
  if (!json.is_object()) return;
  try {
    const auto part = [&json](const char* name) {
      return json.value(name, nlohmann::json::object());
    };
    const auto radio = part("radio"), lidar = part("lidar"), can = part("can");
    AgentCounters now;
    now.driven_m = json.value("travelled_m", 0.0);
    now.actions = json.value("actions", now.actions);
    now.newly_seen_cells = json.value("newly_seen_cells", now.newly_seen_cells);
    now.bytes_sent = radio.value("bytes_sent", now.bytes_sent);
    now.bytes_received = radio.value("bytes_received", now.bytes_received);
    now.retransmissions = radio.value("retransmissions", now.retransmissions);
    now.scans = lidar.value("scans", now.scans);
    now.resyncs = lidar.value("resyncs", now.resyncs);
    now.can_frames = can.value("frames_received", now.can_frames);
    state = json.value("state", state);
    decision_ms = json.value("decision_us", 0.0) / 1e3 / time_scale;
    slowest_decision_ms = std::max(slowest_decision_ms, decision_ms);
    static_cast<AgentCounters&>(*this) = now += earlier;
  } catch (const nlohmann::json::exception&) {
    // A value of another type: a line that is not ours.
  }
}

Fleet::Fleet(FleetOptions options, const std::atomic<bool>& interrupted)
    : options_(std::move(options)),
      interrupted_(interrupted),
      agents_at_work_(static_cast<std::size_t>(options_.robots)),
      dismissed_(static_cast<std::size_t>(options_.robots)),
      connections_(static_cast<std::size_t>(options_.robots)),
      agents_(static_cast<std::size_t>(options_.robots)) {}

Fleet::~Fleet() {
  // Agents first: the others are what they drive with.
  agents_at_work_.clear();
  while (!services_.empty()) services_.pop_back();
}

std::filesystem::path Fleet::map_dump(int robot) const {
  return options_.folder / ("robot" + std::to_string(robot) + ".map");
}

std::unique_ptr<ChildProcess> Fleet::launch(const std::string& name,
                                            const std::vector<std::string>& command,
                                            ChildProcess::LineHandler on_line) {
  const std::filesystem::path logs = options_.folder / "logs";
  std::filesystem::create_directories(logs);
  return std::make_unique<ChildProcess>(name, command, logs / (name + ".log"), std::move(on_line));
}

ChildProcess& Fleet::launch_service(const std::string& name,
                                    const std::vector<std::string>& command,
                                    ChildProcess::LineHandler on_line) {
  services_.push_back(launch(name, command, std::move(on_line)));
  return *services_.back();
}

void Fleet::start() {
  std::ostringstream unsaid;
  write_team_keys(options_.robots, options_.folder / "keys", unsaid);
  start_bus();
  start_simulator();
  start_server();
  if (!options_.radio.empty()) start_radio();
  std::size_t started = 0;
  for (int robot = 1; robot <= options_.robots; ++robot) {
    if (std::count(options_.late.begin(), options_.late.end(), robot) != 0) continue;
    start_agent(robot);
    ++started;
  }
  const auto agents = running_agents();
  if (!agents.empty()) wait_until(*agents.back(), [&] { return agents_running_ == started; });
}

void Fleet::start_bus() {
  const ChildProcess& child =
      launch_service("canbus",
                     {options_.ivfm, "canbus", "--listen", "127.0.0.1:0", "--log", can_log(),
                      "--time-scale", shortest(options_.time_scale)},
                     [this](std::string_view line) {
                       if (bus_address_.empty()) bus_address_ = between(line, "socketcand:", "/ ");
                     });
  wait_until(child, [this] { return !bus_address_.empty(); });
}

void Fleet::start_simulator() {
  std::vector<std::string> command{options_.ivfm,  "sim",
                                   "--robots",     std::to_string(options_.robots),
                                   "--can",        "socketcand:" + bus_address_ + "/robot{robot}",
                                   "--lidar-dir",  options_.folder / "lidars",
                                   "--time-scale", shortest(options_.time_scale),
                                   "--truth",      truth()};
  command.insert(command.end(), options_.simulator_arguments.begin(),
                 options_.simulator_arguments.end());
  const ChildProcess& child = launch_service("sim", command, [this](std::string_view line) {
    for (int robot = 1; robot <= options_.robots; ++robot) {
      const std::string head = "robot " + std::to_string(robot) + ": ";
      if (!simulator_ready_ && line.starts_with(head)) {
        connections_[static_cast<std::size_t>(robot - 1)] = line.substr(head.size());
      }
    }
    if (line == "simulation ready") simulator_ready_ = true;
    if (line.starts_with("collision:")) ++collisions_;
  });
  wait_until(child, [this] { return simulator_ready_; });
}

void Fleet::start_server() {
  std::vector<std::string> command{
      options_.ivfm, "serve",        "--listen",
      "127.0.0.1:0", "--keys",       options_.folder / "keys/server.keys",
      "--db",        database(),     "--http",
      "127.0.0.1:0", "--time-scale", shortest(options_.time_scale)};
  command.insert(command.end(), options_.server_arguments.begin(), options_.server_arguments.end());
  const ChildProcess& child = launch_service("serve", command, [this](std::string_view line) {
    if (server_address_.empty()) server_address_ = between(line, "listening on ", ", ");
    if (live_page_.empty()) live_page_ = between(line, "live page ", " ");
  });
  wait_until(child, [this] { return !server_address_.empty() && !live_page_.empty(); });
  server_started_ = steady_clock::now();
}

void Fleet::start_radio() {
  const ChildProcess& child =
      launch_service("radio",
                     {options_.ivfm, "radio", "--faults", options_.radio, "--listen", "127.0.0.1:0",
                      "--to", server_address_, "--seed", std::to_string(options_.seed),
                      "--time-scale", shortest(options_.time_scale)},
                     [this](std::string_view line) {
                       if (radio_address_.empty())
                         radio_address_ = between(line, "radio on ", ", ");
                     });
  wait_until(child, [this] { return !radio_address_.empty(); });
  radio_ = services_.back().get();
}

void Fleet::end_radio_faults() {
  if (radio_ != nullptr) radio_->send_signal(SIGUSR1);
}

double Fleet::server_seconds() const {
  return std::chrono::duration<double>(steady_clock::now() - server_started_).count() *
         options_.time_scale;
}

void Fleet::start_agent(int robot, const std::string& start) {
  const std::size_t index = index_of(robot);
  std::vector<std::string> command{options_.agent};
  std::istringstream connections(connections_[index]);  // --lidar, --can, --start and their values
  std::copy(std::istream_iterator<std::string>(connections), {}, std::back_inserter(command));
  const auto pose = std::find(command.begin(), command.end(), "--start");
  if (!start.empty() && pose != command.end()) *std::next(pose) = start;
  if (options_.rough_starts && robot > 1 && pose != command.end()) {
    *std::next(pose) = roughly(*std::next(pose), options_.seed + static_cast<std::uint64_t>(robot));
    command.emplace_back("--rough-start");
  }
  if (options_.unknown_starts && robot > 1 && pose != command.end()) {
    *std::next(pose) = "0,0,0";
    command.emplace_back("--unknown-start");
  }
  for (const std::string& argument :
       {std::string("--server"), radio_ == nullptr ? server_address_ : radio_address_,
        std::string("--robot-id"), std::to_string(robot), std::string("--key"),
        (options_.folder / "keys" / ("robot" + std::to_string(robot) + ".key")).string(),
        std::string("--time-scale"), shortest(options_.time_scale), std::string("--dump-map"),
        map_dump(robot).string(), std::string("--telemetry"), std::string("json")}) {
    command.push_back(argument);
  }
  command.insert(command.end(), options_.agent_arguments.begin(), options_.agent_arguments.end());
  dismissed_[index] = false;
  agents_[index].begin();
  std::string name = "agent" + std::to_string(robot);
  if (const int starts = agents_[index].starts; starts > 1) name += "." + std::to_string(starts);
  agents_at_work_[index] = launch(name, command, [this, index](std::string_view line) {
    if (line.starts_with("ivfm-agent: robot")) ++agents_running_;
    agents_[index].take(line, options_.time_scale);
  });
}

void Fleet::dismiss_agent(int robot) {
  ChildProcess* const agent = agent_of(robot);
  if (agent == nullptr) return;
  dismissed_[index_of(robot)] = true;
  agents_[index_of(robot)].leaving = true;
  agent->send_signal(SIGTERM);
}

void Fleet::kill_agent(int robot) {
  agents_at_work_[index_of(robot)].reset();
  agents_[index_of(robot)].state = "crashed";
  agents_[index_of(robot)].at_work = false;
  std::filesystem::remove(map_dump(robot));
}

void Fleet::wait_until(const ChildProcess& child, const std::function<bool()>& ready) {
  const auto deadline = steady_clock::now() + kStartTimeout;
  while (!ready()) {
    wait(milliseconds(20));
    if (steady_clock::now() > deadline) {
      throw std::runtime_error(child.name() + " is not ready after " +
                               std::to_string(kStartTimeout.count()) +
                               " s; its last words: " + child.last_line());
    }
  }
}

void Fleet::wait(milliseconds time) {
  const auto end = steady_clock::now() + time;
  do {
    const auto left = std::chrono::duration_cast<milliseconds>(end - steady_clock::now());
    poll_children(all(), std::max(milliseconds(0), left));
    if (interrupted_) throw Interrupted();
    check_children();
  } while (steady_clock::now() < end);
}

void Fleet::check_children() {
  for (const auto& child : services_) {
    if (const auto code = child->exit_code()) {
      child->read_output();
      throw std::runtime_error(child->name() + " ended with exit code " + std::to_string(*code) +
                               "; its last words: " + child->last_line());
    }
  }
  for (int robot = 1; robot <= options_.robots; ++robot) check_agent(robot);
}

// Only a robot that was asked to may end.
void Fleet::check_agent(int robot) {
  ChildProcess* const agent = agent_of(robot);
  if (agent == nullptr) return;
  const auto code = agent->exit_code();
  if (!code) return;
  agent->read_output();
  if (*code != 0 || !dismissed_[index_of(robot)]) {
    throw std::runtime_error(agent->name() + " ended with exit code " + std::to_string(*code) +
                             "; its last words: " + agent->last_line());
  }
  agents_at_work_[index_of(robot)].reset();
  agents_[index_of(robot)].state = "left";
  agents_[index_of(robot)].at_work = false;
}

std::vector<ChildProcess*> Fleet::running_agents() {
  std::vector<ChildProcess*> out;
  for (const auto& agent : agents_at_work_) {
    if (agent) out.push_back(agent.get());
  }
  return out;
}

std::vector<ChildProcess*> Fleet::all() {
  std::vector<ChildProcess*> out = running_agents();
  for (const auto& child : services_) out.push_back(child.get());
  return out;
}

bool Fleet::stop() {
  bool good = stop_children(running_agents(), kGoodbyeTimeout);
  for (ChildProcess* agent : running_agents()) note_end(*agent);
  for (auto& agent : agents_at_work_) agent.reset();
  while (!services_.empty()) {
    good = stop_children({services_.back().get()}, seconds(5)) && good;
    note_end(*services_.back());
    services_.pop_back();
  }
  return good;
}

void Fleet::note_end(ChildProcess& child) {
  const int code = child.exit_code().value_or(-1);
  if (code == 0 || !failure_.empty()) return;
  failure_ = child.name() + " ended with exit code " + std::to_string(code) +
             "; its last words: " + child.last_line();
}

}  // namespace ivfm::host
