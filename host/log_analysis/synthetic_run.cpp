#include "host/log_analysis/synthetic_run.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "firmware/supervisor/supervisor.h"
#include "host/map_server/run_database.h"

namespace ivfm::host {
namespace {

constexpr std::int32_t kCellUm = 50'000;
constexpr double kSpeedMPerS = 0.3, kFieldM = 25, kLaneM = 1.0, kStepS = 0.1;
constexpr std::int64_t kStepsPerS = 10;
constexpr std::uint64_t kUpdateBytes = 180;
constexpr std::uint8_t kObstacle = static_cast<std::uint8_t>(StopReason::kObstacle);

class Field {
 public:
  Field(const SyntheticRun& run, int robot) : run_(run), robot_(robot) {
    record_.robot = static_cast<std::uint16_t>(robot);
    record_.name = "robot " + std::to_string(robot);
    record_.epoch = 1;
    // Fields lie in rows of five.
    left_m_ = (robot - 1) % 5 * kFieldM;
    low_m_ = (robot - 1) / 5 * kFieldM;
    status_.state = static_cast<std::uint8_t>(RobotState::kExploring);
    status_.decision_us = 3000;
  }

  // One tenth of a second. Writes what the server would have written.
  void step(RunDatabase& database, std::int64_t step) {
    const double time_s = static_cast<double>(step) * kStepS, share = time_s / run_.length_s;
    const bool first = robot_ == 1, second = robot_ == 2;
    const bool blocked = first && run_.blocked && share > 0.25;
    const bool meets = run_.in_each_others_way && (first || second);
    const bool facing = meets && share > 0.5 && share < 0.75;
    if (!blocked && !facing) drive(time_s);
    const std::int64_t time_us = step * 100'000;
    const Pose pose = pose_now(facing);
    const bool lost = first && run_.lossy && (step % 3 == 0 || (share > 0.4 && share < 0.6));
    ++status_.datagrams_sent;
    if (lost) {
      ++status_.retransmissions;
      return;
    }
    receive(database, time_us, pose, step % kStepsPerS == 0);
    if (step % kStepsPerS != 0) return;
    status_.uptime_ms = static_cast<std::uint32_t>(time_us / 1000);
    status_.distance_mm = static_cast<std::uint32_t>(driven_m_ * 1000);
    status_.fault = blocked || facing ? kObstacle : 0;
    database.add_status(time_us, record_.robot, status_);
    if (status_.goal == goal_) return;
    status_.goal = goal_;
    database.add_goal(time_us, record_.robot, goal_);
  }

  const RobotRecord& record() const { return record_; }
  const std::map<TileKey, RobotTile>& tiles() const { return tiles_; }
  const std::map<TileKey, FirstSeen>& first_seen() const { return first_seen_; }
  std::uint64_t explored() const { return explored_; }

 private:
  // Back and forth in lanes, one above the other, and from the top down again.
  void drive(double time_s) {
    driven_m_ += kSpeedMPerS * kStepS;
    const double row_m = kFieldM - 2;
    const auto lane = static_cast<std::int64_t>(driven_m_ / row_m);
    const double along = std::fmod(driven_m_, row_m);
    constexpr auto kLanes = static_cast<std::int64_t>(kFieldM / kLaneM) - 2;
    const std::int64_t folded = lane % (2 * kLanes);
    const std::int64_t height = folded < kLanes ? folded : 2 * kLanes - folded;
    x_m_ = left_m_ + 1 + (lane % 2 == 0 ? along : row_m - along);
    y_m_ = low_m_ + 1 + static_cast<double>(height) * kLaneM;
    heading_ = BinaryAngle::from_degrees(lane % 2 == 0 ? 0 : 180);
    const auto action = static_cast<std::uint32_t>(driven_m_ / 0.5);
    if (action == status_.actions) return;
    status_.actions = action;
    status_.decision_us = 2000 + action % 7 * 400;
    goal_ = GridFrame(kCellUm, {}).cell_at(place());
    see(time_s);
  }

  Point place() const {
    return {static_cast<std::int32_t>(x_m_ * 1e6), static_cast<std::int32_t>(y_m_ * 1e6)};
  }

  // In each other's way: both at the border of their fields, half a metre apart.
  Pose pose_now(bool facing) const {
    if (!facing) return {place(), heading_};
    const double x_m = kFieldM + (robot_ == 1 ? -0.25 : 0.25);
    return {{static_cast<std::int32_t>(x_m * 1e6), 5'000'000},
            BinaryAngle::from_degrees(robot_ == 1 ? 0 : 180)};
  }

  void see(double time_s) {
    constexpr std::int32_t kSight = 15;
    const Cell middle = goal_;
    for (std::int32_t y = middle.y - kSight; y <= middle.y + kSight; ++y) {
      for (std::int32_t x = middle.x - kSight; x <= middle.x + kSight; ++x) {
        const TileKey key{Layer::kVisits, x >> 5, y >> 5};
        std::uint8_t& visits = tiles_[key].cells[tile_index({x, y})];
        visits = static_cast<std::uint8_t>(std::min(255, visits + 1));
        if (visits > 1) continue;
        ++explored_;
        first_seen_[key][tile_index({x, y})] = static_cast<std::uint32_t>(time_s * 10) + 1;
      }
    }
  }

  void receive(RunDatabase& database, std::int64_t time_us, const Pose& pose, bool log) {
    TrafficCounters& traffic = record_.traffic;
    ++traffic.datagrams_in;
    traffic.bytes_in += kUpdateBytes;
    traffic.layers[0].bytes += kUpdateBytes / 2;
    traffic.layers[0].cells += 300;
    ++traffic.datagrams_out;
    traffic.bytes_out += 61;
    record_.last_seen_us = time_us;
    database.add_pose(time_us, record_.robot, pose);
    if (log) database.add_traffic(time_us, record_.robot, traffic);
  }

  const SyntheticRun& run_;
  int robot_;
  RobotRecord record_;
  RobotStatus status_;
  Cell goal_;
  double left_m_ = 0, low_m_ = 0, x_m_ = 0, y_m_ = 0, driven_m_ = 0;
  BinaryAngle heading_;
  std::map<TileKey, RobotTile> tiles_;
  std::map<TileKey, FirstSeen> first_seen_;
  std::uint64_t explored_ = 0;
};

}  // namespace

void write_synthetic_run(const std::filesystem::path& path, const SyntheticRun& run) {
  RunDatabase database(path);
  database.begin_session(0, 1);
  std::vector<Field> fields;
  for (int robot = 1; robot <= run.robots; ++robot) fields.emplace_back(run, robot);
  const auto steps = static_cast<std::int64_t>(run.length_s / kStepS);
  database.begin();
  database.save_cell_um(kCellUm);
  for (const Field& field : fields)
    database.add_event(0, field.record().robot, "started", "epoch 1");
  for (std::int64_t step = 1; step <= steps; ++step) {
    for (Field& field : fields) field.step(database, step);
    if (step % kStepsPerS != 0) continue;
    std::uint64_t explored = 0;
    for (const Field& field : fields) explored += field.explored();
    database.add_progress(step * 100'000, explored, 0);
  }
  for (const Field& field : fields) {
    database.save_robot(field.record());
    for (const auto& [key, tile] : field.tiles()) {
      database.save_tile(field.record().robot, key, tile);
    }
    for (const auto& [key, seen] : field.first_seen()) database.save_first_seen(key, seen);
  }
  database.save_time(steps * 100'000);
  database.commit();
}

}  // namespace ivfm::host
