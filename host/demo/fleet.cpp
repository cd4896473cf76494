#include "host/demo/fleet.h"

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>
#include <utility>

#include "host/map_server/keygen_command.h"

namespace ivfm::host {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;

constexpr seconds kStartTimeout{20};
constexpr seconds kGoodbyeTimeout{20};

// The text between `before` and the first of `end` after it; empty when `before` is not in `line`.
std::string between(std::string_view line, std::string_view before, std::string_view end) {
  const std::size_t begin = line.find(before);
  if (begin == std::string_view::npos) return {};
  const std::string_view rest = line.substr(begin + before.size());
  return std::string(rest.substr(0, rest.find_first_of(end)));
}

std::string shortest(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

}  // namespace

void AgentReport::take(std::string_view line, double time_scale) {
  if (line.empty() || line.front() != '{') return;
  const auto json = nlohmann::json::parse(line, nullptr, false);
  if (!json.is_object()) return;
  try {
    state = json.value("state", state);
    driven_m = json.value("travelled_m", driven_m);
    actions = json.value("actions", actions);
    newly_seen_cells = json.value("newly_seen_cells", newly_seen_cells);
    decision_ms = json.value("decision_us", 0.0) / 1e3 / time_scale;
    slowest_decision_ms = std::max(slowest_decision_ms, decision_ms);
    const auto radio = json.value("radio", nlohmann::json::object());
    bytes_sent = radio.value("bytes_sent", bytes_sent);
    bytes_received = radio.value("bytes_received", bytes_received);
    retransmissions = radio.value("retransmissions", retransmissions);
    const auto lidar = json.value("lidar", nlohmann::json::object());
    scans = lidar.value("scans", scans);
    resyncs = lidar.value("resyncs", resyncs);
    can_frames = json.value("can", nlohmann::json::object()).value("frames_received", can_frames);
  } catch (const nlohmann::json::exception&) {
    // A value of another type: a line that is not ours.
  }
}

Fleet::Fleet(FleetOptions options, const std::atomic<bool>& interrupted)
    : options_(std::move(options)),
      interrupted_(interrupted),
      connections_(static_cast<std::size_t>(options_.robots)),
      agents_(static_cast<std::size_t>(options_.robots)) {}

Fleet::~Fleet() {
  // Agents first: the others are what they drive with.
  while (!children_.empty()) children_.pop_back();
}

std::filesystem::path Fleet::map_dump(int robot) const {
  return options_.folder / ("robot" + std::to_string(robot) + ".map");
}

ChildProcess& Fleet::launch(const std::string& name, const std::vector<std::string>& command,
                            ChildProcess::LineHandler on_line) {
  const std::filesystem::path logs = options_.folder / "logs";
  std::filesystem::create_directories(logs);
  children_.push_back(
      std::make_unique<ChildProcess>(name, command, logs / (name + ".log"), std::move(on_line)));
  return *children_.back();
}

void Fleet::start() {
  std::ostringstream unsaid;
  write_team_keys(options_.robots, options_.folder / "keys", unsaid);
  start_bus();
  start_simulator();
  start_server();
  for (int robot = 1; robot <= options_.robots; ++robot) start_agent(robot);
  wait_until(*children_.back(), [this] { return agents_running_ == options_.robots; });
}

void Fleet::start_bus() {
  const ChildProcess& child = launch("canbus",
                                     {options_.ivfm, "canbus", "--listen", "127.0.0.1:0", "--log",
                                      can_log(), "--time-scale", shortest(options_.time_scale)},
                                     [this](std::string_view line) {
                                       if (bus_address_.empty())
                                         bus_address_ = between(line, "socketcand:", "/ ");
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
  const ChildProcess& child = launch("sim", command, [this](std::string_view line) {
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
  const ChildProcess& child = launch("serve", command, [this](std::string_view line) {
    if (server_address_.empty()) server_address_ = between(line, "listening on ", ", ");
    if (live_page_.empty()) live_page_ = between(line, "live page ", " ");
  });
  wait_until(child, [this] { return !server_address_.empty() && !live_page_.empty(); });
}

void Fleet::start_agent(int robot) {
  const auto index = static_cast<std::size_t>(robot - 1);
  std::vector<std::string> command{options_.agent};
  std::istringstream connections(connections_[index]);  // --lidar, --can, --start and their values
  std::copy(std::istream_iterator<std::string>(connections), {}, std::back_inserter(command));
  for (const std::string& argument :
       {std::string("--server"), server_address_, std::string("--robot-id"), std::to_string(robot),
        std::string("--key"),
        (options_.folder / "keys" / ("robot" + std::to_string(robot) + ".key")).string(),
        std::string("--time-scale"), shortest(options_.time_scale), std::string("--dump-map"),
        map_dump(robot).string(), std::string("--telemetry"), std::string("json")}) {
    command.push_back(argument);
  }
  command.insert(command.end(), options_.agent_arguments.begin(), options_.agent_arguments.end());
  launch("agent" + std::to_string(robot), command, [this, index](std::string_view line) {
    if (line.starts_with("ivfm-agent: robot")) ++agents_running_;
    agents_[index].take(line, options_.time_scale);
  });
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
  for (const auto& child : children_) {
    if (const auto code = child->exit_code()) {
      child->read_output();
      throw std::runtime_error(child->name() + " ended with exit code " + std::to_string(*code) +
                               "; its last words: " + child->last_line());
    }
  }
}

std::vector<ChildProcess*> Fleet::all() {
  std::vector<ChildProcess*> out;
  for (const auto& child : children_) out.push_back(child.get());
  return out;
}

bool Fleet::stop() {
  const auto agents = static_cast<std::size_t>(options_.robots);
  bool good = stop_last(agents, kGoodbyeTimeout);
  while (!children_.empty()) good = stop_last(1, seconds(5)) && good;
  return good;
}

// Stops the `count` processes that were started last, and forgets them.
bool Fleet::stop_last(std::size_t count, milliseconds grace) {
  std::vector<ChildProcess*> last;
  for (std::size_t i = children_.size() - count; i < children_.size(); ++i) {
    last.push_back(children_[i].get());
  }
  const bool good = stop_children(last, grace);
  for (ChildProcess* child : last) {
    const int code = child->exit_code().value_or(-1);
    if (code != 0 && failure_.empty()) {
      failure_ = child->name() + " ended with exit code " + std::to_string(code) +
                 "; its last words: " + child->last_line();
    }
  }
  children_.resize(children_.size() - count);
  return good;
}

}  // namespace ivfm::host
