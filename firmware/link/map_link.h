// The robot's side of the radio: sends what its map gained, takes what the others saw.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

#include "firmware/hal/clock.h"
#include "firmware/hal/datagram_socket.h"
#include "firmware/link/dirty_rectangles.h"
#include "firmware/link/peer_robot.h"
#include "firmware/link/shared_map.h"
#include "shared/geometry/pose.h"
#include "shared/wire/datagram.h"
#include "shared/wire/map_update.h"
#include "shared/wire/messages.h"
#include "shared/wire/replay_window.h"

namespace ivfm {

struct MapLinkConfig {
  std::uint16_t robot = 1;       // 1 .. 65535
  std::uint32_t epoch = 1;       // of this start; the server raises it when an earlier one had it
  std::uint64_t boot = 1;        // a random number drawn at this start, not 0
  std::int32_t cell_um = 50000;  // the map's, 1 .. 2^24 - 1
  std::string_view name;         // for people, at most 24 characters
  bool rough = false;            // its start may be wrong, and it looks for where it was
  bool apart = false;            // its map frame's place in the team's is for the server to find
  TimeUs batch_period_us = 1000000;   // map updates leave at most this often, or at flush()
  TimeUs status_period_us = 1000000;  // 0: no status messages
  TimeUs retry_us = 1000000;          // without acknowledgement, sent again after this time,
  TimeUs retry_max_us = 16000000;     // which doubles up to here while the server is silent
  TimeUs keepalive_us = 5000000;      // a server not heard for so long is asked whether it is there
  std::uint32_t bytes_per_second =
      0;  // limit of what is sent, IP and UDP headers included; 0: none
};

// All since start-up. Bytes include 28 for the IP and UDP headers of each datagram.
struct MapLinkCounters {
  std::uint64_t datagrams_sent = 0;
  std::uint64_t bytes_sent = 0;
  std::uint64_t datagrams_received = 0;
  std::uint64_t bytes_received = 0;
  std::uint32_t regions_sent = 0;
  std::uint32_t retransmissions = 0;  // regions that became dirty again for want of an answer
  std::uint32_t regions_received = 0;
  std::uint32_t send_failures = 0;        // the socket did not take a datagram
  std::uint32_t cells_restored = 0;       // own cells taken back after a restart
  std::uint32_t dropped_malformed = 0;    // envelope or body are not what FORMAT.md says
  std::uint32_t dropped_misdirected = 0;  // for another robot
  std::uint32_t dropped_refused = 0;      // not from the server, or for an earlier start
  std::uint32_t dropped_replayed = 0;     // taken already
  std::uint32_t dropped_stale = 0;        // older than what was taken already
  std::uint32_t dropped_cell_size = 0;    // the team's cells have another size
  std::uint64_t cells_lost = 0;           // left the map's window before the server had them
};

// Fixed memory, whatever the radio does: a silent server costs nothing and loses nothing. Every
// change of the robot's own layers has to be marked with mark_dirty(). The first thing that leaves
// is a hello; all else waits for the server's welcome, and map updates until the robot has its own
// cells of before its last restart back (FORMAT.md, "Conversation").
class MapLink {
 public:
  // `seal` must outlive the link.
  MapLink(SharedMap& map, DatagramSocket& socket, const MapLinkConfig& config,
          const DatagramSeal& seal = kPlainSeal);
  MapLink(const MapLink&) = delete;
  MapLink& operator=(const MapLink&) = delete;

  // The robot's own cells of `rect` have changed. Cells beyond 24-bit numbers are left out.
  void mark_dirty(Layer layer, const CellRect& rect);
  // Sends what is dirty with the next step(), without waiting for the batch period.
  void flush() { flush_ = true; }
  // The map's window, at first and when it has moved: what lies outside cannot be read. Dirty cells
  // there are given up and counted in cells_lost; ask is_acknowledged() before moving to avoid
  // that.
  void clip(const CellRect& window);

  // The robot's cells are in another map frame from now on: the server forgets what it had of them.
  // Mark all of them dirty afterwards. A robot that was apart is part of the team from then on, and
  // takes back what it told of the team's frame before its last start.
  void move_frame();

  // The start that was told roughly is known now.
  void end_rough();

  // Receives and sends what is due; bounded work. `pose` goes along with map updates.
  void step(TimeUs now_us, const Pose& pose);

  // What the next status message says; its pose and link figures are filled in when it is sent.
  void set_status(const RobotStatus& status) { status_ = status; }
  // The target was seen; reported until the server has it.
  void report_found(Point target);
  // The newest command not yet taken, if there is one.
  std::optional<CommandCode> take_command();
  // Where the server says that this robot's map frame lies in the team's: one that is apart is to
  // move there, one whose start is rough gets the identity, and is to stay where it is.
  std::optional<Pose> take_frame();
  // Other robots near this one, as the server told last; look at how old they are.
  std::span<const PeerRobot> peers() const { return {peers_.data(), peers_size_}; }

  // The epoch in use: the configured one or a larger one.
  std::uint32_t epoch() const { return epoch_; }
  // True when the server has made everything durable: map, hello, found.
  bool all_acknowledged() const;
  // True when the server has every marked cell of `rect`, and this robot what the server had of it
  // before it was started.
  bool is_acknowledged(Layer layer, const CellRect& rect) const;
  // When the last proper datagram of the server came; 0: never.
  TimeUs last_heard_us() const { return last_heard_us_; }
  const MapLinkCounters& counters() const { return counters_; }

