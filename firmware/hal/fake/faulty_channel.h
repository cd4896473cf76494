// One direction of a bad radio: seeded faults, in whatever time it is given.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "firmware/hal/clock.h"

namespace ivfm {

// Probabilities are 0 .. 1 and hold for each datagram by itself.
struct RadioFaults {
  struct Partition {
    TimeUs begin_us = 0;
    TimeUs end_us = 0;  // first moment at which datagrams get through again
  };
  double drop = 0;
  double duplicate = 0;
  double reorder = 0;                   // held back for up to kReorderUs: later ones overtake it
  double corrupt = 0;                   // one bit is flipped
  double truncate = 0;                  // the end is missing
  TimeUs delay_us = 0;                  // of every datagram,
  TimeUs jitter_us = 0;                 // and 0 .. this more
  std::uint64_t bytes_per_second = 0;   // 0: no limit. What would wait over a second is lost
  std::vector<Partition> partitions{};  // nothing sent meanwhile arrives
};

struct RadioCounters {
  std::uint64_t sent = 0;
  std::uint64_t lost = 0;  // dropped, sent into a partition, or over the rate
  std::uint64_t duplicated = 0;
  std::uint64_t reordered = 0;
  std::uint64_t spoiled = 0;  // corrupted or truncated
  RadioCounters& operator+=(const RadioCounters& other) {
    sent += other.sent;
    lost += other.lost;
    duplicated += other.duplicated;
    reordered += other.reordered;
    spoiled += other.spoiled;
    return *this;
  }
};

// The same seed and the same calls give the same faults. For tests and host tools; uses the heap.
class FaultyChannel {
 public:
  using Bytes = std::vector<std::uint8_t>;
  static constexpr TimeUs kReorderUs = 500'000;
  static constexpr TimeUs kMaxQueueUs = 1'000'000;   // of a rate limit
  static constexpr std::size_t kOverheadBytes = 28;  // IP and UDP headers, for the rate

  FaultyChannel(std::uint32_t seed, RadioFaults faults)
      : random_(seed), faults_(std::move(faults)) {}

  // What is in the air already keeps its fate.
  void set_faults(RadioFaults faults) { faults_ = std::move(faults); }

  void send(std::span<const std::uint8_t> datagram, TimeUs now_us) {
    ++counters_.sent;
    const bool twice = happens(faults_.duplicate);
    counters_.duplicated += twice ? 1u : 0u;
    for (int copies = twice ? 2 : 1; copies > 0; --copies) send_copy(datagram, now_us);
  }
  // The next datagram that has arrived by `now_us`.
  std::optional<Bytes> receive(TimeUs now_us) {
    const auto first = in_the_air_.begin();
    if (first == in_the_air_.end() || first->first > now_us) return std::nullopt;
    Bytes bytes = std::move(first->second);
    in_the_air_.erase(first);
    return bytes;
  }
  // When the next datagram arrives, if one is in the air.
  std::optional<TimeUs> next_arrival_us() const {
    if (in_the_air_.empty()) return std::nullopt;
    return in_the_air_.begin()->first;
  }
  const RadioCounters& counters() const { return counters_; }

 private:
  double draw() { return static_cast<double>(random_()) / 4294967296.0; }  // 0 <= x < 1
  bool happens(double probability) { return draw() < probability; }
  TimeUs up_to(TimeUs limit_us) { return limit_us == 0 ? 0 : random_() % (limit_us + 1); }

  void send_copy(std::span<const std::uint8_t> datagram, TimeUs now_us) {
    const std::optional<TimeUs> left_us = transmit(datagram.size(), now_us);
    if (!left_us || partitioned(now_us) || happens(faults_.drop)) {
      ++counters_.lost;
      return;
    }
    TimeUs arrival_us = *left_us + faults_.delay_us + up_to(faults_.jitter_us);
    if (happens(faults_.reorder)) {
      ++counters_.reordered;
      arrival_us += up_to(kReorderUs);
    }
    in_the_air_.emplace(arrival_us, spoil({datagram.begin(), datagram.end()}));
  }

  // When the datagram has left a sender that is limited to a rate; nothing when its queue is full.
  std::optional<TimeUs> transmit(std::size_t size, TimeUs now_us) {
    if (faults_.bytes_per_second == 0) return now_us;
    const TimeUs begin_us = std::max(now_us, free_us_);
    if (begin_us - now_us > kMaxQueueUs) return std::nullopt;
    free_us_ = begin_us + (size + kOverheadBytes) * 1'000'000 / faults_.bytes_per_second;
    return free_us_;
  }

  bool partitioned(TimeUs now_us) const {
    return std::any_of(
        faults_.partitions.begin(), faults_.partitions.end(),
        [now_us](const auto& p) { return now_us >= p.begin_us && now_us < p.end_us; });
  }

  Bytes spoil(Bytes bytes) {
    const bool corrupt = happens(faults_.corrupt), truncate = happens(faults_.truncate);
    if (bytes.empty() || (!corrupt && !truncate)) return bytes;
    ++counters_.spoiled;
    if (corrupt) {
      const std::size_t bit = random_() % (bytes.size() * 8);
      bytes[bit / 8] = static_cast<std::uint8_t>(bytes[bit / 8] ^ (1u << (bit % 8)));
    }
    if (truncate) bytes.resize(random_() % bytes.size());
    return bytes;
  }

  std::mt19937 random_;
  RadioFaults faults_;
  RadioCounters counters_;
  std::multimap<TimeUs, Bytes> in_the_air_;  // by arrival; equal times keep their order
  TimeUs free_us_ = 0;
};

}  // namespace ivfm
