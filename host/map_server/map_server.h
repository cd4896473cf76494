// The map server: merges what the robots send, stores it, tells each what the others saw.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "firmware/hal/clock.h"
#include "host/map_server/downlink.h"
#include "host/map_server/frame_finder.h"
#include "host/map_server/map_store.h"
#include "host/map_server/peer_address.h"
#include "host/map_server/run_database.h"
#include "shared/wire/datagram.h"
#include "shared/wire/map_update.h"
#include "shared/wire/messages.h"
#include "shared/wire/replay_window.h"

namespace ivfm::host {

// The robots that are allowed to speak, each with its seal.
class RobotSeals {
 public:
  // Null: no such robot. The seal lives as long as this object.
  virtual const DatagramSeal* of(std::uint16_t robot) const = 0;

 protected:
  ~RobotSeals() = default;
};

// Any robot, without protection.
class PlainSeals final : public RobotSeals {
 public:
  const DatagramSeal* of(std::uint16_t) const override { return &kPlainSeal; }
};
inline constexpr PlainSeals kPlainSeals;

struct MapServerConfig {
  std::uint64_t boot = 0;  // a random number drawn at this start; 0: the epoch is taken
  const RobotSeals* seals = &kPlainSeals;
  TimeUs commit_period_us = 100000;  // what arrived in this time is one transaction
  TimeUs log_period_us = 1000000;    // of the rows of traffic and progress
  DownlinkConfig downlink;
  TimeUs retention_us = 0;  // poses, status and so on older than this go; 0: none
  std::size_t max_robots = 4096;
  std::size_t max_tiles = 262144;  // over all robots; what would need more is refused
};

struct MapServerCounters {
  TrafficCounters traffic;         // of all robots, and of what was dropped
  std::uint64_t made_durable = 0;  // messages acknowledged, each repetition counted
  std::uint64_t dropped_malformed = 0;
  std::uint64_t dropped_unknown = 0;    // of a robot without a key
  std::uint64_t dropped_refused = 0;    // not sealed by the robot, or for an earlier server
  std::uint64_t dropped_replayed = 0;   // taken already
  std::uint64_t dropped_stale = 0;      // from before the robot's last start
  std::uint64_t dropped_cell_size = 0;  // cells of another size than the run's
  std::uint64_t dropped_full = 0;       // more robots or tiles than the limits
  std::uint64_t dropped() const {
    return dropped_malformed + dropped_unknown + dropped_refused + dropped_replayed +
           dropped_stale + dropped_cell_size + dropped_full;
  }
};

// What people want to see of a robot.
struct RobotView {
  std::uint16_t robot = 0;
  std::string name;
  std::int64_t last_seen_us = 0;
  TrafficCounters traffic;
  bool apart = false;  // where its map frame lies is not known: no pose and no goal in the team's
  // Since this server started; nothing before the robot was heard.
  std::optional<Pose> pose;
  std::optional<Cell> goal;  // the robot's own cell when it has none
  std::optional<RobotStatus> status;
};

// How the server answers; lossy like UDP.
class DatagramSender {
 public:
  virtual void send(const PeerAddress& to, std::span<const std::uint8_t> datagram) = 0;

 protected:
  ~DatagramSender() = default;
};

// No I/O of its own but the database. Acknowledges only what is committed there; a robot hears of
// the others' cells only after that. Throws DatabaseError when the database cannot be written.
class MapServer {
 public:
  // `epoch`: from RunDatabase::begin_session(). Goes on with the run that `database` holds.
  MapServer(RunDatabase& database, DatagramSender& sender, std::uint32_t epoch,
            const MapServerConfig& config = {});
  // A server that keeps its map in memory only: it answers the same, and forgets all.
  MapServer(DatagramSender& sender, std::uint32_t epoch, const MapServerConfig& config = {});
  MapServer(const MapServer&) = delete;
  MapServer& operator=(const MapServer&) = delete;

