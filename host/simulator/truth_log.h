// The true motion of simulated robots as CSV: what really happened, to judge what agents believe.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <vector>

#include "host/simulator/simulation.h"

namespace ivfm::host {

// One row: time_s,robot,x_m,y_m,heading_deg,travelled_m,collisions,unix_us (map frame; times of the
// simulation, and of the wall clock at that moment). The file begins with a row of these names.
struct TruthRow {
  double time_s = 0;
  int robot = 0;  // 1 ..
  TruePose pose;
  double travelled_m = 0;
  int collisions = 0;
  std::int64_t unix_us = 0;  // 0: the simulation has its own time
};

class TruthLog {
 public:
  static constexpr TimeUs kPeriodUs = 100'000;

  // Throws std::runtime_error when `path` cannot be written.
  explicit TruthLog(const std::filesystem::path& path);
  // Writes a row a robot when the period is over. `unix_us`: as in TruthRow.
  void record(const Simulation& simulation, std::int64_t unix_us);

 private:
  std::filesystem::path path_;
  std::ofstream out_;
  TimeUs next_us_ = 0;
};

// Reads such a file; rows that are cut off or damaged are left out (the writer may have been
// killed). Throws std::runtime_error when the file is missing or is not of this kind.
std::vector<TruthRow> read_truth_log(const std::filesystem::path& path);

}  // namespace ivfm::host
