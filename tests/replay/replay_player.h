// Plays a replay file into an agent or an explorer and hashes everything that they decide.
#pragma once

#include <cstdint>

#include "firmware/agent/agent.h"
#include "tests/replay/fnv1a.h"
#include "tests/replay/replay_ports.h"
#include "tests/replay/replay_reader.h"

namespace ivfm::replay {

// One decision of a replay.
struct DecisionReport {
  std::uint32_t number = 0;  // from 1
  TimeUs now_us = 0;         // 0 for an explorer
  Decision decision;
  std::uint64_t hash = 0;  // of this decision alone: map, state, Q values, goal, path
  std::uint64_t work = 0;  // of this decision, when it is counted
};

class DecisionListener {
 public:
  virtual void on_decision(const DecisionReport& report) = 0;

 protected:
  ~DecisionListener() = default;
};

// Counted work of one kind, e.g. of all decisions.
struct WorkStatistics {
  std::uint32_t count = 0;
  std::uint64_t total = 0;
  std::uint64_t largest = 0;
  void add(std::uint64_t work) {
    ++count;
    total += work;
    largest = work > largest ? work : largest;
  }
};

struct ReplaySummary {
  std::uint32_t steps = 0;  // of the agent, or views of the explorer
  std::uint32_t decisions = 0;
  std::uint32_t local_goals = 0;  // the network's choices among them
  std::uint32_t scans = 0;
  std::uint32_t matched = 0;  // of them, against the map
  std::uint32_t frames_sent = 0;
  std::uint32_t unused_steps = 0;  // the agent left input unread: not the agent that was recorded
  std::uint64_t hash = 0;          // of all decisions and of every byte and frame sent
  WorkStatistics decision_work;
  WorkStatistics fusion_work;  // fusing a revolution into the map, in steps that decide nothing
  WorkStatistics scan_work;    // steps that fuse a revolution and decide nothing, in whole
  WorkStatistics step_work;    // all other steps without a decision
  // All steps from after one fused revolution to the next, where none decides anything.
  WorkStatistics revolution_work;
};

// The hash of a decision: the known part of the map, the state, the Q values, the goal, the path.
std::uint64_t hash_decision(const Explorer& explorer, const Decision& decision);

// Plays the records after an agent's header. `agent` must be fresh, made on this object's ports.
class AgentReplay {
 public:
  explicit AgentReplay(ReplayReader& reader, WorkCounter* counter = nullptr)
      : reader_(reader), counter_(counter), clock_(input_, counter) {}
  AgentReplay(const AgentReplay&) = delete;
  AgentReplay& operator=(const AgentReplay&) = delete;

  AgentPorts ports() { return {serial_, can_, radio_, clock_}; }
  // Codes as ReplayReader::status(); `summary` covers what came before a failure. `listener` may be
  // null.
  Status run(Agent& agent, DecisionListener* listener, ReplaySummary& summary);

 private:
  void step(Agent& agent, DecisionListener* listener, ReplaySummary& summary);

  ReplayReader& reader_;
  WorkCounter* counter_;
  Fnv1a hash_;
  StepInput input_;
  ReplaySerialPort serial_{input_, hash_};
  ReplayCanBus can_{input_, hash_};
  ReplayRadio radio_{input_, hash_};
  ReplayClock clock_;
  RobotState state_ = RobotState::kBoot;
  std::uint64_t revolution_ = 0;  // work of its steps so far
  bool decided_ = false;          // in this revolution
};

// Plays the records after an explorer's header.
Status replay_explorer(ReplayReader& reader, Explorer& explorer, QFunction& policy,
                       DecisionListener* listener, ReplaySummary& summary);

}  // namespace ivfm::replay
