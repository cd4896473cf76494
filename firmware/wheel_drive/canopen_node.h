// The master's view of one CANopen node: NMT, SDO client, heartbeat consumer, emergencies (CiA
// 301).
#pragma once

#include <cstdint>

#include "firmware/hal/can_bus.h"
#include "firmware/hal/clock.h"
#include "firmware/wheel_drive/canopen.h"

namespace ivfm {

// One expedited SDO transfer at a time with one server. Objects of up to 4 bytes; a server that
// wants a segmented transfer is answered with an abort.
class SdoClient {
 public:
  enum class State : std::uint8_t { kIdle, kQueued, kWaiting, kDone };

  SdoClient() = default;
  // `timeout_us`: how long the server may take to answer.
  SdoClient(std::uint8_t node_id, TimeUs timeout_us) : node_(node_id), timeout_us_(timeout_us) {}

  // Starts writing `size` (1 .. 4) bytes. kFull: a transfer is under way; kInvalidArgument: size.
  Status download(canopen::ObjectKey key, std::uint8_t size, std::uint32_t value);
  // Starts reading. kFull: a transfer is under way.
  Status upload(canopen::ObjectKey key);
  // Forgets the transfer under way, if any; a late answer is ignored.
  void cancel() { state_ = State::kIdle; }

  // Takes an answer of the server (identifier 580h + node). kOk: it belongs to the transfer under
  // way; kCorrupt: not an SDO answer; kEmpty: it answers nothing that was asked. Never fails the
  // transfer on the last two: the timeout does.
  Status on_frame(const CanFrame& frame);
  // Sends what is due and watches the timeout. The bus's refusals are retried until the timeout.
  void step(TimeUs now_us, CanBus& bus);

  State state() const { return state_; }
  bool busy() const { return state_ == State::kQueued || state_ == State::kWaiting; }
  // How the last transfer ended: kOk; kTimeout: no answer; kRefused: aborted by the server with
  // abort_code(); kUnsupported: the object needs a segmented transfer.
  Status status() const { return status_; }
  std::uint32_t abort_code() const { return abort_code_; }
  // What was read, little endian, zero extended.
  std::uint32_t value() const { return value_; }
  std::uint8_t value_size() const { return value_size_; }

 private:
  Status start(const CanFrame& request, canopen::ObjectKey key, bool is_upload);
  void finish(Status status) {
    status_ = status;
    state_ = State::kDone;
  }
  bool take_upload(const CanFrame& frame);

  std::uint8_t node_ = 1;
  TimeUs timeout_us_ = 0;
  State state_ = State::kIdle;
  Status status_ = Status::kEmpty;
  CanFrame request_;
  CanFrame abort_;
  bool abort_queued_ = false;
  canopen::ObjectKey key_;
  bool is_upload_ = false;
  bool has_deadline_ = false;
  TimeUs deadline_us_ = 0;
  std::uint32_t abort_code_ = 0;
  std::uint32_t value_ = 0;
  std::uint8_t value_size_ = 0;
};

// An emergency message (CiA 301 section 7.2.7).
struct Emergency {
  std::uint16_t error_code = 0;     // 0: error reset
  std::uint8_t error_register = 0;  // object 1001h
};

// What the master knows of one node.
class CanopenNode {
 public:
  struct Counters {
    std::uint32_t heartbeats = 0;
    std::uint32_t boot_ups = 0;
    std::uint32_t emergencies = 0;    // error resets not counted
    std::uint32_t malformed = 0;      // frames of this node with a wrong size or content
    std::uint32_t stray_answers = 0;  // SDO answers that nothing asked for
  };

  CanopenNode() = default;
  // `node_id` 1 .. 127.
  CanopenNode(std::uint8_t node_id, TimeUs sdo_timeout_us)
      : node_(node_id), sdo_(node_id, sdo_timeout_us) {}

  // Takes heartbeats, emergencies and SDO answers of this node; false for every other frame.
  bool on_frame(const CanFrame& frame, TimeUs now_us);
  // kFull, kUnavailable, kIoError of the bus.
  Status send_nmt(canopen::NmtCommand command, CanBus& bus) {
    return bus.send(canopen::nmt_frame(command, node_));
  }

  std::uint8_t node_id() const { return node_; }
  SdoClient& sdo() { return sdo_; }
  // True once after each boot-up message (700h + node, 00h).
  bool take_boot_up() {
    const bool seen = boot_up_;
    boot_up_ = false;
    return seen;
  }
  // The state of the last heartbeat; kBootUp before the first.
  canopen::NmtState nmt_state() const { return nmt_state_; }
  // When the last heartbeat or boot-up came; 0 before the first.
  TimeUs last_heartbeat_us() const { return last_heartbeat_us_; }
  const Emergency& last_emergency() const { return emergency_; }
  const Counters& counters() const { return counters_; }

 private:
  void on_heartbeat(const CanFrame& frame, TimeUs now_us);
  void on_emergency(const CanFrame& frame);

  std::uint8_t node_ = 1;
  SdoClient sdo_;
  bool boot_up_ = false;
  canopen::NmtState nmt_state_ = canopen::NmtState::kBootUp;
  TimeUs last_heartbeat_us_ = 0;
  Emergency emergency_;
  Counters counters_;
};

}  // namespace ivfm
