#include "host/dashboard/live_state.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "firmware/supervisor/supervisor_table.h"
#include "host/map_server/sqlite.h"

namespace ivfm::host {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxTilesAtOnce = 1024;
constexpr std::size_t kMaxTrailPoints = 4000;
constexpr std::size_t kMaxSamples = 2000;
constexpr std::int32_t kTrailStepUm = 50000;
constexpr TimeUs kSamplePeriodUs = 1000000;

void append_u32(std::string& out, std::uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) out += static_cast<char>(value >> shift & 0xff);
}

// Place, visits, and obstacles as bits (the lowest bit is the first cell).
std::string tile_bytes(const MapStore& map, std::int32_t x, std::int32_t y) {
  std::array<std::uint8_t, kTileCells> cells;
  std::string out;
  append_u32(out, static_cast<std::uint32_t>(x));
  append_u32(out, static_cast<std::uint32_t>(y));
  map.read_merged({Layer::kVisits, x, y}, cells);
  out.append(cells.begin(), cells.end());
  map.read_merged({Layer::kObstacles, x, y}, cells);
  for (std::size_t i = 0; i < kTileCells; i += 8) {
    unsigned bits = 0;
    for (std::size_t k = 0; k < 8; ++k) bits |= (cells[i + k] != 0 ? 1u : 0u) << k;
    out += static_cast<char>(bits);
  }
  return out;
}

bool far_enough(Point a, Point b) {
  return std::abs(a.x_um - b.x_um) >= kTrailStepUm || std::abs(a.y_um - b.y_um) >= kTrailStepUm;
}

// Forgets every second element: pages that have them keep them.
template <typename T>
void thin(std::vector<T>& list) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < list.size(); i += 2) list[kept++] = list[i];
  list.resize(kept, list.front());
}

double metres(std::int32_t um) { return std::round(um / 1e3) / 1e3; }

json describe_status(const RobotStatus& status) {
  const bool known = status.state < kRobotStates;
  return {{"state", known ? supervisor_table::kStates[status.state].name : "unknown"},
          {"fault", status.fault},
          {"actions", status.actions},
          {"distance_m", status.distance_mm / 1e3},
          {"decision_ms", status.decision_us / 1e3},
          {"retransmissions", status.retransmissions}};
}

json describe_robot(const RobotView& view, std::int32_t cell_um, double bytes_per_s, double lost) {
  json out{{"id", view.robot},
           {"name", view.name},
           {"seen_s", static_cast<double>(view.last_seen_us) / 1e6},
           {"bytes", view.traffic.bytes_in + view.traffic.bytes_out},
           {"bytes_per_s", bytes_per_s},
           {"lost", lost},
           {"apart", view.apart}};
  if (view.status) out.update(describe_status(*view.status));
  if (view.pose) {
    out["x"] = metres(view.pose->position.x_um);
    out["y"] = metres(view.pose->position.y_um);
    out["heading"] = view.pose->heading.radians();
  }
  if (view.goal && cell_um > 0) {
    const Point goal = GridFrame(cell_um, {}).center_of(*view.goal);
    out["goal"] = {metres(goal.x_um), metres(goal.y_um)};
  }
  return out;
}

bool same(const RobotView& a, const RobotView& b) {
  return a.name == b.name && a.last_seen_us == b.last_seen_us && a.traffic == b.traffic &&
         a.apart == b.apart && a.pose == b.pose && a.goal == b.goal && a.status == b.status;
}

// The newest rows in their order: so many that a server starts again within a second or two.
std::string newest_of(const std::string& table, const std::string& columns) {
  return "SELECT " + columns + " FROM " + table + " WHERE rowid > (SELECT max(rowid) FROM " +
         table + ") - 500000 ORDER BY rowid";
}

}  // namespace

