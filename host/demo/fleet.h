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
  std::vector<int> late;  // robots that start() leaves out: start_agent() is for later
  // Robots but the first are told start poses up to 0.5 m and 15 degrees wrong, and that they are.
  bool rough_starts = false;
  bool unknown_starts = false;  // robots but the first are told nothing of where they start
  std::string radio;            // faults between robots and server, as of ivfm radio; empty: none
  std::uint64_t seed = 1;
  double time_scale = 4;
};

// What an agent has counted since its start.
struct AgentCounters {
  double driven_m = 0;
  std::uint64_t actions = 0;
  std::uint64_t newly_seen_cells = 0;
  std::uint64_t bytes_sent = 0;
  std::uint64_t bytes_received = 0;
  std::uint64_t retransmissions = 0;
  std::uint64_t scans = 0;
  std::uint64_t resyncs = 0;
  std::uint64_t can_frames = 0;
  AgentCounters& operator+=(const AgentCounters& other);
};

// What an agent said in its last line of telemetry; counters over all its starts.
struct AgentReport : AgentCounters {
  std::string state = "not there";
  double decision_ms = 0;  // real time
  double slowest_decision_ms = 0;
  int starts = 0;
  bool at_work = false;   // its process runs
  bool leaving = false;   // was asked to: it hands over its map, which a bad radio may prolong
  AgentCounters earlier;  // of all starts but this one
  // The agent is started (again).
  void begin();
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

  // Returns when every agent runs that is not late.
  void start();
  // Switches one robot on, at first or again; its telemetry tells when it runs. `start`: where it
  // is then, x,y,heading; empty: where the simulation has put it.
  void start_agent(int robot, const std::string& start = {});
  // Asks a robot to stop, hand over its map and end.
  void dismiss_agent(int robot);
  // Like a power cut.
  void kill_agent(int robot);
  // On the map server's clock, about.
  double server_seconds() const;
  // From now on the radio is perfect.
  void end_radio_faults();
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
  std::unique_ptr<ChildProcess> launch(const std::string& name,
                                       const std::vector<std::string>& command,
                                       ChildProcess::LineHandler on_line);
  ChildProcess& launch_service(const std::string& name, const std::vector<std::string>& command,
                               ChildProcess::LineHandler on_line);
  void start_bus();
  void start_simulator();
  void start_server();
  void start_radio();
  void wait_until(const ChildProcess& child, const std::function<bool()>& ready);
  void check_children();
  void check_agent(int robot);
  std::vector<ChildProcess*> all();
  std::vector<ChildProcess*> running_agents();
  ChildProcess* agent_of(int robot) const { return agents_at_work_[index_of(robot)].get(); }
  static std::size_t index_of(int robot) { return static_cast<std::size_t>(robot - 1); }
  void note_end(ChildProcess& child);

  FleetOptions options_;
  const std::atomic<bool>& interrupted_;
  std::vector<std::unique_ptr<ChildProcess>> services_;        // in the order of their start
  std::vector<std::unique_ptr<ChildProcess>> agents_at_work_;  // one a robot, null: does not run
  std::vector<bool> dismissed_;
  ChildProcess* radio_ = nullptr;
  std::string bus_address_;  // HOST:PORT
  std::string server_address_;
  std::string radio_address_;  // what the robots take for the server's, if there is a radio
  std::chrono::steady_clock::time_point server_started_;
  std::string live_page_;                 // link with its token
  std::vector<std::string> connections_;  // of each robot, as the simulator printed them
  bool simulator_ready_ = false;
  std::vector<AgentReport> agents_;
  std::size_t agents_running_ = 0;
  int collisions_ = 0;
  std::string failure_;
};

}  // namespace ivfm::host
