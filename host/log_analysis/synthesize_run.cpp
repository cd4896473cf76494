// Writes a run database of any length without robots, to measure what reads it.
// Usage: synthesize_run FILE.db ROBOTS SECONDS
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "host/log_analysis/synthetic_run.h"

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: synthesize_run FILE.db ROBOTS SECONDS\n");
    return 2;
  }
  ivfm::host::SyntheticRun run;
  run.robots = std::atoi(argv[2]);
  run.length_s = std::atof(argv[3]);
  try {
    ivfm::host::write_synthetic_run(argv[1], run);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "synthesize_run: %s\n", error.what());
    return 1;
  }
  return 0;
}