 private:
  struct InFlight {
    Layer layer = Layer::kVisits;
    CellRect rect;
    std::uint32_t sequence = 0;
    TimeUs sent_us = 0;
  };
  // A message that is repeated until acknowledged.
  struct Reliable {
    bool pending = false;
    std::uint32_t sequence = 0;  // of the last sending; 0: not sent yet
    TimeUs sent_us = 0;
  };
  static constexpr std::size_t kMaxInFlight = 64;
  static constexpr std::uint32_t kMaxOpenDatagrams = 16;
  static constexpr int kMaxReceivesPerStep = 32;

  void receive_all(TimeUs now_us);
  void handle(std::span<std::uint8_t> datagram, TimeUs now_us);
  bool is_from_present_server(const DatagramHeader& header);
  void handle_body(const OpenedDatagram& opened, TimeUs now_us);
  void handle_acknowledgement(std::span<const std::uint8_t> body, TimeUs now_us);
  void handle_map_update(std::uint32_t sequence, std::span<const std::uint8_t> body);
  void handle_command(std::uint32_t sequence, std::span<const std::uint8_t> body);
  void handle_welcome(std::span<const std::uint8_t> body, TimeUs now_us);
  void handle_restore(std::span<const std::uint8_t> body, TimeUs now_us);
  void handle_frame(std::span<const std::uint8_t> body);
  void handle_places(std::uint32_t sequence, std::span<const std::uint8_t> body, TimeUs now_us);
  bool has_right_cells(std::span<const std::uint8_t> map_update);
  void note_answer(TimeUs now_us);
  void note_taken(std::uint32_t sequence);

  void expire(TimeUs now_us);
  bool tells_silence(TimeUs sent_us) const;
  void requeue(std::size_t index);
  void remove_in_flight(std::size_t index);

  void send_acknowledgement();
  void send_probe(TimeUs now_us);
  void send_hello(TimeUs now_us);
  std::size_t write_hello();
  CellRect told_window() const;
  void send_restore_request(TimeUs now_us);
  void send_found(TimeUs now_us, const Pose& pose);
  void send_status(TimeUs now_us, const Pose& pose);
  void send_map_updates(TimeUs now_us, const Pose& pose);
  bool send_map_update(TimeUs now_us, const Pose& pose);
  bool add_region(MapUpdateWriter& writer, TimeUs now_us);
  void send_reliable(Reliable& message, MessageKind kind, std::size_t body_size, TimeUs now_us,
                     std::uint64_t receiver_boot);
  static bool is_due(const Reliable& message);
  bool has_dirty() const;
  DirtyRectangles* next_dirty_layer();
  void refill_tokens(TimeUs now_us);
  bool may_send() const;
  std::uint32_t open_datagrams() const;
  // Fills in the envelope around `body_size` bytes of body and sends; takes the next sequence
  // number.
  Status send(MessageKind kind, std::size_t body_size, std::uint64_t receiver_boot);

  SharedMap& map_;
  DatagramSocket& socket_;
  MapLinkConfig config_;
  const DatagramSeal& seal_;
  MapLinkCounters counters_;

  std::array<DirtyRectangles, kLayerCount> dirty_;
  std::size_t turn_ = 0;                        // the layer that sends next
  CellRect window_;                             // what can be read of the map
  std::array<CellRect, kLayerCount> marked_{};  // holds all that was ever marked
  std::array<InFlight, kMaxInFlight> in_flight_{};
  std::size_t in_flight_size_ = 0;
  std::uint32_t next_sequence_ = 1;

  bool flush_ = false;
  bool batch_open_ = false;
  std::optional<TimeUs> last_batch_us_;
  std::optional<TimeUs> last_status_us_;
  TimeUs last_heard_us_ = 0;
  TimeUs last_answer_us_ = 0;

  TimeUs timeout_us_ = 0;
  TimeUs backed_off_us_ = 0;
  std::uint32_t open_datagrams_allowed_ = kMaxOpenDatagrams;
  std::int64_t tokens_ = 0;  // bytes that may leave, times 1,000,000
  TimeUs refilled_us_ = 0;

  std::uint32_t epoch_;
  std::uint32_t server_epoch_ = 0;
  std::uint64_t server_boot_ = 0;
  ReplayWindow server_window_;
  bool connected_ = false;    // the present server has welcomed this robot
  bool welcomed_ = false;     // some server has, since the start
  bool moved_frame_ = false;  // in this epoch
  bool rough_;
  bool apart_;                  // from the team: the frame is the robot's own
  bool frame_is_known_ = true;  // to the server; until then nothing but hellos leaves
  std::optional<Pose> frame_;   // in the team's, as the server told
  std::uint32_t newest_update_ = 0;
  ReplayWindow taken_;  // what is to be acknowledged
  bool acknowledgement_due_ = false;
  std::uint32_t command_revision_ = 0;
  std::optional<CommandCode> command_;
  std::uint32_t newest_places_ = 0;
  std::array<PeerRobot, RobotPlaces::kMost> peers_{};
  std::size_t peers_size_ = 0;

  Reliable probe_;  // a hello to a server not known yet, or silent
  Reliable hello_;
  Reliable restore_request_;
  RestoreCursor restore_from_;  // while restore_request_ is pending
  Reliable found_;
  Point found_target_;
  RobotStatus status_;

  std::array<std::uint8_t, kMaxDatagramBytes> datagram_{};
  std::array<std::uint8_t, kMaxBlockCells> cells_{};
};

}  // namespace ivfm
