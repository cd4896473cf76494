// A run of whole agents in one process and in simulated time: emulated lidars and drives with noise
// and slip, a radio without loss, the map server. As fast as the processor goes, the same each
// time.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "firmware/agent/linux/agent_options.h"
#include "host/demo/run_scores.h"
#include "host/simulator/mrpt_lidar.h"
#include "host/simulator/world_catalog.h"

namespace ivfm::host {

struct RehearsalOptions {
  WorldRequest world;
  AgentOptions agent;  // of every robot; its number and start are the rehearsal's
  OdometryNoise odometry;
  LidarModel lidar;
  std::vector<std::uint8_t> model;  // a quantized Q-network; empty: the agents go without
  bool unknown_starts = false;      // all robots but the first know nothing of where they start
  double until = 0.5;               // share of the explorable cells
  double time_limit_s = 900;        // simulated
  const std::atomic<bool>* interrupted = nullptr;  // ends the run, whose result means nothing then
};

// A robot that did not know its start and has become part of the team.
struct Joining {
  double after_s = 0;
  double off_m = 0, off_rad = 0;  // where it then believes to be, against where it is
};

struct RehearsalResult {
  RunScores scores;
  std::uint32_t actions = 0;  // of all robots
  double driven_m = 0;        // truly, by all robots
  double simulated_s = 0;
  double rms_error_m = 0;      // between where the robots believe to be and where they are
  double largest_error_m = 0;  // of that
  int collisions = 0;
  bool goal_reached = false;
  std::vector<Joining> joined;
  int apart = 0;  // robots whose place in the team's map was not found
};

// Throws what prepare_world() throws, and std::invalid_argument for a model that does not fit.
RehearsalResult rehearse(const RehearsalOptions& options);

}  // namespace ivfm::host
