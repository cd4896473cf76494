// Whether the map server holds what the robot held: the run database against the robot's own dump.
// Usage: compare_maps RUN.db ROBOT.map     Exit code 1 when they differ.
#include <cstdio>
#include <exception>

#include "host/map_server/map_reader.h"

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fputs("usage: compare_maps RUN.db ROBOT.map\n", stderr);
    return 2;
  }
  try {
    const ivfm::host::MapComparison found = ivfm::host::compare_with_dumps(argv[1], {argv[2]});
    if (!found.equal()) std::printf("%s\n", found.first_difference.c_str());
    if (found.equal()) std::printf("%llu cells seen\n", 0ull + found.explored_cells);
    return found.equal() ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "compare_maps: %s\n", error.what());
    return 1;
  }
}
