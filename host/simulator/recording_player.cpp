#include "host/simulator/recording_player.h"

#include <stdexcept>
#include <type_traits>

namespace ivfm::host {

namespace {

constexpr TimeUs kTickUs = 5'000;
constexpr int kMaxTicks = 4'000;  // 20 s: the driver has long started over by then

class Fnv1a {
 public:
  template <typename T>
  void add(T value) {
    auto bits = static_cast<std::make_unsigned_t<T>>(value);
    for (std::size_t i = 0; i < sizeof(T); ++i) {
      hash_ = (hash_ ^ static_cast<std::uint8_t>(bits >> (8 * i))) * 0x100000001b3u;
    }
  }
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325u;
};

std::uint64_t hash_goals(const std::vector<ReplayGoal>& goals) {
  Fnv1a hash;
  for (const ReplayGoal& goal : goals) {
    hash.add(static_cast<std::uint8_t>(goal.decision.kind));
    hash.add(goal.decision.goal.x);
    hash.add(goal.decision.goal.y);
    hash.add(goal.decision.policy_cell);
  }
  return hash.value();
}

}  // namespace

RplidarConfig ScanWire::driver_config() {
  RplidarConfig config;
  config.prefer_express = false;  // a standard scan sends every point at its own angle
  config.min_range_mm = 1;        // the recording's lidar may have seen nearer than an RPLIDAR
  return config;
}

ScanWire::ScanWire() { driver_.start(now_us_); }

// The points are sent from the next revolution on, and that one is complete, at the driver's end,
// as soon as the one after it has begun.
const Scan& ScanWire::send(std::span<const ScanPoint> points) {
  if (points.size() < 16) throw std::invalid_argument("a scan needs at least 16 rays");
  emulator_.set_revolution(points);
  std::uint64_t target = emulator_.counters().revolutions + 2;
  bool was_scanning = emulator_.scanning();
  for (int tick = 0; tick < kMaxTicks; ++tick) {
    now_us_ += kTickUs;
    port_.set_now(now_us_);
    driver_.step(now_us_);
    if (!was_scanning && emulator_.scanning()) {
      was_scanning = true;
      target = emulator_.counters().revolutions + 2;
    }
    const Scan* scan = driver_.take_scan();
    if (scan != nullptr && was_scanning && emulator_.counters().revolutions >= target) {
      scan_ = *scan;
      return scan_;
    }
  }
  throw std::runtime_error("the lidar driver delivers no scan");
}

ReplayResult replay(const Recording& recording, Explorer& explorer, QFunction& policy,
                    const ReplayOptions& options,
                    const std::function<bool(std::size_t)>& progress) {
  ReplayResult result;
  if (recording.scans.empty()) throw std::invalid_argument("the recording holds no scans");
  if (options.scans_per_goal == 0) throw std::invalid_argument("an action needs a scan");
  ScanWire wire;
  explorer.start(recording.scans.front().lidar_pose);
  explorer.begin_action();
  for (const RecordedScan& recorded : recording.scans) {
    const Scan& scan = wire.send(full_turn(recorded));
    explorer.fuse(recorded.lidar_pose, scan);
    ++result.scans;
    for (const ScanPoint& point : scan.points()) result.points += point.echo == Echo::kHit;
    if (result.scans % options.scans_per_goal == 0) {
      const Decision decision = explorer.decide(recorded.lidar_pose, policy);
      result.goals.push_back({result.scans, recorded.lidar_pose, decision});
      explorer.begin_action();
    }
    if (progress && !progress(result.scans)) break;
  }
  result.map_hash = hash_map(explorer.map());
  result.goals_hash = hash_goals(result.goals);
  result.lidar = wire.counters();
  return result;
}

std::uint64_t hash_map(const ExplorationMap& map) {
  const CellRect known = map.known_rect().intersection(map.frame().window());
  Fnv1a hash;
  for (const std::int32_t side : {known.x, known.y, known.width, known.height}) hash.add(side);
  for (std::int32_t y = known.y; y < known.top(); ++y) {
    for (std::int32_t x = known.x; x < known.right(); ++x) {
      const std::size_t index = map.frame().index_of({x, y});
      hash.add(map.layers().occupancy[index]);
      hash.add(map.layers().own_visits[index]);
      hash.add(static_cast<std::uint8_t>(map.layers().flags[index] & cell_flag::kObstacle));
    }
  }
  return hash.value();
}

}  // namespace ivfm::host
