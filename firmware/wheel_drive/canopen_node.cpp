#include "firmware/wheel_drive/canopen_node.h"

namespace ivfm {

using canopen::ObjectKey;

Status SdoClient::start(const CanFrame& request, ObjectKey key, bool is_upload) {
  if (busy()) return Status::kFull;
  request_ = request;
  key_ = key;
  is_upload_ = is_upload;
  has_deadline_ = false;
  abort_code_ = 0;
  state_ = State::kQueued;
  return Status::kOk;
}

Status SdoClient::download(ObjectKey key, std::uint8_t size, std::uint32_t value) {
  if (size < 1 || size > 4) return Status::kInvalidArgument;
  return start(canopen::sdo_download_request(node_, key, size, value), key, false);
}

Status SdoClient::upload(ObjectKey key) {
  return start(canopen::sdo_upload_request(node_, key), key, true);
}

// An upload's answer, CiA 301 section 7.2.4.3.6: 0100 nnes; false if it is none.
bool SdoClient::take_upload(const CanFrame& frame) {
  const unsigned command = frame.data[0];
  if ((command & 0xe0u) != 0x40u) return false;
  if (!(command & 0x02u)) {  // not expedited: the server wants to send segments
    abort_ =
        canopen::sdo_abort_frame(canopen::kSdoRequestBase, node_, key_, canopen::kAbortOutOfMemory);
    abort_queued_ = true;
    finish(Status::kUnsupported);
    return true;
  }
  const unsigned unused = command & 0x01u ? (command >> 2) & 3u : 0u;
  value_size_ = static_cast<std::uint8_t>(4u - unused);
  value_ = canopen::get_u32(frame, 4) & (0xffffffffu >> (8 * unused));
  finish(Status::kOk);
  return true;
}

Status SdoClient::on_frame(const CanFrame& frame) {
  if (frame.remote || frame.size != 8) return Status::kCorrupt;
  const unsigned command = frame.data[0];
  const bool known = (command & 0xe0u) == 0x40u || command == 0x60u || command == 0x80u;
  if (!known) return Status::kCorrupt;
  if (state_ != State::kWaiting || canopen::sdo_key(frame) != key_) return Status::kEmpty;
  if (command == 0x80u) {
    abort_code_ = canopen::get_u32(frame, 4);
    finish(Status::kRefused);
    return Status::kOk;
  }
  if (is_upload_) return take_upload(frame) ? Status::kOk : Status::kEmpty;
  if (command != 0x60u) return Status::kEmpty;
  finish(Status::kOk);
  return Status::kOk;
}

void SdoClient::step(TimeUs now_us, CanBus& bus) {
  if (abort_queued_ && ok(bus.send(abort_))) abort_queued_ = false;
  if (!busy()) return;
  if (!has_deadline_) {
    has_deadline_ = true;
    deadline_us_ = now_us + timeout_us_;
  }
  if (state_ == State::kQueued && ok(bus.send(request_))) state_ = State::kWaiting;
  if (now_us < deadline_us_) return;
  if (state_ == State::kWaiting) {
    abort_ =
        canopen::sdo_abort_frame(canopen::kSdoRequestBase, node_, key_, canopen::kAbortTimeout);
    abort_queued_ = !ok(bus.send(abort_));
  }
  finish(Status::kTimeout);
}

bool CanopenNode::on_frame(const CanFrame& frame, TimeUs now_us) {
  if (frame.id == canopen::kHeartbeatBase + node_) {
    on_heartbeat(frame, now_us);
  } else if (frame.id == canopen::kEmergencyBase + node_) {
    on_emergency(frame);
  } else if (frame.id == canopen::kSdoResponseBase + node_) {
    const Status status = sdo_.on_frame(frame);
    counters_.malformed += status == Status::kCorrupt ? 1 : 0;
    counters_.stray_answers += status == Status::kEmpty ? 1 : 0;
  } else {
    return false;
  }
  return true;
}

void CanopenNode::on_heartbeat(const CanFrame& frame, TimeUs now_us) {
  // Bit 7 is the toggle bit of node guarding (remote requests): no heartbeat has it.
  const bool known = frame.data[0] == 0x00 || frame.data[0] == 0x04 || frame.data[0] == 0x05 ||
                     frame.data[0] == 0x7f;
  if (frame.remote || frame.size != 1 || !known) {
    ++counters_.malformed;
    return;
  }
  nmt_state_ = static_cast<canopen::NmtState>(frame.data[0]);
  last_heartbeat_us_ = now_us;
  if (nmt_state_ == canopen::NmtState::kBootUp) {
    boot_up_ = true;
    ++counters_.boot_ups;
  } else {
    ++counters_.heartbeats;
  }
}

void CanopenNode::on_emergency(const CanFrame& frame) {
  if (frame.remote || frame.size != 8) {
    ++counters_.malformed;
    return;
  }
  emergency_ = {canopen::get_u16(frame, 0), frame.data[2]};
  if (emergency_.error_code != 0) ++counters_.emergencies;
}

}  // namespace ivfm
