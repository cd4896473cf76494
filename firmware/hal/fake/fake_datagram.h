// A faulty radio in memory: two DatagramSocket ends, with seeded loss, doubling, delay, corruption.
#pragma once

#include <algorithm>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "firmware/hal/clock.h"
#include "firmware/hal/datagram_socket.h"

namespace ivfm {

struct RadioFaults {
  unsigned drop_permille = 0;
  unsigned duplicate_permille = 0;
  unsigned corrupt_permille = 0;   // one bit of the datagram is flipped
  unsigned truncate_permille = 0;  // the datagram loses its end
  TimeUs max_delay_us = 0;         // each datagram takes 0 .. this long: they overtake each other
};

// For tests; uses the heap. Set the time with set_now(); the same seed gives the same faults.
class FakeRadio {
 public:
  class End final : public DatagramSocket {
   public:
    Result<std::size_t> receive(std::span<std::uint8_t> buffer) override {
      return radio_.receive(*this, buffer);
    }
    Status send(std::span<const std::uint8_t> datagram) override {
      return radio_.send(*other_, datagram);
    }

   private:
    friend class FakeRadio;
    struct Datagram {
      TimeUs due_us;
      std::vector<std::uint8_t> bytes;
    };
    explicit End(FakeRadio& radio) : radio_(radio) {}
    FakeRadio& radio_;
    End* other_ = nullptr;
    std::vector<Datagram> arriving_;
  };

  explicit FakeRadio(std::uint32_t seed, RadioFaults faults = {}) : random_(seed), faults_(faults) {
    robot_.other_ = &server_;
    server_.other_ = &robot_;
  }
  FakeRadio(const FakeRadio&) = delete;
  FakeRadio& operator=(const FakeRadio&) = delete;

  DatagramSocket& robot() { return robot_; }
  DatagramSocket& server() { return server_; }
  void set_now(TimeUs now_us) { now_us_ = now_us; }
  void set_faults(const RadioFaults& faults) { faults_ = faults; }
  // While true, nothing sent arrives.
  void set_partitioned(bool partitioned) { partitioned_ = partitioned; }
  // What the ends answer to send(); kOk: they work.
  void set_send_status(Status status) { send_status_ = status; }
  std::size_t largest_datagram() const { return largest_; }
  std::uint64_t sent() const { return sent_; }

 private:
  bool happens(unsigned permille) { return random_() % 1000 < permille; }

  Status send(End& to, std::span<const std::uint8_t> datagram) {
    if (!ok(send_status_)) return send_status_;
    ++sent_;
    largest_ = std::max(largest_, datagram.size());
    const int copies = happens(faults_.duplicate_permille) ? 2 : 1;
    for (int i = 0; i < copies; ++i) {
      if (partitioned_ || happens(faults_.drop_permille)) continue;
      std::vector<std::uint8_t> bytes(datagram.begin(), datagram.end());
      spoil(bytes);
      const TimeUs delay_us =
          faults_.max_delay_us == 0 ? 0 : random_() % (faults_.max_delay_us + 1);
      to.arriving_.push_back({now_us_ + delay_us, std::move(bytes)});
    }
    return Status::kOk;
  }

  void spoil(std::vector<std::uint8_t>& bytes) {
    if (bytes.empty()) return;
    if (happens(faults_.corrupt_permille)) {
      const std::size_t bit = random_() % (bytes.size() * 8);
      bytes[bit / 8] = static_cast<std::uint8_t>(bytes[bit / 8] ^ (1u << (bit % 8)));
    }
    if (happens(faults_.truncate_permille)) bytes.resize(random_() % bytes.size());
  }

  Result<std::size_t> receive(End& end, std::span<std::uint8_t> buffer) {
    auto first = end.arriving_.end();
    for (auto it = end.arriving_.begin(); it != end.arriving_.end(); ++it) {
      if (it->due_us <= now_us_ && (first == end.arriving_.end() || it->due_us < first->due_us)) {
        first = it;
      }
    }
    if (first == end.arriving_.end()) return Status::kEmpty;
    const std::vector<std::uint8_t> bytes = std::move(first->bytes);
    end.arriving_.erase(first);
    if (bytes.size() > buffer.size()) return Status::kTruncated;
    std::copy(bytes.begin(), bytes.end(), buffer.begin());
    return bytes.size();
  }

  std::mt19937 random_;
  RadioFaults faults_;
  TimeUs now_us_ = 0;
  bool partitioned_ = false;
  Status send_status_ = Status::kOk;
  std::size_t largest_ = 0;
  std::uint64_t sent_ = 0;
  End robot_{*this};
  End server_{*this};
};

}  // namespace ivfm