void LinkHealth::take(std::uint64_t sent, std::uint64_t arrived) {
  if (!begun_ || sent < sent_) {
    lost_ = 0;  // the robot has started again
  } else if (sent - sent_ < kDatagrams) {
    return;
  } else {
    const double share =
        static_cast<double>(arrived - arrived_) / static_cast<double>(sent - sent_);
    lost_ = std::round(100 * std::clamp(1 - share, 0.0, 1.0)) / 100;
  }
  begun_ = true;
  sent_ = sent;
  arrived_ = arrived;
}

void LiveState::restore(const std::filesystem::path& database) {
  const std::lock_guard lock(mutex_);
  SqliteConnection connection(database, SqliteConnection::Mode::kRead);
  SqliteStatement poses(connection, newest_of("poses", "robot, x_um, y_um").c_str());
  while (poses.row()) {
    add_trail_point(
        robots_[static_cast<std::uint16_t>(poses.integer(0))],
        {static_cast<std::int32_t>(poses.integer(1)), static_cast<std::int32_t>(poses.integer(2))});
  }
  SqliteStatement progress(connection, newest_of("progress", "time_us, explored_cells").c_str());
  while (progress.row()) {
    add_sample(static_cast<double>(progress.integer(0)) / 1e6,
               static_cast<std::uint64_t>(progress.integer(1)), 0);
  }
}

void LiveState::update(MapServer& server, TimeUs now_us) {
  const std::lock_guard lock(mutex_);
  now_us_ = now_us;
  cell_um_ = server.cell_um().value_or(0);
  explored_cells_ = server.map().explored_cells();
  obstacle_cells_ = server.map().obstacle_cells();
  dropped_ = server.counters().dropped();
  update_tiles(server);
  for (const RobotView& view : server.robots()) update_robot(view);
  if (!sampled_us_ || now_us - *sampled_us_ >= kSamplePeriodUs) sample(now_us, explored_cells_);
}

void LiveState::update_tiles(MapServer& server) {
  std::set<std::pair<std::int32_t, std::int32_t>> changed;
  for (const TileKey& key : server.take_changed_tiles()) changed.insert({key.x, key.y});
  for (const auto& [x, y] : changed) {
    Tile& tile = tiles_[{x, y}];
    tile.bytes = tile_bytes(server.map(), x, y);
    tile.revision = ++revision_;
  }
}

void LiveState::update_robot(const RobotView& view) {
  Robot& robot = robots_[view.robot];
  if (robot.revision != 0 && same(robot.view, view)) return;
  if (view.pose) add_trail_point(robot, view.pose->position);
  robot.view = view;
  if (view.status) robot.link.take(view.status->datagrams_sent, view.traffic.datagrams_in);
  robot.revision = ++revision_;
}

void LiveState::add_trail_point(Robot& robot, Point place) {
  if (!robot.trail.empty() && !far_enough(robot.trail.back().place, place)) return;
  if (robot.trail.size() >= kMaxTrailPoints) thin(robot.trail);
  robot.trail.push_back({++revision_, place});
}

// Rates, once a second of the run.
void LiveState::sample(TimeUs now_us, std::uint64_t explored_cells) {
  double total = 0;
  for (auto& [id, robot] : robots_) {
    const std::uint64_t bytes = robot.view.traffic.bytes_in + robot.view.traffic.bytes_out;
    const double before = robot.bytes_per_s;
    if (sampled_us_) {
      robot.bytes_per_s = static_cast<double>(bytes - robot.sampled_bytes) * 1e6 /
                          static_cast<double>(now_us - *sampled_us_);
    }
    robot.sampled_bytes = bytes;
    total += robot.bytes_per_s;
    if (robot.bytes_per_s != before) robot.revision = ++revision_;
  }
  sampled_us_ = now_us;
  if (!robots_.empty()) add_sample(static_cast<double>(now_us) / 1e6, explored_cells, total);
}

void LiveState::add_sample(double time_s, std::uint64_t explored_cells, double bytes_per_s) {
  if (samples_.size() >= kMaxSamples) thin(samples_);
  samples_.push_back({++revision_, time_s, explored_cells, bytes_per_s});
}

