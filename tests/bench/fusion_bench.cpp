// Scan fusion against MRPT's insertObservation: the same 225 real scans, poses and cell size.
#include <benchmark/benchmark.h>
#include <mrpt/maps/COccupancyGridMap2D.h>
#include <mrpt/obs/CObservation2DRangeScan.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "firmware/agent/profile.h"
#include "firmware/planning/explorer.h"
#include "host/simulator/recording.h"

namespace ivfm::host {
namespace {

// Google Benchmark has no fixtures for data that is loaded once.
const Recording& recording() {
  static const Recording loaded =
      read_recording(std::string(IVFM_SOURCE_DIR) + "/tests/golden/telecom_faculty.recording");
  return loaded;
}

std::vector<Scan> core_scans() {
  std::vector<Scan> scans;
  for (const RecordedScan& recorded : recording().scans) {
    Scan& scan = scans.emplace_back();
    for (const ScanPoint& point : full_turn(recorded)) scan.push(point);
  }
  return scans;
}

// Occupancy, and with range(0) also visits, from each scan; one iteration is the whole drive.
void core_fuse(benchmark::State& state) {
  const std::vector<Scan> scans = core_scans();
  const auto explorer = std::make_unique<ExplorerFor<RobotProfile>>(
      ExplorerConfig::lidar(3'000'000, RobotProfile::kCellUm));
  while (state.KeepRunning()) {
    state.PauseTiming();
    explorer->start(recording().scans.front().lidar_pose);
    state.ResumeTiming();
    for (std::size_t i = 0; i < scans.size(); ++i) {
      if (i % 10 == 0) explorer->begin_action();
      explorer->fuse(recording().scans[i].lidar_pose, scans[i], state.range(0) != 0);
    }
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(scans.size()));
  const auto& occupancy = explorer->map().layers().occupancy;
  state.counters["known_cells"] = static_cast<double>(
      std::ranges::count_if(occupancy, [](std::int8_t evidence) { return evidence != 0; }));
}
BENCHMARK(core_fuse)->ArgName("visits")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

void mrpt_insert_observation(benchmark::State& state) {
  std::vector<mrpt::obs::CObservation2DRangeScan> scans;
  std::vector<mrpt::poses::CPose3D> poses;
  for (const RecordedScan& recorded : recording().scans) {
    auto& scan = scans.emplace_back();
    const std::size_t rays = recorded.ranges_mm.size();
    scan.aperture = static_cast<float>(recorded.aperture * 2 * 3.14159265358979 / 65536);
    scan.rightToLeft = true;
    scan.maxRange = 81.0f;
    scan.resizeScan(rays);
    for (std::size_t i = 0; i < rays; ++i) {
      scan.setScanRange(i, static_cast<float>(recorded.ranges_mm[i]) / 1000);
      scan.setScanRangeValidity(i, recorded.ranges_mm[i] != 0);
    }
    poses.emplace_back(recorded.lidar_pose.position.x_um / 1e6,
                       recorded.lidar_pose.position.y_um / 1e6, 0.0,
                       recorded.lidar_pose.heading.radians(), 0.0, 0.0);
  }
  // The core's window: 1536 cells of 5 cm around the start.
  const float cell_m = RobotProfile::kCellUm / 1e6f;
  const float half_m = RobotProfile::kWindowCells * cell_m / 2;
  mrpt::maps::COccupancyGridMap2D map(-half_m, half_m, -half_m, half_m, cell_m);
  map.insertionOptions.maxDistanceInsertion = 12.0f;
  map.insertionOptions.wideningBeamsWithDistance = false;
  map.insertionOptions.considerInvalidRangesAsFreeSpace = false;
  while (state.KeepRunning()) {
    state.PauseTiming();
    map.fill(0.5f);
    state.ResumeTiming();
    for (std::size_t i = 0; i < scans.size(); ++i) map.insertObservation(scans[i], poses[i]);
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(scans.size()));
  const auto& cells = map.getRawMap();
  state.counters["known_cells"] = static_cast<double>(
      std::ranges::count_if(cells, [&](auto cell) { return cell != map.p2l(0.5f); }));
}
BENCHMARK(mrpt_insert_observation)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace ivfm::host

BENCHMARK_MAIN();
