// Prints of what parts the agent's fixed memory consists, for each profile: bytes by module. The
// sum is all of it. Run by the build.
#include <cstdio>

#include "firmware/agent/agent.h"

namespace ivfm {
namespace {

struct Part {
  const char* module;
  const char* what;
  std::size_t bytes;
};

template <typename Profile>
void print_profile() {
  const std::size_t all = sizeof(AgentFor<Profile>);
  const Part parts[] = {
      {"mapping", "grid layers", sizeof(MapStorage<Profile::kWindowCells>)},
      {"mapping", "shortest path queue", sizeof(BucketStorage<Profile::kBucketCapacity>)},
      {"planning", "explorer: fusion, state, goals", sizeof(Explorer)},
      {"localization", "surfaces of walls", sizeof(SurfaceStorage<Profile::kSurfaceCells>)},
      {"localization", "odometry, scan matcher", sizeof(Localization)},
      {"lidar", "decoder, driver, scans", sizeof(RplidarDriver)},
      {"wheel_drive", "two drives", sizeof(WheelDrive)},
      {"nn", "network's activations", sizeof(QNetwork)},
      {"tracking", "path follower", sizeof(PathFollower)},
      {"supervisor", "", sizeof(Supervisor)},
      {"link", "map changes, radio", sizeof(MapLink)},
  };
  std::size_t sum = 0;
  std::printf("agent's fixed memory, profile %s\n", Profile::kName);
  for (const Part& part : parts) {
    std::printf("  %-14s %-32s %10zu\n", part.module, part.what, part.bytes);
    sum += part.bytes;
  }
  std::printf("  %-14s %-32s %10zu\n", "agent", "configuration, last scan, state", all - sum);
  std::printf("  %-47s %10zu\n", "in all", all);
}

}  // namespace
}  // namespace ivfm

int main() {
  ivfm::print_profile<ivfm::PaperProfile>();
  ivfm::print_profile<ivfm::RobotProfile>();
  ivfm::print_profile<ivfm::McuProfile>();
}
