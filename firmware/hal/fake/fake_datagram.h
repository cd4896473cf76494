// A faulty radio in memory: two DatagramSocket ends with a FaultyChannel each way.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>

#include "firmware/hal/datagram_socket.h"
#include "firmware/hal/fake/faulty_channel.h"

namespace ivfm {

// For tests; uses the heap. Set the time with set_now(); the same seed gives the same faults.
class FakeRadio {
 public:
  class End final : public DatagramSocket {
   public:
    Result<std::size_t> receive(std::span<std::uint8_t> buffer) override {
      const auto bytes = in_.receive(radio_.now_us_);
      if (!bytes) return Status::kEmpty;
      if (bytes->size() > buffer.size()) return Status::kTruncated;
      std::copy(bytes->begin(), bytes->end(), buffer.begin());
      return bytes->size();
    }
    Status send(std::span<const std::uint8_t> datagram) override {
      if (!ok(radio_.send_status_)) return radio_.send_status_;
      radio_.largest_ = std::max(radio_.largest_, datagram.size());
      out_.send(datagram, radio_.now_us_);
      return Status::kOk;
    }

   private:
    friend class FakeRadio;
    End(FakeRadio& radio, FaultyChannel& in, FaultyChannel& out)
        : radio_(radio), in_(in), out_(out) {}
    FakeRadio& radio_;
    FaultyChannel& in_;
    FaultyChannel& out_;
  };

  explicit FakeRadio(std::uint32_t seed, RadioFaults faults = {})
      : faults_(std::move(faults)),
        to_server_(2 * seed, faults_),
        to_robot_(2 * seed + 1, faults_) {}
  FakeRadio(const FakeRadio&) = delete;
  FakeRadio& operator=(const FakeRadio&) = delete;

  DatagramSocket& robot() { return robot_; }
  DatagramSocket& server() { return server_; }
  void set_now(TimeUs now_us) { now_us_ = now_us; }
  void set_faults(RadioFaults faults) {
    faults_ = std::move(faults);
    to_server_.set_faults(faults_);
    to_robot_.set_faults(faults_);
  }
  // While true, nothing sent arrives.
  void set_partitioned(bool partitioned) {
    faults_.partitions.clear();
    if (partitioned) faults_.partitions.push_back({0, std::numeric_limits<TimeUs>::max()});
    set_faults(faults_);
  }
  // What the ends answer to send(); kOk: they work.
  void set_send_status(Status status) { send_status_ = status; }
  std::size_t largest_datagram() const { return largest_; }
  std::uint64_t sent() const { return counters().sent; }
  RadioCounters counters() const {
    RadioCounters sum = to_server_.counters();
    return sum += to_robot_.counters();
  }

 private:
  RadioFaults faults_;
  FaultyChannel to_server_, to_robot_;
  TimeUs now_us_ = 0;
  Status send_status_ = Status::kOk;
  std::size_t largest_ = 0;
  End robot_{*this, to_robot_, to_server_};
  End server_{*this, to_server_, to_robot_};
};

}  // namespace ivfm
