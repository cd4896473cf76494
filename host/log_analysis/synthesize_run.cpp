// Writes a run database of any length without robots, to measure what reads it.
// Usage: synthesize_run FILE.db ROBOTS SECONDS [blocked|lossy|meeting]
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

#include "host/log_analysis/synthetic_run.h"

int main(int argc, char** argv) {
  if (argc != 4 && argc != 5) {
    std::fprintf(stderr, "usage: synthesize_run FILE.db ROBOTS SECONDS [blocked|lossy|meeting]\n");
    return 2;
  }
  ivfm::host::SyntheticRun run;
  run.robots = std::atoi(argv[2]);
  run.length_s = std::atof(argv[3]);
  const std::string trouble = argc == 5 ? argv[4] : "";
  run.blocked = trouble == "blocked";
  run.lossy = trouble == "lossy";
  run.in_each_others_way = trouble == "meeting";
  try {
    ivfm::host::write_synthetic_run(argv[1], run);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "synthesize_run: %s\n", error.what());
    return 1;
  }
  return 0;
}
