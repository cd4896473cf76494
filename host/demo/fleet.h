// The processes of a software-in-the-loop run: CAN bus, simulator, map server and agents.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "host/demo/child_process.h"

namespace ivfm::host {

struct FleetOptions {
  std::filesystem::path ivfm;                    // the host tool
  std::filesystem::path agent;                   // ivfm-agent
  std::filesystem::path folder;                  // for the run's files; exists
  std::vector<std::string> simulator_arguments;  // world, robots, seed, noise, faults
  std::vector<std::string> server_arguments;     // visit range and model, for the live page
  std::vector<std::string> agent_arguments;      // the same for every robot
  int robots = 2;
  double time_scale = 4;
};

// What an agent said in its last line of telemetry.
struct AgentReport {
  std::string state = "starting";
  double driven_m = 0;
  std::uint64_t actions = 0;
  std::uint64_t newly_seen_cells = 0;
  double decision_ms = 0;  // real time
  double slowest_decision_ms = 0;
  std::uint64_t bytes_sent = 0;
  std::uint64_t bytes_received = 0;
  std::uint64_t retransmissions = 0;
  std::uint64_t scans = 0;
  std::uint64_t resyncs = 0;
  std::uint64_t can_frames = 0;
  // Takes over a line of JSON telemetry; other lines are ignored.
  void take(std::string_view line, double time_scale);
};

// Somebody pressed Ctrl-C or asked the program to end.
class Interrupted : public std::runtime_error {
 public:
  Interrupted() : std::runtime_error("interrupted") {}
};

// Starts everything in order, each as soon as what it needs is ready. No process outlives the
// object, nor this program.
class Fleet {
 public:
  // `interrupted` is looked at while waiting. All functions throw Interrupted then, and
  // std::runtime_error with what a process said when it ended too early.
  Fleet(FleetOptions options, const std::atomic<bool>& interrupted);
  // Kills what still runs.
  ~Fleet();

  // Returns when every agent runs.
  void start();
  // Lets `time` of real time pass and takes in what the processes say.
  void wait(std::chrono::milliseconds time);
  // Lets the agents stop and hand over their maps, then ends the server, simulator and bus. False
  // when one of them did not end properly: failure() says which.
  bool stop();

  // Link to the live page; may command the robots.
  const std::string& live_page() const { return live_page_; }
  const std::vector<AgentReport>& agents() const { return agents_; }
  // Contacts that the simulator has announced.
  int collisions() const { return collisions_; }
  const std::string& failure() const { return failure_; }

  std::filesystem::path database() const { return options_.folder / "run.db"; }
  std::filesystem::path can_log() const { return options_.folder / "can.log"; }
  std::filesystem::path truth() const { return options_.folder / "truth.csv"; }
  std::filesystem::path map_dump(int robot) const;

 private:
  ChildProcess& launch(const std::string& name, const std::vector<std::string>& command,
                       ChildProcess::LineHandler on_line);
  void start_bus();
  void start_simulator();
  void start_server();
  void start_agent(int robot);
  void wait_until(const ChildProcess& child, const std::function<bool()>& ready);
  void check_children();
  std::vector<ChildProcess*> all();
  bool stop_last(std::size_t count, std::chrono::milliseconds grace);

  FleetOptions options_;
  const std::atomic<bool>& interrupted_;
  std::vector<std::unique_ptr<ChildProcess>> children_;  // in the order of their start
  std::string bus_address_;                              // HOST:PORT
  std::string server_address_;
  std::string live_page_;                 // link with its token
  std::vector<std::string> connections_;  // of each robot, as the simulator printed them
  bool simulator_ready_ = false;
  std::vector<AgentReport> agents_;
  int agents_running_ = 0;
  int collisions_ = 0;
  std::string failure_;
};

}  // namespace ivfm::host
