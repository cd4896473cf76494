// Plays a recording as RPLIDAR bytes through the core's own driver into an explorer.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "firmware/lidar/rplidar_driver.h"
#include "firmware/nn/q_function.h"
#include "firmware/planning/explorer.h"
#include "host/simulator/emulated_serial_port.h"
#include "host/simulator/recording.h"
#include "host/simulator/rplidar_emulator.h"

namespace ivfm::host {

// Sends scans around through an emulated lidar and the core's driver, in process, as fast as it
// goes. Every range is exact to the millimetre, every angle to 1/64 degree.
class ScanWire {
 public:
  ScanWire();

  // What the driver makes of one revolution with these points. Valid until the next call. Throws
  // std::invalid_argument when there are fewer than 16, std::runtime_error when no scan comes out.
  const Scan& send(std::span<const ScanPoint> points);

  RplidarDriver::Counters counters() const { return driver_.counters(); }

 private:
  static RplidarConfig driver_config();

  RplidarEmulator emulator_;
  EmulatedSerialPort port_{emulator_};
  RplidarDriver driver_{port_, driver_config()};
  TimeUs now_us_ = 0;
  Scan scan_;
};

// No policy: the explorer falls back on the nearest frontier.
class NoPolicy final : public QFunction {
 public:
  Status evaluate(const LocalState&, std::span<std::int32_t>) override {
    return Status::kUnavailable;
  }
};

struct ReplayOptions {
  std::size_t scans_per_goal = 10;  // an action of the explorer; at least 1
};

// A goal that was computed on the way; nobody drives there.
struct ReplayGoal {
  std::size_t scan = 0;  // after so many scans
  Pose pose;
  Decision decision;
};

struct ReplayResult {
  std::size_t scans = 0;
  std::size_t points = 0;  // measured ones
  std::vector<ReplayGoal> goals;
  std::uint64_t map_hash = 0;
  std::uint64_t goals_hash = 0;
  RplidarDriver::Counters lidar;
};

// Starts `explorer` at the first pose and fuses the whole recording. `progress` is told the number
// of scans done and may be empty; when it answers false the replay ends early.
ReplayResult replay(const Recording& recording, Explorer& explorer, QFunction& policy,
                    const ReplayOptions& options = {},
                    const std::function<bool(std::size_t)>& progress = {});

// FNV-1a, 64 bits, over the rectangle of known cells and their occupancy, own visits and obstacle
// flag: the same map has the same hash on every machine.
std::uint64_t hash_map(const ExplorationMap& map);

}  // namespace ivfm::host
