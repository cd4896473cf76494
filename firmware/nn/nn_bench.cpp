// Benchmarks of the state encoder and the Q-network: each kernel set beside Eigen in floats.
#include <benchmark/benchmark.h>

#include <memory>
#include <random>
#include <stdexcept>
#include <vector>

#include "firmware/nn/kernels_tiled.h"
#include "firmware/nn/q_network.h"
#include "firmware/nn/state_encoder.h"
#include "host/quantizer/quantizer.h"

namespace ivfm {
namespace {

// A map of the robot profile's window with everything seen once or twice and a tenth obstacles.
struct Map {
  Map() : own(frame.size()), peers(frame.size()), flags(frame.size()), cost(frame.size()) {
    std::mt19937 random(1);
    for (std::size_t i = 0; i < own.size(); ++i) {
      own[i] = static_cast<std::uint8_t>(random() % 3);
      flags[i] = random() % 10 == 0 ? 1 : 0;
      cost[i] = static_cast<std::uint16_t>(random());
    }
  }
  GridFrame frame{50'000, {0, 0, 512, 512}};
  std::vector<std::uint8_t> own, peers, flags;
  std::vector<std::uint16_t> cost;
};

void encode_ivfm_channel(benchmark::State& state) {
  const Map map;
  const PolicyGrid grid = PolicyGrid::centred_on({256, 256}, static_cast<int>(state.range(0)));
  std::vector<std::uint16_t> out(kPolicyGridSize);
  const VisitView view{map.frame, map.own, map.peers, map.flags, 3};
  while (state.KeepRunning()) {
    benchmark::DoNotOptimize(encode_ivfm(view, grid, {12'800'000, 12'800'000}, 105'000, out));
    benchmark::ClobberMemory();
  }
}
BENCHMARK(encode_ivfm_channel)->Arg(2)->Arg(8)->Unit(benchmark::kMicrosecond);

void encode_path_channel(benchmark::State& state) {
  const Map map;
  const PolicyGrid grid = PolicyGrid::centred_on({256, 256}, static_cast<int>(state.range(0)));
  std::vector<std::uint16_t> out(kPolicyGridSize);
  while (state.KeepRunning()) {
    benchmark::DoNotOptimize(encode_path({map.frame, map.cost, 12, 0xffff}, grid, out));
    benchmark::ClobberMemory();
  }
}
BENCHMARK(encode_path_channel)->Arg(2)->Arg(8)->Unit(benchmark::kMicrosecond);

void run_int8(benchmark::State& state, const KernelSet& kernels) {
  const host::FloatNetwork network = host::make_random_network(1);
  const auto states = host::make_example_states(1, 4);
  const std::vector<std::uint8_t> file = host::quantize(network, states);
  const auto int8 = std::make_unique<QNetwork>(kernels);
  if (!ok(int8->load(file).status)) throw std::runtime_error("the model was refused");
  while (state.KeepRunning())
    benchmark::DoNotOptimize(int8->run(std::span(states).first(2 * kPolicyGridSize)).data());
  state.counters["GMAC/s"] =
      benchmark::Counter(static_cast<double>(int8->model().multiply_adds) * 1e-9,
                         benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK_CAPTURE(run_int8, reference, reference_kernels())->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(run_int8, portable, portable_kernels())->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(run_int8, fastest, fast_kernels())->Unit(benchmark::kMicrosecond);

void run_float_eigen(benchmark::State& state) {
  host::FloatRunner runner(host::make_random_network(1));
  const auto states = host::make_example_states(1, 1);
  while (state.KeepRunning()) benchmark::DoNotOptimize(runner.run(states).data());
}
BENCHMARK(run_float_eigen)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace ivfm

BENCHMARK_MAIN();
