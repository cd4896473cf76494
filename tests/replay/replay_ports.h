// The agent's ports in a replay: deliver what was recorded, hash what the agent sends.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "firmware/hal/can_bus.h"
#include "firmware/hal/clock.h"
#include "firmware/hal/datagram_socket.h"
#include "firmware/hal/serial_port.h"
#include "tests/replay/fnv1a.h"
#include "tests/replay/replay_reader.h"

namespace ivfm::replay {

// What the ports answer besides data; kOk: all is well (receiving: nothing more waits).
struct PortStatuses {
  Status serial_read = Status::kOk;
  Status serial_write = Status::kOk;
  Status can_receive = Status::kOk;
  Status can_send = Status::kOk;
  Status radio_receive = Status::kOk;
  constexpr bool operator==(const PortStatuses&) const = default;
};

template <typename Statuses, typename Visitor>
void for_each_status(Statuses& statuses, Visitor&& visit) {
  visit(statuses.serial_read);
  visit(statuses.serial_write);
  visit(statuses.can_receive);
  visit(statuses.can_send);
  visit(statuses.radio_receive);
}

// A frame of every identifier seen so far: the next one is told by what differs.
class CanHistory {
 public:
  // The frame at `slot`.
  CanFrame& at(std::size_t slot) { return frames_[slot]; }
  // The slot of frames like this one, kCanSlots when there is none.
  std::size_t find(const CanFrame& frame) const {
    for (std::size_t i = 0; i < used_; ++i) {
      const CanFrame& known = frames_[i];
      if (known.id == frame.id && known.size == frame.size && known.remote == frame.remote) {
        return i;
      }
    }
    return kCanSlots;
  }
  // A slot for a new kind of frame: a free one, else the first.
  std::size_t take() { return used_ < kCanSlots ? used_++ : 0; }

 private:
  std::array<CanFrame, kCanSlots> frames_{};
  std::size_t used_ = 0;
};

// What one step of the agent received.
class StepInput {
 public:
  // Reads a step; the reader fails when it makes no sense.
  void read(ReplayReader& reader);

  TimeUs now_us = 0;  // of the step; grows from step to step, or goes back as it did when recorded
  std::array<std::uint8_t, kMaxSerialBytes> serial{};
  std::size_t serial_size = 0, serial_taken = 0;
  std::array<CanFrame, kMaxCanFrames> frames{};
  std::size_t frame_count = 0, frames_taken = 0;
  std::array<std::uint8_t, kMaxDatagramBytes> datagrams{};  // each after its size, 2 bytes
  std::size_t datagrams_size = 0, datagrams_taken = 0;
  PortStatuses statuses;

  // Whether the agent took all of it.
  bool is_used_up() const {
    return serial_taken == serial_size && frames_taken == frame_count &&
           datagrams_taken == datagrams_size;
  }

 private:
  void read_serial(ReplayReader& reader);
  void read_can(ReplayReader& reader);
  void read_datagrams(ReplayReader& reader);
  void read_statuses(ReplayReader& reader);

  CanHistory history_;
};

class ReplaySerialPort final : public SerialPort {
 public:
  ReplaySerialPort(StepInput& input, Fnv1a& hash) : input_(input), hash_(hash) {}
  Result<std::size_t> read(std::span<std::uint8_t> buffer) override;
  Status write(std::span<const std::uint8_t> bytes) override;
  Status set_motor(bool on) override;

 private:
  StepInput& input_;
  Fnv1a& hash_;
};

class ReplayCanBus final : public CanBus {
 public:
  ReplayCanBus(StepInput& input, Fnv1a& hash) : input_(input), hash_(hash) {}
  Result<CanFrame> receive() override;
  Status send(const CanFrame& frame) override;
  std::uint32_t sent() const { return sent_; }

 private:
  StepInput& input_;
  Fnv1a& hash_;
  std::uint32_t sent_ = 0;
};

class ReplayRadio final : public DatagramSocket {
 public:
  ReplayRadio(StepInput& input, Fnv1a& hash) : input_(input), hash_(hash) {}
  Result<std::size_t> receive(std::span<std::uint8_t> buffer) override;
  Status send(std::span<const std::uint8_t> datagram) override;

 private:
  StepInput& input_;
  Fnv1a& hash_;
};

// How many instructions (or whatever the target can count) have been executed; for measuring.
class WorkCounter {
 public:
  virtual std::uint64_t now() = 0;

 protected:
  ~WorkCounter() = default;
};

// Answers recorded time, so that decision times are the same everywhere, and notes how much work
// lies between two questions: the agent asks before and after each decision and each fusion.
class ReplayClock final : public Clock {
 public:
  ReplayClock(const StepInput& input, WorkCounter* counter) : input_(input), counter_(counter) {}
  TimeUs now_us() override {
    if (counter_ != nullptr) {
      const std::uint64_t work = counter_->now();
      last_work_ = work - work_;
      work_ = work;
    }
    return input_.now_us;
  }
  std::uint64_t last_work() const { return last_work_; }

 private:
  const StepInput& input_;
  WorkCounter* counter_;
  std::uint64_t work_ = 0, last_work_ = 0;
};

}  // namespace ivfm::replay