  // Takes one datagram; opens it in place. Times are microseconds since the run began and never go
  // back.
  void receive(const PeerAddress& from, std::span<std::uint8_t> datagram, TimeUs now_us);
  // Commits, acknowledges and sends what is due.
  void step(TimeUs now_us);
  // The last commit before the server ends; acknowledges what it holds.
  void finish(TimeUs now_us);

  // Asks a robot, or all robots that are known, to do something; repeated until acknowledged.
  void send_command(std::uint16_t robot, CommandCode code);
  void send_command_to_all(CommandCode code);

  // The team's.
  const MapStore& map() const { return map_; }
  // Those of robots of which is not known where their map frames lie.
  const ApartMaps& apart_maps() const { return apart_; }
  std::optional<std::int32_t> cell_um() const { return cell_um_; }
  // What robots know this start of the server by.
  std::uint64_t boot() const { return config_.boot; }
  std::size_t robot_count() const { return robots_.size(); }
  const MapServerCounters& counters() const { return counters_; }
  std::vector<RobotView> robots() const;
  // The tiles with changed cells since the last call; at first all.
  std::set<TileKey> take_changed_tiles() { return std::exchange(changed_tiles_, {}); }
  // True when every robot that was heard has acknowledged all that the others saw.
  bool all_delivered() const;

 private:
  struct Robot {
    RobotRecord record;
    PeerAddress address;
    TimeUs last_heard_us = 0;
    bool heard = false;         // since this server started
    std::uint64_t boot = 0;     // of its present start; 0: not heard yet
    ReplayWindow window;        // of its present epoch
    bool rough = false;         // looks for where it started, by what others see
    bool was_rough = false;     // in this run of the server
    bool begins_epoch = false;  // with the datagram at hand
    std::uint32_t hello = 0;    // the newest taken; 0: none, so its map's window is not known
    const DatagramSeal* seal = nullptr;
    Cell cell;  // where it is
    std::optional<Pose> pose;
    TimeUs pose_us = 0;    // when it told that
    TimeUs places_us = 0;  // when it was told where others are
    std::optional<Cell> goal;
    std::optional<RobotStatus> status;
    std::vector<std::uint32_t> to_acknowledge;  // taken over, not committed yet
    std::uint32_t next_sequence = 1;
    Downlink downlink;
    std::optional<Command> command;
    bool command_pending = false;
    std::uint32_t command_sequence = 0;
    TimeUs command_sent_us = 0;
    std::optional<MapFrame> frame;  // where its map frame lies, while it does not know it
    TimeUs frame_sent_us = 0;
    TrafficCounters logged_traffic;
  };
  using Row = std::function<void(RunDatabase&)>;

