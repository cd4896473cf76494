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
#include "firmware/link/shared_map.h"
#include "shared/geometry/pose.h"
#include "shared/wire/datagram.h"
#include "shared/wire/map_update.h"
#include "shared/wire/messages.h"

namespace ivfm {

struct MapLinkConfig {
  std::uint16_t robot = 1;         // 1 .. 65535
  std::uint32_t epoch = 1;         // larger at every start of this robot: a counter or Unix time
  std::int32_t cell_um = 50000;    // the map's, 1 .. 2^24 - 1
  std::uint16_t window_width = 0;  // the map's window in cells
  std::uint16_t window_height = 0;
  std::string_view name;              // for people, at most 24 characters
  TimeUs batch_period_us = 1000000;   // map updates leave at most this often, or at flush()
  TimeUs status_period_us = 1000000;  // 0: no status messages
  TimeUs retry_us = 1000000;          // without acknowledgement, sent again after this time,
  TimeUs retry_max_us = 16000000;     // which doubles up to here while the server is silent
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
  std::uint32_t dropped_malformed = 0;    // envelope or body are not what FORMAT.md says
  std::uint32_t dropped_misdirected = 0;  // for another robot, or not from a server
  std::uint32_t dropped_stale = 0;        // older than what was taken already
  std::uint32_t dropped_cell_size = 0;    // the team's cells have another size
  std::uint64_t cells_lost = 0;           // left the map's window before the server had them
};

// Fixed memory, whatever the radio does: a silent server costs nothing and loses nothing. Every
// change of the robot's own layers has to be marked with mark_dirty().
class MapLink {
 public:
  MapLink(SharedMap& map, DatagramSocket& socket, const MapLinkConfig& config);
  MapLink(const MapLink&) = delete;
  MapLink& operator=(const MapLink&) = delete;

  // The robot's own cells of `rect` have changed. Cells beyond 24-bit numbers are left out.
  void mark_dirty(Layer layer, const CellRect& rect);
  // Sends what is dirty with the next step(), without waiting for the batch period.
  void flush() { flush_ = true; }
  // The map's window has moved: what lies outside can no longer be read. Dirty cells there are
  // given up and counted in cells_lost; ask is_acknowledged() before moving on to avoid that.
  void clip(const CellRect& window);

  // Receives and sends what is due; bounded work. `pose` goes along with map updates.
  void step(TimeUs now_us, const Pose& pose);

  // What the next status message says; its pose and link figures are filled in when it is sent.
  void set_status(const RobotStatus& status) { status_ = status; }
  // The target was seen; reported until the server has it.
  void report_found(Point target);
  // The newest command not yet taken, if there is one.
  std::optional<CommandCode> take_command();

  // True when the server has made everything durable: map, hello, found.
  bool all_acknowledged() const;
  // True when the server has every marked cell of `rect`.
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
  void handle(std::span<const std::uint8_t> datagram, TimeUs now_us);
  void take_server_epoch(std::uint32_t epoch);
  void handle_acknowledgement(std::span<const std::uint8_t> body, TimeUs now_us);
  void handle_map_update(std::uint32_t sequence, std::span<const std::uint8_t> body);
  void handle_command(std::uint32_t sequence, std::span<const std::uint8_t> body);
  void note_taken(std::uint32_t sequence);

  void expire(TimeUs now_us);
  void requeue(std::size_t index);
  void remove_in_flight(std::size_t index);

  void send_acknowledgement(TimeUs now_us);
  void send_hello(TimeUs now_us);
  void send_found(TimeUs now_us, const Pose& pose);
  void send_status(TimeUs now_us, const Pose& pose);
  void send_map_updates(TimeUs now_us, const Pose& pose);
  bool send_map_update(TimeUs now_us, const Pose& pose);
  bool add_region(MapUpdateWriter& writer, TimeUs now_us);
  void send_reliable(Reliable& message, MessageKind kind, std::size_t body_size, TimeUs now_us);
  bool is_due(const Reliable& message, TimeUs now_us) const;
  bool has_dirty() const;
  DirtyRectangles* next_dirty_layer();
  void refill_tokens(TimeUs now_us);
  bool may_send() const;
  std::uint32_t open_datagrams() const;
  // Fills in the envelope around `body_size` bytes of body and sends; takes the next sequence
  // number.
  Status send(MessageKind kind, std::size_t body_size);

  SharedMap& map_;
  DatagramSocket& socket_;
  MapLinkConfig config_;
  MapLinkCounters counters_;

  std::array<DirtyRectangles, kLayerCount> dirty_;
  std::size_t turn_ = 0;  // the layer that sends next
  CellRect window_;       // what can be read of the map
  std::array<InFlight, kMaxInFlight> in_flight_{};
  std::size_t in_flight_size_ = 0;
  std::uint32_t next_sequence_ = 1;

  bool flush_ = false;
  bool batch_open_ = false;
  std::optional<TimeUs> last_batch_us_;
  std::optional<TimeUs> last_status_us_;
  TimeUs last_heard_us_ = 0;
  TimeUs last_acknowledged_us_ = 0;

  TimeUs timeout_us_ = 0;
  TimeUs backed_off_us_ = 0;
  std::uint32_t open_datagrams_allowed_ = kMaxOpenDatagrams;
  std::int64_t tokens_ = 0;  // bytes that may leave, times 1,000,000
  TimeUs refilled_us_ = 0;

  std::uint32_t server_epoch_ = 0;
  std::uint32_t newest_update_ = 0;
  Acknowledgement taken_;  // what of the server's was taken, in its epoch
  bool acknowledgement_due_ = false;
  std::uint32_t command_revision_ = 0;
  std::optional<CommandCode> command_;

  Reliable hello_;
  Reliable found_;
  Point found_target_;
  RobotStatus status_;

  std::array<std::uint8_t, kMaxDatagramBytes> datagram_{};
  std::array<std::uint8_t, kMaxBlockCells> cells_{};
};

}  // namespace ivfm
