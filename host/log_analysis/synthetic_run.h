// Run databases made without robots: to test and measure what reads them.
#pragma once

#include <cstdint>
#include <filesystem>

namespace ivfm::host {

struct SyntheticRun {
  int robots = 2;
  double length_s = 60;
  // What goes wrong, each of robot 1 (and 2): the reports must name it.
  bool blocked = false;  // 1 stands before an obstacle from a quarter of the run to its end
  bool lossy = false;    // of what 1 sends a third is lost, and it is silent for a while
  bool in_each_others_way = false;  // 1 and 2 stand face to face for a quarter of the run
};

// Every robot drives lanes through a field of its own, with a pose ten times and a status message
// once a second, as the map server would have stored them. The same arguments give the same bytes.
void write_synthetic_run(const std::filesystem::path& database, const SyntheticRun& run);

}  // namespace ivfm::host