// As far as the tiles of one answer go.
LiveState::Range LiveState::next_range(Revision since) const {
  std::vector<Revision> newer;
  for (const auto& entry : tiles_) {
    if (entry.second.revision > since) newer.push_back(entry.second.revision);
  }
  if (newer.size() <= kMaxTilesAtOnce) return {since, revision_};
  const auto last = newer.begin() + kMaxTilesAtOnce - 1;
  std::nth_element(newer.begin(), last, newer.end());
  return {since, *last};
}

std::string LiveState::describe(const Range& range) const {
  json out{{"run", run_},
           {"after", range.after},
           {"revision", range.until},
           {"more", range.until != revision_},
           {"time_s", static_cast<double>(now_us_) / 1e6},
           {"cell_m", cell_um_ / 1e6},
           {"explorable_m2", explorable_m2_},
           {"explored_cells", explored_cells_},
           {"obstacle_cells", obstacle_cells_},
           {"dropped", dropped_},
           {"robots", json::array()},
           {"trails", json::array()},
           {"samples", json::array()}};
  for (const auto& [id, robot] : robots_) {
    if (range.has(robot.revision)) {
      out["robots"].push_back(
          describe_robot(robot.view, cell_um_, robot.bytes_per_s, robot.link.lost()));
    }
    json points = json::array();
    for (const TrailPoint& point : robot.trail) {
      if (!range.has(point.revision)) continue;
      points.push_back({metres(point.place.x_um), metres(point.place.y_um)});
    }
    if (!points.empty()) out["trails"].push_back({{"id", id}, {"points", std::move(points)}});
  }
  for (const Sample& sample : samples_) {
    if (!range.has(sample.revision)) continue;
    out["samples"].push_back({sample.time_s, sample.explored_cells, sample.bytes_per_s});
  }
  return out.dump(-1, ' ', true, json::error_handler_t::replace);
}

std::string LiveState::changes(const std::string& run, std::uint64_t since) const {
  const std::lock_guard lock(mutex_);
  const Range range = next_range(run == run_ && since <= revision_ ? since : 0);
  const std::string text = describe(range);
  std::string out;
  append_u32(out, static_cast<std::uint32_t>(text.size()));
  out += text;
  for (const auto& entry : tiles_) {
    if (range.has(entry.second.revision)) out += entry.second.bytes;
  }
  return out;
}

std::optional<Neighbourhood> LiveState::neighbourhood(std::uint16_t robot,
                                                      std::int32_t reach_cells) const {
  const std::lock_guard lock(mutex_);
  const auto found = robots_.find(robot);
  if (found == robots_.end() || !found->second.view.pose || cell_um_ <= 0) return std::nullopt;
  const Pose pose = *found->second.view.pose;
  const Cell middle = GridFrame(cell_um_, {}).cell_at(pose.position);
  const CellRect bounds{middle.x - reach_cells, middle.y - reach_cells, 2 * reach_cells,
                        2 * reach_cells};
  const GridFrame frame(cell_um_, bounds);
  Neighbourhood out{pose, {cell_um_, bounds, {}, {}}};
  out.map.visits.resize(frame.size());
  out.map.obstacles.resize(frame.size());
  for_each_tile(Layer::kVisits, bounds, [&](const TileKey& key, const CellRect& part) {
    const auto tile = tiles_.find({key.x, key.y});
    if (tile == tiles_.end()) return;
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(tile->second.bytes.data()) + 8;
    for (std::int32_t y = part.y; y < part.top(); ++y) {
      for (std::int32_t x = part.x; x < part.right(); ++x) {
        const std::size_t i = tile_index({x, y}), at = frame.index_of({x, y});
        out.map.visits[at] = bytes[i];
        out.map.obstacles[at] = static_cast<std::uint8_t>(bytes[kTileCells + i / 8] >> (i % 8) & 1);
      }
    }
  });
  return out;
}

}  // namespace ivfm::host
