// A run as its database tells it: what each robot did when, what it cost, and what came of it.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "host/demo/run_scores.h"
#include "host/log_analysis/map_picture.h"
#include "host/log_analysis/pose_errors.h"
#include "host/map_server/map_reader.h"
#include "host/map_server/run_database.h"

namespace ivfm::host {

// What a robot did with its time, told from two status messages in a row.
enum class Activity : std::uint8_t {
  kDriving,
  kTurning,         // on the spot
  kStanding,        // allowed to drive, but does not, for no reason that it told
  kHeldByObstacle,  // an obstacle lies inside the stopping distance
  kHeldByRobot,     // stands with another robot less than kNearM away
  kFault,
  kWaiting,  // boot, ready
  kStopped,  // by a command
  kDone,     // explored, found
  kUnheard,  // no word from it
};
inline constexpr std::size_t kActivities = 10;
const char* to_string(Activity activity);
// Robots whose middles are nearer than this are in each other's way.
inline constexpr double kNearM = 0.8;
// A robot as near as this can close a passage to another.
inline constexpr double kInWayM = 1.5;

// A stretch of one activity.
struct Span {
  double begin_s = 0, end_s = 0;
  Activity activity = Activity::kDriving;
  std::uint8_t causes = 0;  // StopReason bits that were told
  // The near robot of kHeldByRobot; of kDone: the robot nearest when it gave up, if within kInWayM.
  std::optional<std::uint16_t> blocker;
  double length_s() const { return end_s - begin_s; }
};

using Curve = std::vector<std::pair<double, double>>;  // (time in s, value)

struct RobotRun {
  std::uint16_t robot = 0;
  std::string name;
  double driven_m = 0;  // by odometry, over all its starts
  std::uint64_t actions = 0;
  std::uint64_t starts = 0;
  std::uint64_t retransmissions = 0;  // rectangles sent again
  std::uint64_t datagrams_sent = 0;   // by its own count
  double lost = 0;                    // share of these that did not arrive
  std::string last_state;
  TrafficCounters traffic;  // as the server counted it

  std::vector<Span> spans;          // without gaps, in order
  std::vector<float> decisions_ms;  // in order
  Curve decisions;                  // a selection of them over time
  Curve driven;                     // metres over time
  Curve kib_per_s;                  // on the radio, both ways
  std::vector<Point> path, goals;   // in the map frame; a selection of a long one
  double time_in(Activity activity) const;
};

// What of a damaged file could not be read, a sentence each.
using Warnings = std::vector<std::string>;
// Does `work`. When the file turns out to be damaged that becomes a warning about `what` ("a part
// of its map"), and what was read until then stays. Throws what `work` throws for other reasons.
void salvage(Warnings& warnings, const std::string& what, const std::function<void()>& work);

struct TimelineEntry {
  double time_s = 0;
  std::optional<std::uint16_t> robot;
  std::string text;
};

struct RunData {
  std::string name;  // of the file
  double time_s = 0;
  double cell_m = 0;
  std::uint64_t explored_cells = 0, obstacle_cells = 0;
  double driven_m = 0;  // of all robots
  RunScores scores;     // but the coverage: that needs the world
  std::vector<RobotRun> robots;
  Curve explored_m2;
  // Square metres by visits: entry i holds those with up to 2^i, more than 2^(i - 1) of them.
  std::array<double, 9> visits_m2{};
  // What the run's own judge said, who knew the world: `ivfm demo` (docs/run_database.md).
  std::map<std::string, double> outcome;
  std::map<std::uint16_t, PoseErrors> pose_errors;  // by robot; empty where nobody knew the truth
  LayerMap map;                                     // merged
  bool recorded = false;  // a drive without radio, mission and decisions (drive_data.h)
  Warnings warnings;

  std::uint64_t actions() const;
  std::uint64_t wire_bytes() const;
  // The paper's formula (method.md, "Bandwidth"), with rectangles as they were sent.
  double paper_bytes() const;
  // `outcome[key]`, or `otherwise` when the run had no judge.
  double judged(const std::string& key, double otherwise) const;
};

// `progress` is called with the share (0 .. 100) that is done.
using LoadProgress = std::function<void(std::uint64_t)>;
// What can be read of a damaged file is there, with a warning. Throws std::runtime_error with one
// sentence when `database` is no run database or nothing of it can be read.
RunData load_run(const std::filesystem::path& database, const LoadProgress& progress = {});

// Fills in what follows from the map: cells, visits, and `scores` with `driven_m`. `seers`: how
// many robots saw each cell of it, at most 2; may be empty.
void score_map(RunData& run, std::span<const std::uint8_t> seers);

// Starts, finds, refusals, and changes of the robots' states and faults, in the order of time. Adds
// to `warnings` what cannot be read; throws as above.
std::vector<TimelineEntry> load_timeline(const std::filesystem::path& database, Warnings& warnings,
                                         const LoadProgress& progress = {});

// The paths and goals for a picture, in the order of the robots.
std::vector<Trajectory> trajectories_of(const RunData& run);
// The causes in a status message's `fault`, for people; empty when there is none.
std::string fault_text(std::uint8_t fault);
// At most `most` points of a curve, its last among them.
Curve thinned(const Curve& curve, std::size_t most);
// The value of a curve at `time_s`, straight between its points; 0 before its first.
double value_at(const Curve& curve, double time_s);

}  // namespace ivfm::host
