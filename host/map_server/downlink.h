// What one robot does not know yet of what the others saw.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "firmware/hal/clock.h"
#include "host/map_server/map_store.h"
#include "shared/wire/messages.h"

namespace ivfm::host {

struct DownlinkConfig {
  TimeUs period_us = 1000000;      // changes are collected for this long
  TimeUs retry_us = 1000000;       // without acknowledgement, sent again after this time,
  TimeUs retry_max_us = 16000000;  // which doubles up to here while the robot is silent
  std::uint32_t max_open_datagrams = 16;
};

// Per tile of the robot's window one rectangle of changed cells: memory is bounded by the window,
// not by the traffic or the map. Only what changed since the robot's last acknowledgement is sent.
class Downlink {
 public:
  struct Part {
    TileKey key;
    CellRect rect;  // inside the tile
  };

  explicit Downlink(const DownlinkConfig& config = {})
      : config_(config), timeout_us_(config.retry_us), open_allowed_(config.max_open_datagrams) {}

  // The cells that the robot's map can hold; what was to be sent outside is forgotten.
  void set_window(const CellRect& window);
  const CellRect& window() const { return window_; }
  // The part of `rect` inside the window has news. `rect`: inside the tile.
  void mark(const TileKey& key, const CellRect& rect);
  // What was sent long ago and not acknowledged becomes dirty again.
  void expire(TimeUs now_us);
  void acknowledge(const Acknowledgement& acknowledgement, TimeUs now_us);

  // True when a datagram may be sent now.
  bool is_due(TimeUs now_us) const;
  // The dirty parts, those nearest to `center` first, at most `limit`.
  std::vector<Part> nearest(Cell center, std::size_t limit) const;
  // These parts have left with datagram `sequence`.
  void sent(const std::vector<Part>& parts, std::uint32_t sequence, TimeUs now_us);
  // Nothing more is sent before the next period.
  void end_batch(TimeUs now_us) { last_batch_us_ = now_us; }

  bool idle() const { return dirty_.empty() && in_flight_.empty(); }

 private:
  struct InFlight {
    Part part;
    std::uint32_t sequence;
    TimeUs sent_us;
  };

  DownlinkConfig config_;
  CellRect window_;
  std::map<TileKey, CellRect> dirty_;
  std::map<std::uint32_t, std::vector<InFlight>> in_flight_;  // by datagram
  TimeUs timeout_us_;
  std::uint32_t open_allowed_;
  TimeUs last_batch_us_ = 0;
  TimeUs last_acknowledged_us_ = 0;
  TimeUs backed_off_us_ = 0;
};

}  // namespace ivfm::host
