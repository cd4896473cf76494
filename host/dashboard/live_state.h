// What the live page shows, numbered so that a page asks only for what changed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "host/map_server/map_reader.h"
#include "host/map_server/map_server.h"

namespace ivfm::host {

// The merged map around a robot.
struct Neighbourhood {
  Pose pose;
  LayerMap map;
};

// Which share of what a robot sends arrives, told anew every so many datagrams.
class LinkHealth {
 public:
  static constexpr std::uint64_t kDatagrams = 40;
  // The robot's count of datagrams since its start, and the server's of those that came.
  void take(std::uint64_t sent, std::uint64_t arrived);
  // 0 .. 1, of the last stretch that is complete.
  double lost() const { return lost_; }

 private:
  bool begun_ = false;
  std::uint64_t sent_ = 0, arrived_ = 0;
  double lost_ = 0;
};

// Written by the server's thread, read by any. Every change gets the next revision.
class LiveState {
 public:
  // `run`: another one at every start of the server, so that a page notices.
  explicit LiveState(std::string run) : run_(std::move(run)) {}
  LiveState(const LiveState&) = delete;
  LiveState& operator=(const LiveState&) = delete;

  // What there is to explore in all; 0: nobody knows. Before the first update().
  void set_explorable(double square_metres) { explorable_m2_ = square_metres; }
  // Paths and progress of a run that goes on. Throws std::runtime_error like map_reader.h.
  void restore(const std::filesystem::path& database);
  // Takes over what changed in the server since the last call.
  void update(MapServer& server, TimeUs now_us);

  // What changed after `since` for a page that knows `run` (all when it is another run): u32
  // little-endian size of a JSON text, the text, then the tiles (docs/page.md).
  std::string changes(const std::string& run, std::uint64_t since) const;

  // `reach_cells` in every direction; nothing while the robot's place is not known.
  std::optional<Neighbourhood> neighbourhood(std::uint16_t robot, std::int32_t reach_cells) const;

 private:
  using Revision = std::uint64_t;
  struct Tile {
    Revision revision = 0;
    std::string bytes;  // as sent
  };
  struct TrailPoint {
    Revision revision;
    Point place;
  };
  struct Robot {
    Revision revision = 0;
    RobotView view;
    std::vector<TrailPoint> trail;
    LinkHealth link;
    std::uint64_t sampled_bytes = 0;
    double bytes_per_s = 0;
  };
  struct Sample {
    Revision revision;
    double time_s;
    std::uint64_t explored_cells;
    double bytes_per_s;
  };
  struct Range {
    Revision after;
    Revision until;
    bool has(Revision revision) const { return revision > after && revision <= until; }
  };

  void update_tiles(MapServer& server);
  void update_robot(const RobotView& view);
  void add_trail_point(Robot& robot, Point place);
  void sample(TimeUs now_us, std::uint64_t explored_cells);
  void add_sample(double time_s, std::uint64_t explored_cells, double bytes_per_s);
  Range next_range(Revision since) const;
  std::string describe(const Range& range) const;

  const std::string run_;
  mutable std::mutex mutex_;
  Revision revision_ = 0;
  TimeUs now_us_ = 0;
  std::optional<TimeUs> sampled_us_;
  std::int32_t cell_um_ = 0;
  double explorable_m2_ = 0;
  std::uint64_t explored_cells_ = 0;
  std::uint64_t obstacle_cells_ = 0;
  std::uint64_t dropped_ = 0;
  std::map<std::pair<std::int32_t, std::int32_t>, Tile> tiles_;
  std::map<std::uint16_t, Robot> robots_;
  std::vector<Sample> samples_;
};

}  // namespace ivfm::host