  void load(RunDatabase& database);
  Robot* find_or_add(std::uint16_t id, TimeUs now_us);
  void count_in(Robot& robot, std::size_t size);
  bool is_present_start(Robot& robot, const DatagramHeader& header, TimeUs now_us);
  void start_epoch(Robot& robot, const DatagramHeader& header, TimeUs now_us);
  void forget_frame(Robot& robot, TimeUs now_us);
  void take_frame(Robot& robot, const Hello& hello, TimeUs now_us);
  void set_rough(Robot& robot, bool rough);
  static bool joined_before(const Robot& a, const Robot& b);
  static bool is_kept_from(const Robot& robot, const Robot& other);
  std::vector<std::uint16_t> untold(const Robot& robot) const;
  void keep_apart(Robot& robot, TimeUs now_us);
  void end_apart(Robot& robot);
  MapStore& map_of(const Robot& robot);
  bool is_apart(const Robot& robot) const { return apart_.contains(robot.record.robot); }
  std::size_t tile_count() const;
  void note_changes(const Robot& robot, const std::vector<TileChange>& changes, TimeUs now_us);
  void answer_hello(Robot& robot, const PeerAddress& from, const OpenedDatagram& opened);
  void take(Robot& robot, const OpenedDatagram& opened, TimeUs now_us);
  void set_window(Robot& robot, const CellRect& window);
  void handle_map_update(Robot& robot, std::uint32_t sequence, std::span<const std::uint8_t> body,
                         TimeUs now_us);
  bool accept_cell_size(std::int32_t cell_um);
  bool has_room_for(const Robot& robot, std::span<const std::uint8_t> body);
  void merge_regions(Robot& robot, std::uint32_t sequence, MapUpdateReader& reader, TimeUs now_us);
  void note_first_seen(const TileChange& change, TimeUs now_us);
  void handle_acknowledgement(Robot& robot, std::span<const std::uint8_t> body, TimeUs now_us);
  void handle_hello(Robot& robot, std::uint32_t sequence, std::span<const std::uint8_t> body,
                    TimeUs now_us);
  void handle_restore_request(Robot& robot, std::span<const std::uint8_t> body, TimeUs now_us);
  RestoreCursor write_own_cells(const Robot& robot, const RestoreRequest& request,
                                MapUpdateWriter& writer);
  void handle_status(Robot& robot, std::span<const std::uint8_t> body, TimeUs now_us);
  void handle_found(Robot& robot, std::uint32_t sequence, std::span<const std::uint8_t> body,
                    TimeUs now_us);
  void take_pose(Robot& robot, const PackedPose& packed, TimeUs now_us);

  void commit(TimeUs now_us);
  void save(RunDatabase& database, TimeUs now_us);
  // Notes a row for the next commit.
  template <typename Write>
  void log(Write write) {
    if (database_ != nullptr) rows_.emplace_back(std::move(write));
  }
  void log_traffic_and_progress(TimeUs now_us);
  void forget_old_rows(TimeUs now_us);
  void acknowledge_committed(Robot& robot);
  void tell_others();
  void send_downlink(Robot& robot, TimeUs now_us);
  bool send_downlink_datagram(Robot& robot, TimeUs now_us);
  void send_command_if_due(Robot& robot, TimeUs now_us);
  void send_places(Robot& robot, TimeUs now_us);
  void find_frames(TimeUs now_us);
  void send_frame_if_due(Robot& robot, TimeUs now_us);
  void set_command(Robot& robot, CommandCode code);
  std::uint32_t send(Robot& robot, MessageKind kind, std::size_t body_size);
  std::uint32_t send_to(Robot& robot, const PeerAddress& to, std::uint64_t receiver_boot,
                        MessageKind kind, std::size_t body_size);

  RunDatabase* database_ = nullptr;
  DatagramSender& sender_;
  std::uint32_t epoch_;
  MapServerConfig config_;
  MapServerCounters counters_;
  MapStore map_;
  ApartMaps apart_;
  FrameFinder frame_finder_;
  std::map<std::uint16_t, Robot> robots_;
  std::optional<std::int32_t> cell_um_;
  std::optional<std::uint16_t> finder_;

  std::set<std::pair<std::uint16_t, TileKey>> unsaved_tiles_;
  std::map<std::uint16_t, std::map<TileKey, CellRect>> uncommitted_changes_;  // by who sent them
  std::set<TileKey> changed_tiles_;                                           // for who looks on
  std::map<TileKey, FirstSeen> first_seen_;
  std::set<TileKey> unsaved_first_seen_;
  std::vector<Row> rows_;
  std::set<std::uint16_t> unsaved_robots_;
  TimeUs last_commit_us_ = 0;
  TimeUs last_log_us_ = 0;
  TimeUs last_forget_us_ = 0;
  std::uint64_t logged_explored_ = 0;
  std::uint64_t logged_obstacles_ = 0;
  std::array<std::uint8_t, kMaxDatagramBytes> out_{};
  std::array<std::uint8_t, kMaxBlockCells> cells_{};
};

}  // namespace ivfm::host
