#include "host/log_analysis/drive_data.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "firmware/agent/profile.h"
#include "host/cli/progress_line.h"
#include "host/map_server/map_store.h"
#include "host/simulator/rawlog_replay.h"
#include "host/simulator/recording_player.h"

namespace ivfm::host {
namespace {

constexpr std::uint16_t kRobot = 1;
constexpr std::int32_t kVisitRangeUm = 3'000'000;  // as `ivfm replay` and the robot have it
constexpr double kMovingMPerS = 0.03, kTurningRadPerS = 0.1;
constexpr double kGapFactor = 5;      // an interval of so many usual ones lacks scans
constexpr double kWorthTellingS = 3;  // on the time line

double seconds(TimeUs time_us) { return static_cast<double>(time_us) / 1e6; }

double usual_interval_s(const Recording& recording) {
  std::vector<TimeUs> intervals;
  for (std::size_t i = 1; i < recording.scans.size(); ++i) {
    intervals.push_back(recording.scans[i].time_us - recording.scans[i - 1].time_us);
  }
  if (intervals.empty()) return 0;
  const auto middle = intervals.begin() + static_cast<std::ptrdiff_t>(intervals.size() / 2);
  std::nth_element(intervals.begin(), middle, intervals.end());
  return seconds(*middle);
}

// What the robot did from one scan to the next.
Activity activity_of(const Pose& from, const Pose& to, double length_s, double gap_s) {
  if (length_s > gap_s) return Activity::kUnheard;
  const double moved_m =
      std::hypot(to.position.x_um - from.position.x_um, to.position.y_um - from.position.y_um) /
      1e6;
  if (moved_m > kMovingMPerS * length_s) return Activity::kDriving;
  const double turned =
      std::abs(std::remainder(to.heading.radians() - from.heading.radians(), 2 * std::numbers::pi));
  return turned > kTurningRadPerS * length_s ? Activity::kTurning : Activity::kStanding;
}

void add_way(const Recording& recording, RobotRun& robot) {
  const double gap_s = kGapFactor * usual_interval_s(recording);
  robot.path.push_back(recording.scans.front().lidar_pose.position);
  robot.driven.emplace_back(0, 0);
  for (std::size_t i = 1; i < recording.scans.size(); ++i) {
    const RecordedScan &before = recording.scans[i - 1], &scan = recording.scans[i];
    const Point from = before.lidar_pose.position, to = scan.lidar_pose.position;
    robot.driven_m += std::hypot(to.x_um - from.x_um, to.y_um - from.y_um) / 1e6;
    robot.path.push_back(to);
    const double begin_s = seconds(before.time_us), end_s = seconds(scan.time_us);
    robot.driven.emplace_back(end_s, robot.driven_m);
    const Activity activity =
        activity_of(before.lidar_pose, scan.lidar_pose, end_s - begin_s, gap_s);
    if (!robot.spans.empty() && robot.spans.back().activity == activity) {
      robot.spans.back().end_s = end_s;
    } else {
      robot.spans.push_back({begin_s, end_s, activity, 0, {}});
    }
  }
}

// Takes over what a scan has changed: the explorer's window may leave places behind.
void take_changes(ExplorationMap& map, MapStore& store, std::uint32_t sequence) {
  std::vector<TileChange> changes;
  std::vector<std::uint8_t> cells;
  for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
    const CellRect rect = map.take_changes(layer).intersection(map.frame().window());
    if (rect.empty()) continue;
    cells.resize(static_cast<std::size_t>(rect.area()));
    if (!ok(map.read_own(layer, rect, cells))) continue;
    store.merge(kRobot, 1, sequence, layer, rect, cells, changes);
  }
}

LayerMap whole_map(const MapStore& store) {
  LayerMap map;
  map.cell_um = RobotProfile::kCellUm;
  for (const TileKey& key : store.tiles()) map.bounds = map.bounds.united(key.cells());
  const GridFrame frame(1, map.bounds);
  for (const Layer layer : {Layer::kVisits, Layer::kObstacles}) {
    map.layer(layer).resize(frame.size());
  }
  std::array<std::uint8_t, kTileCells> cells;
  for (const TileKey& key : store.tiles()) {
    store.read_merged(key, cells);
    for (std::size_t i = 0; i < kTileCells; ++i) {
      map.layer(key.layer)[frame.index_of(cell_of_tile_index(key, i))] = cells[i];
    }
  }
  return map;
}

}  // namespace

bool is_recorded_drive(const std::filesystem::path& file) {
  return file.extension() == ".rawlog" || is_recording(file);
}

RunData load_drive(const std::filesystem::path& file, const LoadProgress& progress) {
  const Recording recording = is_recording(file) ? read_recording(file) : load_rawlog(file);
  RunData run;
  run.name = file.filename().string();
  run.recorded = true;
  run.time_s = seconds(recording.duration_us());
  run.cell_m = RobotProfile::kCellUm / 1e6;
  if (!recording.warning.empty()) run.warnings.push_back(recording.warning);
  RobotRun& robot = run.robots.emplace_back();
  robot.robot = kRobot;
  robot.name = "the robot";
  add_way(recording, robot);
  run.driven_m = robot.driven_m;

  const auto explorer = std::make_unique<ExplorerFor<RobotProfile>>(
      ExplorerConfig::lidar(kVisitRangeUm, RobotProfile::kCellUm));
  MapStore store;
  NoPolicy no_policy;
  const double cell_m2 = run.cell_m * run.cell_m;
  const ReplayResult result = replay(recording, *explorer, no_policy, {}, [&](std::size_t done) {
    take_changes(explorer->map(), store, static_cast<std::uint32_t>(done));
    run.explored_m2.emplace_back(seconds(recording.scans[done - 1].time_us),
                                 static_cast<double>(store.explored_cells()) * cell_m2);
    if (progress) progress(100 * done / recording.scans.size());
    return true;
  });
  robot.actions = result.goals.size();
  for (const ReplayGoal& goal : result.goals) {
    robot.goals.push_back(explorer->map().frame().center_of(goal.decision.goal));
  }
  run.map = whole_map(store);
  score_map(run, {});
  return run;
}

std::vector<TimelineEntry> drive_timeline(const RunData& run) {
  std::vector<TimelineEntry> entries;
  for (const Span& span : run.robots.front().spans) {
    const char* text = span.activity == Activity::kStanding  ? "stands"
                       : span.activity == Activity::kTurning ? "turns on the spot"
                       : span.activity == Activity::kUnheard ? "no scan is recorded"
                                                             : nullptr;
    if (text == nullptr || span.length_s() < kWorthTellingS) continue;
    entries.push_back(
        {span.begin_s, {}, std::string(text) + " for " + duration_text(span.length_s())});
  }
  return entries;
}

}  // namespace ivfm::host
