// What a decision costs, part by part and as a whole, and how many decisions the environment of
// evaluation and training makes in a second.
#include <benchmark/benchmark.h>

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "firmware/agent/profile.h"
#include "firmware/nn/q_network.h"
#include "firmware/planning/explorer.h"
#include "host/environment/arena_worlds.h"
#include "host/environment/exploration_environment.h"
#include "host/quantizer/quantizer.h"
#include "host/simulator/recording.h"

namespace ivfm::host {
namespace {

// The shipped network's shape with random weights: a decision costs the same.
class Network {
 public:
  Network() : file_(quantize(make_random_network(1), make_example_states(1, 4))) {
    if (!ok(network_.load(file_).status)) throw std::runtime_error("the model was refused");
  }
  QNetwork& get() { return network_; }

 private:
  std::vector<std::uint8_t> file_;
  QNetwork network_;
};

// The robot profile's explorer after the recorded drive of 225 scans, and where it ended.
struct DrivenExplorer {
  DrivenExplorer() {
    const Recording recording =
        read_recording(std::string(IVFM_SOURCE_DIR) + "/tests/golden/telecom_faculty.recording");
    explorer.start(recording.scans.front().lidar_pose);
    for (std::size_t i = 0; i < recording.scans.size(); ++i) {
      if (i % 10 == 0) explorer.begin_action();
      Scan scan;
      for (const ScanPoint& point : full_turn(recording.scans[i])) scan.push(point);
      pose = recording.scans[i].lidar_pose;
      explorer.fuse(pose, scan);
    }
  }
  ExplorerFor<RobotProfile> explorer{ExplorerConfig::lidar(3'000'000, RobotProfile::kCellUm)};
  Pose pose;
};

// Local shortest path map and both state channels.
void observe_state(benchmark::State& state) {
  const auto driven = std::make_unique<DrivenExplorer>();
  while (state.KeepRunning()) driven->explorer.observe(driven->pose);
}
BENCHMARK(observe_state)->Unit(benchmark::kMicrosecond);

void shortest_path_map(benchmark::State& state) {
  const auto driven = std::make_unique<DrivenExplorer>();
  ExplorationMap& map = driven->explorer.map();
  const Cell robot = map.frame().cell_at(driven->pose.position);
  const auto half = static_cast<std::int32_t>(state.range(0)) / 2;
  const CellRect region{robot.x - half, robot.y - half, 2 * half, 2 * half};
  while (state.KeepRunning()) driven->explorer.paths().compute(map, robot, region);
}
BENCHMARK(shortest_path_map)
    ->ArgName("cells")
    ->Arg(256)
    ->Arg(RobotProfile::kWindowCells)
    ->Unit(benchmark::kMicrosecond);

void network_inference(benchmark::State& state) {
  Network network;
  const std::vector<std::uint16_t> channels(2 * kPolicyGridSize, 20'000);
  while (state.KeepRunning()) benchmark::DoNotOptimize(network.get().run(channels).data());
}
BENCHMARK(network_inference)->Unit(benchmark::kMicrosecond);

// Shortest path map, state, network, goal and path.
void whole_decision(benchmark::State& state) {
  const auto driven = std::make_unique<DrivenExplorer>();
  Network network;
  while (state.KeepRunning()) {
    benchmark::DoNotOptimize(driven->explorer.decide(driven->pose, network.get()));
  }
}
BENCHMARK(whole_decision)->Unit(benchmark::kMicrosecond);

// Decisions and the drives between them in the paper's 1x arena: what `ivfm eval` does all day.
void evaluator_decisions(benchmark::State& state) {
  ExplorationEnvironment environment(EnvironmentConfig::arena());
  Network network;
  std::uint64_t seed = 0;
  while (state.KeepRunning()) {
    if (environment.is_done() || environment.totals().total_actions() >= 100) {
      environment.reset(random_arena(ArenaKind::k1x, 1, ++seed));
    }
    const int agent = environment.next_agent();
    Explorer& explorer = environment.explorer(agent);
    environment.step_decision(agent, explorer.decide(environment.pose(agent), network.get()));
  }
  state.SetItemsProcessed(state.iterations());
}
BENCHMARK(evaluator_decisions)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace ivfm::host

BENCHMARK_MAIN();
