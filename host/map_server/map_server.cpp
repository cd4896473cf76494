#include "host/map_server/map_server.h"

#include <algorithm>
#include <cstdlib>
#include <iomanip>
#include <limits>
#include <sstream>

namespace ivfm::host {
namespace {

// A robot that was not heard for this long is not sent anything.
constexpr TimeUs kAwayAfterUs = 60000000;
constexpr TimeUs kCommandRetryUs = 500000;
constexpr TimeUs kForgetPeriodUs = 10000000;
// A robot's lidar sees others no farther away, and is told of them no more often; a place that was
// told longer ago says too little.
constexpr std::int64_t kSightUm = 14000000;
constexpr TimeUs kPlacesPeriodUs = 400000;
constexpr TimeUs kPlaceAgeUs = 2000000;

std::int64_t to_sql(TimeUs time_us) { return static_cast<std::int64_t>(time_us); }

constexpr CellRect kAllCells = {kMinCellNumber, kMinCellNumber, kMaxCellNumber - kMinCellNumber,
                                kMaxCellNumber - kMinCellNumber};

// As few acknowledgements as cover `sequences` (sorted, newest first): the next one, and what of
// `sequences` is left.
Acknowledgement next_acknowledgement(std::vector<std::uint32_t>& sequences) {
  Acknowledgement message{sequences.front(), 0};
  std::erase_if(sequences, [&](std::uint32_t sequence) {
    const std::uint32_t age = message.newest - sequence;
    if (age >= 1 && age <= 64) message.earlier |= 1ull << (age - 1);
    return age <= 64;
  });
  return message;
}

}  // namespace

MapServer::MapServer(RunDatabase& database, DatagramSender& sender, std::uint32_t epoch,
                     const MapServerConfig& config)
    : MapServer(sender, epoch, config) {
  database_ = &database;
  load(database);
}

MapServer::MapServer(DatagramSender& sender, std::uint32_t epoch, const MapServerConfig& config)
    : sender_(sender), epoch_(epoch), config_(config) {
  if (config_.boot == 0) config_.boot = epoch;
}

void MapServer::load(RunDatabase& database) {
  cell_um_ = database.cell_um();
  finder_ = database.finder();
  database.load_tiles(map_);
  database.load_apart(apart_);
  first_seen_ = database.load_first_seen();
  for (RobotRecord& record : database.load_robots()) {
    Robot& robot = robots_[record.robot];
    robot.downlink = Downlink(config_.downlink);
    robot.seal = config_.seals->of(record.robot);
    robot.logged_traffic = record.traffic;
    robot.record = std::move(record);
    if (finder_ && *finder_ != robot.record.robot) set_command(robot, CommandCode::kFound);
  }
  logged_explored_ = map_.explored_cells();
  logged_obstacles_ = map_.obstacle_cells();
  changed_tiles_ = map_.tiles();
}

// --- Receiving ---------------------------------------------------------------------------------

void MapServer::receive(const PeerAddress& from, std::span<std::uint8_t> datagram, TimeUs now_us) {
  ++counters_.traffic.datagrams_in;
  counters_.traffic.bytes_in += datagram.size() + kUdpIpOverheadBytes;
  const auto id = peek_robot(datagram);
  if (!id.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  const DatagramSeal* seal = config_.seals->of(*id);
  if (seal == nullptr) {
    ++counters_.dropped_unknown;
    return;
  }
  const auto opened = open_datagram(datagram, *seal, {false, config_.boot});
  if (!opened.ok()) {
    const bool refused = opened.status() == Status::kRefused;
    ++(refused ? counters_.dropped_refused : counters_.dropped_malformed);
    return;
  }
  Robot* const robot = find_or_add(*id, now_us);
  if (robot == nullptr) return;
  if (!opened->bound) {
    answer_hello(*robot, from, *opened);
    return;
  }
  if (!is_present_start(*robot, opened->header, now_us)) return;
  robot->address = from;
  robot->last_heard_us = now_us;
  robot->record.last_seen_us = to_sql(now_us);
  robot->heard = true;
  unsaved_robots_.insert(*id);
  count_in(*robot, datagram.size());
  take(*robot, *opened, now_us);
}

// Null when there are too many.
MapServer::Robot* MapServer::find_or_add(std::uint16_t id, TimeUs now_us) {
  const auto it = robots_.find(id);
  if (it != robots_.end()) return &it->second;
  if (robots_.size() >= config_.max_robots) {
    ++counters_.dropped_full;
    return nullptr;
  }
  Robot& robot = robots_[id];
  robot.record.robot = id;
  robot.record.first_seen_us = to_sql(now_us);
  robot.seal = config_.seals->of(id);
  robot.downlink = Downlink(config_.downlink);
  if (finder_) set_command(robot, CommandCode::kFound);
  return &robot;
}

void MapServer::count_in(Robot& robot, std::size_t size) {
  ++robot.record.traffic.datagrams_in;
  robot.record.traffic.bytes_in += size + kUdpIpOverheadBytes;
}

// A hello from a robot that does not know this server's boot may be old: it is answered, and
// changes nothing. Whoever can open the answer is that robot, now.
void MapServer::answer_hello(Robot& robot, const PeerAddress& from, const OpenedDatagram& opened) {
  const DatagramHeader& header = opened.header;
  const auto hello = decode_hello(opened.body);
  if (header.kind != MessageKind::kHello || !hello.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  if (header.boot == robot.boot && !robot.window.take(header.sequence)) {
    ++counters_.dropped_replayed;
    return;
  }
  count_in(robot, kDatagramHeaderBytes + opened.body.size() + robot.seal->trailer_bytes());
  const std::uint32_t known = robot.record.epoch;
  const bool is_other_start = robot.boot != 0 && robot.boot != header.boot;
  Welcome welcome;
  welcome.knows_epoch = hello->resuming && header.epoch == known && !is_other_start;
  welcome.epoch = welcome.knows_epoch ? known : std::max(header.epoch, known + 1);
  // Those that a robot told in an earlier start, in another frame, it cannot take back.
  welcome.has_cells = !hello->apart && map_.robot_tiles(robot.record.robot) != nullptr;
  send_to(robot, from, header.boot, MessageKind::kWelcome, *encode(welcome, body_of(out_)));
}

// Whether a datagram comes from the start of the robot that is the present one, for the first time.
bool MapServer::is_present_start(Robot& robot, const DatagramHeader& header, TimeUs now_us) {
  const bool is_known = robot.boot == 0 || robot.boot == header.boot;
  if (header.epoch < robot.record.epoch || (header.epoch == robot.record.epoch && !is_known)) {
    ++counters_.dropped_stale;
    return false;
  }
  robot.begins_epoch = header.epoch > robot.record.epoch;
  if (robot.begins_epoch) start_epoch(robot, header, now_us);
  robot.boot = header.boot;
  if (robot.window.take(header.sequence)) return true;
  ++counters_.dropped_replayed;
  return false;
}

// A robot that has started (again) knows nothing of the others and obeys no earlier command.
void MapServer::start_epoch(Robot& robot, const DatagramHeader& header, TimeUs now_us) {
  robot.record.epoch = header.epoch;
  robot.window = {};
  robot.hello = 0;
  robot.downlink = Downlink(config_.downlink);
  robot.to_acknowledge.clear();
  robot.frame.reset();
  robot.command_pending = robot.command.has_value() && robot.command->code == CommandCode::kFound;
  log([time = to_sql(now_us), id = robot.record.robot,
       epoch = header.epoch](RunDatabase& database) {
    database.add_event(time, id, "started", "epoch " + std::to_string(epoch));
  });
}

void MapServer::take(Robot& robot, const OpenedDatagram& opened, TimeUs now_us) {
  const std::uint32_t sequence = opened.header.sequence;
  switch (opened.header.kind) {
    case MessageKind::kMapUpdate: handle_map_update(robot, sequence, opened.body, now_us); break;
    case MessageKind::kAcknowledgement: handle_acknowledgement(robot, opened.body, now_us); break;
    case MessageKind::kHello: handle_hello(robot, sequence, opened.body, now_us); break;
    case MessageKind::kStatus: handle_status(robot, opened.body, now_us); break;
    case MessageKind::kFound: handle_found(robot, sequence, opened.body, now_us); break;
    case MessageKind::kRestoreRequest: handle_restore_request(robot, opened.body, now_us); break;
    default: break;  // open_datagram() lets only a robot's kinds through
  }
}

void MapServer::handle_map_update(Robot& robot, std::uint32_t sequence,
                                  std::span<const std::uint8_t> body, TimeUs now_us) {
  MapUpdateReader reader(body);
  const auto pose = unpack_pose(reader.pose());
  if (!ok(check_map_update(body, cells_)) || !pose.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  if (!accept_cell_size(reader.cell_um()) || !has_room_for(robot, body)) return;
  take_pose(robot, reader.pose(), now_us);
  merge_regions(robot, sequence, reader, now_us);
  robot.to_acknowledge.push_back(sequence);
}

// The first robot's cell size is the run's.
bool MapServer::accept_cell_size(std::int32_t cell_um) {
  if (!cell_um_) {
    cell_um_ = cell_um;
    log([cell_um](RunDatabase& database) { database.save_cell_um(cell_um); });
  }
  if (*cell_um_ == cell_um) return true;
  ++counters_.dropped_cell_size;
  return false;
}

std::size_t MapServer::tile_count() const {
  std::size_t count = map_.tile_count();
  for (const auto& [robot, map] : apart_) count += map.tile_count();
  return count;
}

bool MapServer::has_room_for(const Robot& robot, std::span<const std::uint8_t> body) {
  std::size_t missing = 0;
  MapUpdateReader reader(body);
  while (true) {
    const auto region = reader.next(cells_);
    if (!region.ok()) break;
    missing += map_of(robot).missing_tiles(robot.record.robot, region->layer, region->rect);
  }
  if (tile_count() + missing <= config_.max_tiles) return true;
  ++counters_.dropped_full;
  return false;
}

void MapServer::merge_regions(Robot& robot, std::uint32_t sequence, MapUpdateReader& reader,
                              TimeUs now_us) {
  std::vector<TileChange> changes;
  while (true) {
    const auto region = reader.next(cells_);
    if (!region.ok()) break;
    map_of(robot).merge(robot.record.robot, robot.record.epoch, sequence, region->layer,
                        region->rect, region->cells, changes);
    LayerTraffic& traffic = robot.record.traffic.layers[static_cast<std::size_t>(region->layer)];
    traffic.bytes += region->wire_bytes;
    traffic.cells += region->cells.size();
  }
  note_changes(robot, changes, now_us);
}

void MapServer::note_changes(const Robot& robot, const std::vector<TileChange>& changes,
                             TimeUs now_us) {
  for (const TileChange& change : changes) {
    unsaved_tiles_.insert({robot.record.robot, change.key});
    if (change.changed.empty() || is_apart(robot)) continue;
    CellRect& changed = uncommitted_changes_[robot.record.robot][change.key];
    changed = changed.united(change.changed);
    changed_tiles_.insert(change.key);
    if (database_ != nullptr) note_first_seen(change, now_us);
  }
}

void MapServer::note_first_seen(const TileChange& change, TimeUs now_us) {
  FirstSeen& seen = first_seen_[change.key];
  const CellRect& rect = change.changed;
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    for (std::int32_t x = rect.x; x < rect.right(); ++x) {
      std::uint32_t& time = seen[tile_index({x, y})];
      if (time != 0 || map_.merged_value(change.key.layer, {x, y}) == 0) continue;
      time = static_cast<std::uint32_t>(now_us / 100'000) + 1;
      unsaved_first_seen_.insert(change.key);
    }
  }
}

void MapServer::handle_acknowledgement(Robot& robot, std::span<const std::uint8_t> body,
                                       TimeUs now_us) {
  const auto message = decode_acknowledgement(body);
  if (!message.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  robot.downlink.acknowledge(*message, now_us);
  if (robot.command_sequence != 0 && message->covers(robot.command_sequence)) {
    robot.command_pending = false;
  }
}

void MapServer::handle_hello(Robot& robot, std::uint32_t sequence,
                             std::span<const std::uint8_t> body, TimeUs now_us) {
  const auto hello = decode_hello(body);
  if (!hello.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  if (!accept_cell_size(hello->cell_um)) {
    log([time = to_sql(now_us), id = robot.record.robot,
         cell_um = hello->cell_um](RunDatabase& database) {
      database.add_event(time, id, "refused", "cells of " + std::to_string(cell_um) + " um");
    });
    return;
  }
  take_frame(robot, *hello, now_us);
  robot.to_acknowledge.push_back(sequence);
  if (sequence < robot.hello) return;
  robot.record.name = std::string(hello->name());
  set_rough(robot, hello->rough);
  if (!is_apart(robot)) set_window(robot, hello->window.empty() ? kAllCells : hello->window);
  robot.hello = sequence;
}

MapStore& MapServer::map_of(const Robot& robot) {
  const auto apart = apart_.find(robot.record.robot);
  return apart == apart_.end() ? map_ : apart->second;
}

// What a hello says of the frame in which the robot's cells are. It is the same in a whole epoch.
void MapServer::take_frame(Robot& robot, const Hello& hello, TimeUs now_us) {
  const bool was_apart = is_apart(robot);
  if (hello.apart) {
    if (robot.begins_epoch || !was_apart) keep_apart(robot, now_us);
  } else if (was_apart) {
    if (!unsaved_tiles_.empty()) commit(now_us);
    end_apart(robot);
    if (!hello.moved_frame) return;  // started again where it knows its start
    robot.command_pending = robot.command.has_value();
    log([time = to_sql(now_us), id = robot.record.robot](RunDatabase& database) {
      database.add_event(time, id, "joined", "its map is part of the team's");
    });
  } else if (hello.moved_frame && robot.begins_epoch) {
    forget_frame(robot, now_us);
  }
}

// A robot whose start is rough may have corrected itself by the first one's map: then that one has
// to keep its frame.
void MapServer::set_rough(Robot& robot, bool rough) {
  if (robot.rough == rough) return;
  robot.rough = rough;
  robot.was_rough = true;
  if (rough) return;
  robot.frame.reset();
  for (const TileKey& key : map_.tiles()) robot.downlink.mark(key, key.cells());
  const auto knows_its_start = [this](const auto& entry) {
    return entry.second.heard && !entry.second.was_rough && !is_apart(entry.second);
  };
  if (std::ranges::any_of(robots_, knows_its_start)) return;
  for (auto& [id, other] : robots_) {
    if (other.rough && joined_before(other, robot)) other.frame = MapFrame{other.record.epoch, {}};
  }
}

bool MapServer::joined_before(const Robot& a, const Robot& b) {
  return std::pair(a.record.first_seen_us, a.record.robot) <
         std::pair(b.record.first_seen_us, b.record.robot);
}

// Of two robots with rough starts the one that joined later is to correct itself by the other, and
// not the other way round: the first is told nothing of it.
bool MapServer::is_kept_from(const Robot& robot, const Robot& other) {
  return robot.rough && other.was_rough && joined_before(robot, other);
}

// Whose cells a robot is not told: its own, and what is kept from it.
std::vector<std::uint16_t> MapServer::untold(const Robot& robot) const {
  std::vector<std::uint16_t> robots{robot.record.robot};
  if (!robot.rough) return robots;
  for (const auto& [id, other] : robots_) {
    if (is_kept_from(robot, other)) robots.push_back(id);
  }
  return robots;
}

// Every start of a robot that does not know where it is has a map frame of its own.
void MapServer::keep_apart(Robot& robot, TimeUs now_us) {
  if (!unsaved_tiles_.empty()) commit(now_us);  // those of its earlier frame
  end_apart(robot);
  apart_[robot.record.robot];
  robot.pose.reset();
  robot.goal.reset();
  log([time = to_sql(now_us), id = robot.record.robot](RunDatabase& database) {
    database.add_event(time, id, "apart", "it does not know where it is: its map is kept apart");
  });
}

void MapServer::end_apart(Robot& robot) {
  const std::uint16_t id = robot.record.robot;
  if (apart_.erase(id) == 0) return;
  frame_finder_.forget(id);
  log([id](RunDatabase& database) { database.forget_apart(id); });
}

// All that the robot said was in another frame.
void MapServer::forget_frame(Robot& robot, TimeUs now_us) {
  std::vector<TileChange> changes;
  map_.forget(robot.record.robot, changes);
  note_changes(robot, changes, now_us);
  robot.command_pending = robot.command.has_value();  // it goes on as it was
  rows_.emplace_back([time = to_sql(now_us), id = robot.record.robot](RunDatabase& database) {
    database.add_event(time, id, "moved", "its map frame was wrong: its map is told anew");
  });
}

// What the others saw in the part of the window that is new to the robot is news.
void MapServer::set_window(Robot& robot, const CellRect& window) {
  const CellRect before = robot.downlink.window();
  robot.downlink.set_window(window);
  for (const TileKey& key : map_.tiles_of_others(robot.record.robot, window)) {
    const CellRect part = key.cells().intersection(window);
    if (!before.contains(part)) robot.downlink.mark(key, part);
  }
}

// Answers with what is durable only: the robot builds upon it.
void MapServer::handle_restore_request(Robot& robot, std::span<const std::uint8_t> body,
                                       TimeUs now_us) {
  auto request = decode_restore_request(body);
  if (!request.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  if (request->window.empty()) request.value().window = kAllCells;
  if (!unsaved_tiles_.empty()) commit(now_us);
  const auto update = body_of(out_).subspan(kRestoreHeaderBytes);
  MapUpdateWriter writer(update, cell_um_.value_or(1), {});
  const RestoreHeader header{request->from, write_own_cells(robot, *request, writer)};
  static_cast<void>(encode(header, body_of(out_)));
  send(robot, MessageKind::kRestore, kRestoreHeaderBytes + writer.size());
}

// Writes what fits; returns where to go on.
RestoreCursor MapServer::write_own_cells(const Robot& robot, const RestoreRequest& request,
                                         MapUpdateWriter& writer) {
  constexpr RestoreCursor kDone{.layer = RestoreCursor::kEnd};
  const auto* tiles = map_of(robot).robot_tiles(robot.record.robot);
  if (tiles == nullptr || request.from.layer >= kLayerCount) return kDone;
  const TileKey from{static_cast<Layer>(request.from.layer), request.from.tile_x,
                     request.from.tile_y};
  for (auto it = tiles->lower_bound(from); it != tiles->end(); ++it) {
    const auto& [key, tile] = *it;
    CellRect seen;
    for (std::size_t i = 0; i < kTileCells; ++i) {
      if (tile.cells[i] != 0) seen = seen.united(cell_of_tile_index(key, i));
    }
    const CellRect part = seen.intersection(request.window);
    if (part.empty()) continue;
    const auto cells = std::span(cells_).first(static_cast<std::size_t>(part.area()));
    std::size_t next = 0;
    for (std::int32_t y = part.y; y < part.top(); ++y) {
      for (std::int32_t x = part.x; x < part.right(); ++x)
        cells[next++] = tile.cells[tile_index({x, y})];
    }
    if (!ok(writer.add(key.layer, part, cells))) {
      return {static_cast<std::uint8_t>(key.layer), key.x, key.y};
    }
  }
  return kDone;
}

void MapServer::handle_status(Robot& robot, std::span<const std::uint8_t> body, TimeUs now_us) {
  const auto status = decode_robot_status(body);
  if (!status.ok() || !unpack_pose(status->pose).ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  take_pose(robot, status->pose, now_us);
  robot.status = *status;
  const std::uint16_t id = robot.record.robot;
  const std::int64_t time = to_sql(now_us);
  log([=](RunDatabase& database) { database.add_status(time, id, *status); });
  if (robot.goal == status->goal || is_apart(robot)) return;
  robot.goal = status->goal;
  log([=](RunDatabase& database) { database.add_goal(time, id, status->goal); });
}

void MapServer::handle_found(Robot& robot, std::uint32_t sequence,
                             std::span<const std::uint8_t> body, TimeUs now_us) {
  const auto found = decode_found_report(body);
  if (!found.ok() || !unpack_pose(found->pose).ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  take_pose(robot, found->pose, now_us);
  robot.to_acknowledge.push_back(sequence);
  if (finder_) return;
  finder_ = robot.record.robot;
  log([time = to_sql(now_us), id = robot.record.robot,
       target = found->target](RunDatabase& database) {
    database.add_event(
        time, id, "found",
        "x_um " + std::to_string(target.x_um) + " y_um " + std::to_string(target.y_um));
  });
  for (auto& [id, other] : robots_) {
    if (id != robot.record.robot) set_command(other, CommandCode::kFound);
  }
}

// Logs where the robot is. The caller has checked that `packed` can be unpacked.
void MapServer::take_pose(Robot& robot, const PackedPose& packed, TimeUs now_us) {
  if (is_apart(robot)) return;
  const Pose pose = *unpack_pose(packed);
  robot.pose = pose;
  robot.pose_us = now_us;
  if (cell_um_) robot.cell = GridFrame(*cell_um_, {}).cell_at(pose.position);
  log([time = to_sql(now_us), id = robot.record.robot, pose](RunDatabase& database) {
    database.add_pose(time, id, pose);
  });
}

// --- Sending -----------------------------------------------------------------------------------

void MapServer::step(TimeUs now_us) {
  if (now_us - last_commit_us_ >= config_.commit_period_us) commit(now_us);
  find_frames(now_us);
  for (auto& entry : robots_) {
    Robot& robot = entry.second;
    if (!robot.heard || now_us - robot.last_heard_us > kAwayAfterUs) continue;
    send_command_if_due(robot, now_us);
    send_places(robot, now_us);
    send_frame_if_due(robot, now_us);
    send_downlink(robot, now_us);
  }
}

// Where maps that are kept apart lie in the team's.
void MapServer::find_frames(TimeUs now_us) {
  if (apart_.empty() || !cell_um_) return;
  const auto found = frame_finder_.step(map_, apart_, *cell_um_, now_us);
  if (!found) return;
  Robot& robot = robots_.at(found->robot);
  robot.frame = MapFrame{robot.record.epoch, found->match.frame};
  robot.frame_sent_us = 0;
  log([time = to_sql(now_us), found = *found](RunDatabase& database) {
    const Pose& frame = found.match.frame;
    std::ostringstream text;
    text << std::fixed << std::setprecision(2) << "its map frame lies at x "
         << frame.position.x_um * 1e-6 << " m, y " << frame.position.y_um * 1e-6 << " m, "
         << std::setprecision(1) << frame.heading.degrees() << " degrees; " << found.match.wall_m
         << " m of walls in both maps";
    database.add_event(time, found.robot, "aligned", text.str());
  });
}

// Until the robot begins the epoch in which it is part of the team.
void MapServer::send_frame_if_due(Robot& robot, TimeUs now_us) {
  if (!robot.frame) return;
  if (robot.frame_sent_us != 0 && now_us - robot.frame_sent_us < kCommandRetryUs) return;
  robot.frame_sent_us = now_us;
  send(robot, MessageKind::kMapFrame, *encode(*robot.frame, body_of(out_)));
}

void MapServer::finish(TimeUs now_us) {
  last_log_us_ = 0;
  commit(now_us);
}

// One transaction; only then acknowledgements and news for the others.
void MapServer::commit(TimeUs now_us) {
  last_commit_us_ = now_us;
  log_traffic_and_progress(now_us);
  forget_old_rows(now_us);
  if (unsaved_robots_.empty() && rows_.empty()) return;
  if (database_ != nullptr) save(*database_, now_us);
  for (const std::uint16_t robot : unsaved_robots_) acknowledge_committed(robots_.at(robot));
  tell_others();
  unsaved_tiles_.clear();
  unsaved_first_seen_.clear();
  unsaved_robots_.clear();
  rows_.clear();
}

void MapServer::save(RunDatabase& database, TimeUs now_us) {
  database.begin();
  for (const Row& row : rows_) row(database);  // first: the tiles are those of now
  for (const auto& [robot, key] : unsaved_tiles_) {
    const auto apart = apart_.find(robot);
    const bool is_apart = apart != apart_.end();
    database.save_tile(robot, key, *(is_apart ? apart->second : map_).robot_tile(robot, key),
                       is_apart);
  }
  for (const TileKey& key : unsaved_first_seen_) database.save_first_seen(key, first_seen_.at(key));
  for (const std::uint16_t robot : unsaved_robots_) {
    database.save_robot(robots_.at(robot).record);
  }
  database.save_time(to_sql(now_us));
  database.commit();
}

void MapServer::log_traffic_and_progress(TimeUs now_us) {
  if (last_log_us_ != 0 && now_us - last_log_us_ < config_.log_period_us) return;
  last_log_us_ = now_us;
  const std::int64_t time = to_sql(now_us);
  for (auto& [id, robot] : robots_) {
    if (!robot.heard || robot.logged_traffic == robot.record.traffic) continue;
    robot.logged_traffic = robot.record.traffic;
    log([time, id = id, traffic = robot.record.traffic](RunDatabase& database) {
      database.add_traffic(time, id, traffic);
    });
  }
  const std::uint64_t explored = map_.explored_cells(), obstacles = map_.obstacle_cells();
  if (explored == logged_explored_ && obstacles == logged_obstacles_) return;
  logged_explored_ = explored;
  logged_obstacles_ = obstacles;
  log([=](RunDatabase& database) { database.add_progress(time, explored, obstacles); });
}

void MapServer::forget_old_rows(TimeUs now_us) {
  if (config_.retention_us == 0 || now_us < config_.retention_us) return;
  if (last_forget_us_ != 0 && now_us - last_forget_us_ < kForgetPeriodUs) return;
  last_forget_us_ = now_us;
  log([before = to_sql(now_us - config_.retention_us)](RunDatabase& database) {
    database.forget_before(before);
  });
}

void MapServer::acknowledge_committed(Robot& robot) {
  auto& sequences = robot.to_acknowledge;
  counters_.made_durable += sequences.size();
  std::sort(sequences.begin(), sequences.end(), std::greater<>());
  while (!sequences.empty()) {
    const Acknowledgement message = next_acknowledgement(sequences);
    send(robot, MessageKind::kServerAcknowledgement, *encode(message, body_of(out_)));
  }
}

void MapServer::tell_others() {
  std::vector<std::pair<CellRect, Robot*>> windows;  // in a row: all changes look at all of them
  for (auto& entry : robots_) {
    const CellRect& window = entry.second.downlink.window();
    if (!window.empty()) windows.emplace_back(window, &entry.second);
  }
  for (const auto& [from, changes] : uncommitted_changes_) {
    CellRect bounds;  // most robots are far from most others
    for (const auto& [key, changed] : changes) bounds = bounds.united(changed);
    for (const auto& [window, robot] : windows) {
      if (bounds.intersection(window).empty() || robot->record.robot == from) continue;
      if (is_kept_from(*robot, robots_.at(from))) continue;
      for (const auto& [key, changed] : changes) robot->downlink.mark(key, changed);
    }
  }
  uncommitted_changes_.clear();
}

void MapServer::send_downlink(Robot& robot, TimeUs now_us) {
  robot.downlink.expire(now_us);
  if (!robot.downlink.is_due(now_us)) return;
  while (robot.downlink.is_due(now_us) && send_downlink_datagram(robot, now_us)) {
  }
  robot.downlink.end_batch(now_us);
}

// False when nothing is left to send.
bool MapServer::send_downlink_datagram(Robot& robot, TimeUs now_us) {
  const std::vector<std::uint16_t> without = untold(robot);
  const auto parts = robot.downlink.nearest(robot.cell, kMaxRegionsPerUpdate);
  MapUpdateWriter writer(body_of(out_), cell_um_.value_or(1), {});
  std::vector<Downlink::Part> written;
  for (const Downlink::Part& part : parts) {
    const auto cells = std::span(cells_).first(static_cast<std::size_t>(part.rect.area()));
    map_.read_without(without, part.key, part.rect, cells);
    if (!ok(writer.add(part.key.layer, part.rect, cells))) break;
    written.push_back(part);
  }
  if (written.empty()) return false;
  const std::uint32_t sequence = send(robot, MessageKind::kServerMapUpdate, writer.size());
  robot.downlink.sent(written, sequence, now_us);
  return true;
}

void MapServer::send_command(std::uint16_t robot, CommandCode code) {
  const auto it = robots_.find(robot);
  if (it != robots_.end()) set_command(it->second, code);
}

void MapServer::send_command_to_all(CommandCode code) {
  for (auto& entry : robots_) set_command(entry.second, code);
}

void MapServer::set_command(Robot& robot, CommandCode code) {
  const std::uint32_t revision = robot.command ? robot.command->revision + 1 : 1;
  robot.command = Command{code, revision};
  robot.command_pending = true;
  robot.command_sequence = 0;
}

void MapServer::send_command_if_due(Robot& robot, TimeUs now_us) {
  if (!robot.command_pending) return;
  if (robot.command_sequence != 0 && now_us - robot.command_sent_us < kCommandRetryUs) return;
  robot.command_sent_us = now_us;
  robot.command_sequence =
      send(robot, MessageKind::kCommand, *encode(*robot.command, body_of(out_)));
}

// Where the nearest others are, once one of them has told it anew.
void MapServer::send_places(Robot& robot, TimeUs now_us) {
  if (!robot.pose || now_us - robot.places_us < kPlacesPeriodUs) return;
  std::vector<std::pair<std::int64_t, const Robot*>> near;  // by squared distance
  bool news = false;
  for (const auto& [id, other] : robots_) {
    if (&other == &robot || !other.pose || now_us - other.pose_us > kPlaceAgeUs) continue;
    const std::int64_t dx = other.pose->position.x_um - std::int64_t{robot.pose->position.x_um};
    const std::int64_t dy = other.pose->position.y_um - std::int64_t{robot.pose->position.y_um};
    if (std::max(std::abs(dx), std::abs(dy)) > kSightUm) continue;
    near.emplace_back(dx * dx + dy * dy, &other);
    news = news || other.pose_us > robot.places_us;
  }
  if (!news) return;
  robot.places_us = now_us;
  const std::size_t count = std::min(near.size(), RobotPlaces::kMost);
  std::partial_sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count), near.end());
  RobotPlaces message;
  for (const auto& [square, other] : std::span(near).first(count)) {
    const PackedPose pose = pack_pose(*other->pose);
    const TimeUs age_us = now_us - other->pose_us;
    message.storage[message.size++] = {pose.x, pose.y, static_cast<std::uint8_t>(age_us / 10000)};
  }
  send(robot, MessageKind::kPlaces, *encode(message, body_of(out_)));
}

std::uint32_t MapServer::send(Robot& robot, MessageKind kind, std::size_t body_size) {
  return send_to(robot, robot.address, robot.boot, kind, body_size);
}

std::uint32_t MapServer::send_to(Robot& robot, const PeerAddress& to, std::uint64_t receiver_boot,
                                 MessageKind kind, std::size_t body_size) {
  if (robot.next_sequence == std::numeric_limits<std::uint32_t>::max()) return 0;
  const DatagramHeader header{robot.record.robot, epoch_, robot.next_sequence++, config_.boot,
                              kind};
  const std::size_t size = *seal_datagram(header, body_size, out_, *robot.seal, receiver_boot);
  sender_.send(to, std::span(out_).first(size));
  const std::uint64_t bytes = size + kUdpIpOverheadBytes;
  for (TrafficCounters* traffic : {&counters_.traffic, &robot.record.traffic}) {
    ++traffic->datagrams_out;
    traffic->bytes_out += bytes;
  }
  return header.sequence;
}

std::vector<RobotView> MapServer::robots() const {
  std::vector<RobotView> views;
  for (const auto& [id, robot] : robots_) {
    if (robot.record.epoch == 0) continue;  // has only asked who is there
    views.push_back({id, robot.record.name, robot.record.last_seen_us, robot.record.traffic,
                     is_apart(robot), robot.pose, robot.goal, robot.status});
  }
  return views;
}

bool MapServer::all_delivered() const {
  return uncommitted_changes_.empty() &&
         std::all_of(robots_.begin(), robots_.end(), [](const auto& entry) {
           const Robot& robot = entry.second;
           return !robot.heard || (robot.hello != 0 && robot.downlink.idle());
         });
}

}  // namespace ivfm::host
