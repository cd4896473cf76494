// Fake port: a CAN wire in memory between several ends, with faults by place, count and delay.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/hal/can_bus.h"
#include "firmware/hal/clock.h"

namespace ivfm::fake {

// Faults of one end of the wire; they act on what that end sends.
struct CanFaults {
  std::uint32_t drop_next = 0;          // loses the next frames
  std::uint32_t drop_every = 0;         // loses each n-th frame; 0: none
  std::uint16_t drop_id = 0xffff;       // loses every frame with this identifier
  TimeUs delay_us = 0;                  // the wire is slow
  Status send_status = Status::kOk;     // what send() answers instead of sending
  Status receive_status = Status::kOk;  // what receive() answers instead of a frame
};

// A wire with `kEnds` ends: what one sends the others receive, in order, once advanced to its time.
template <std::size_t kEnds = 2, std::size_t kCapacity = 512>
class FakeCanWire {
 public:
  FakeCanWire() {
    for (End& end : ends_) end.wire = this;
  }
  FakeCanWire(const FakeCanWire&) = delete;
  FakeCanWire& operator=(const FakeCanWire&) = delete;

  void advance_to(TimeUs now_us) { now_us_ = now_us; }
  CanBus& end(std::size_t index) { return ends_[index]; }
  CanFaults& faults(std::size_t index) { return ends_[index].faults; }
  // How often `id` was sent by an end and reached the wire.
  std::uint32_t sent(std::uint16_t id) const { return id < sent_.size() ? sent_[id] : 0; }
  // The last frame with `id` on the wire, an empty one when there was none.
  CanFrame last(std::uint16_t id) const { return id < last_.size() ? last_[id] : CanFrame{}; }

 private:
  struct Queued {
    TimeUs due_us = 0;
    CanFrame frame;
  };
  struct End final : CanBus {
    Result<CanFrame> receive() override {
      if (!ok(faults.receive_status)) return faults.receive_status;
      if (count == 0 || queue[head].due_us > wire->now_us_) return Status::kEmpty;
      const CanFrame frame = queue[head].frame;
      head = (head + 1) % kCapacity;
      --count;
      return frame;
    }
    Status send(const CanFrame& frame) override {
      if (!ok(faults.send_status)) return faults.send_status;
      ++sends;
      if (faults.drop_next > 0) {
        --faults.drop_next;
        return Status::kOk;
      }
      if (faults.drop_every > 0 && sends % faults.drop_every == 0) return Status::kOk;
      if (frame.id == faults.drop_id) return Status::kOk;
      wire->deliver(*this, frame);
      return Status::kOk;
    }
    FakeCanWire* wire = nullptr;
    CanFaults faults;
    std::array<Queued, kCapacity> queue{};
    std::size_t head = 0;
    std::size_t count = 0;
    std::uint32_t sends = 0;
  };

  void deliver(const End& from, const CanFrame& frame) {
    ++sent_[frame.id & 0x7ffu];
    last_[frame.id & 0x7ffu] = frame;
    for (End& end : ends_) {
      if (&end == &from || end.count == kCapacity) continue;
      end.queue[(end.head + end.count) % kCapacity] = {now_us_ + from.faults.delay_us, frame};
      ++end.count;
    }
  }

  TimeUs now_us_ = 0;
  std::array<End, kEnds> ends_;
  std::array<std::uint32_t, 0x800> sent_{};
  std::array<CanFrame, 0x800> last_{};
};

}  // namespace ivfm::fake
