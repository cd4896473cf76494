// Writes replay files (FORMAT.md); host only.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "firmware/lidar/scan.h"
#include "tests/replay/replay_ports.h"

namespace ivfm::replay {

class ReplayWriter {
 public:
  explicit ReplayWriter(const Header& header);

  // Records of an agent. `serial`, `frames` and `datagrams` (each after its size, 2 bytes) are what
  // the agent received in this step, within the limits of replay_format.h.
  void step(TimeUs now_us, std::span<const std::uint8_t> serial, std::span<const CanFrame> frames,
            std::span<const std::uint8_t> datagrams, const PortStatuses& statuses);

  // Records of an explorer.
  void start(const Pose& pose, Point window_center);
  void begin_action() { call(Call::kBeginAction); }
  void fuse(const Pose& pose, const Scan& scan, bool count_visits);
  void decide(const Pose& pose);
  void abandon_goal() { call(Call::kAbandonGoal); }

  // The whole file with its end; nothing may be written afterwards.
  std::vector<std::uint8_t> finish();
  std::size_t size() const { return file_.size() + block_.size(); }

 private:
  void call(Call call) { u8(static_cast<std::uint8_t>(call)); }
  void pose(const Pose& pose);
  void frame(const CanFrame& frame);
  void u8(std::uint8_t value);
  void varint(std::uint64_t value);
  void signed_varint(std::int64_t value);
  void bytes(std::span<const std::uint8_t> bytes);
  void end_block();

  std::vector<std::uint8_t> file_;
  std::vector<std::uint8_t> block_;
  std::uint32_t crc_ = 0;
  TimeUs now_us_ = 0;
  CanHistory history_;
  PortStatuses statuses_;
};

}  // namespace ivfm::replay
