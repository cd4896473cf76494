#include "firmware/link/map_link.h"

#include <algorithm>

namespace ivfm {
namespace {

constexpr CellRect kWireCells = {kMinCellNumber, kMinCellNumber, kMaxCellNumber - kMinCellNumber,
                                 kMaxCellNumber - kMinCellNumber};
constexpr std::int64_t kMicro = 1000000;
constexpr std::int64_t kMaxTokens =
    2 * static_cast<std::int64_t>(kMaxDatagramBytes + kUdpIpOverheadBytes) * kMicro;

constexpr std::size_t index_of(Layer layer) { return static_cast<std::size_t>(layer); }

}  // namespace

MapLink::MapLink(SharedMap& map, DatagramSocket& socket, const MapLinkConfig& config)
    : map_(map),
      socket_(socket),
      config_(config),
      window_(kWireCells),
      timeout_us_(config.retry_us) {
  hello_.pending = true;
}

void MapLink::mark_dirty(Layer layer, const CellRect& rect) {
  dirty_[index_of(layer)].add(rect.intersection(kWireCells));
}

void MapLink::clip(const CellRect& window) {
  window_ = window.intersection(kWireCells);
  for (DirtyRectangles& dirty : dirty_) {
    counters_.cells_lost += static_cast<std::uint64_t>(dirty.clip(window_));
  }
}

void MapLink::step(TimeUs now_us, const Pose& pose) {
  refill_tokens(now_us);
  receive_all(now_us);
  expire(now_us);
  send_acknowledgement(now_us);
  send_hello(now_us);
  send_found(now_us, pose);
  send_map_updates(now_us, pose);
  send_status(now_us, pose);
}

void MapLink::report_found(Point target) {
  found_target_ = target;
  found_ = {.pending = true};
}

std::optional<CommandCode> MapLink::take_command() {
  const auto taken = command_;
  command_.reset();
  return taken;
}

bool MapLink::all_acknowledged() const {
  return !has_dirty() && in_flight_size_ == 0 && !hello_.pending && !found_.pending;
}

bool MapLink::is_acknowledged(Layer layer, const CellRect& rect) const {
  if (dirty_[index_of(layer)].intersects(rect)) return false;
  for (std::size_t i = 0; i < in_flight_size_; ++i) {
    const InFlight& sent = in_flight_[i];
    if (sent.layer == layer && !sent.rect.intersection(rect).empty()) return false;
  }
  return true;
}

// --- Receiving ---------------------------------------------------------------------------------

void MapLink::receive_all(TimeUs now_us) {
  for (int i = 0; i < kMaxReceivesPerStep; ++i) {
    const auto size = socket_.receive(datagram_);
    if (size.status() == Status::kTruncated) {
      ++counters_.dropped_malformed;
      continue;
    }
    if (!size.ok()) return;
    ++counters_.datagrams_received;
    counters_.bytes_received += *size + kUdpIpOverheadBytes;
    handle(std::span(datagram_).first(*size), now_us);
  }
}

void MapLink::handle(std::span<const std::uint8_t> datagram, TimeUs now_us) {
  const auto opened = open_datagram(datagram);
  if (!opened.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  const DatagramHeader& header = opened->header;
  if (header.robot != config_.robot || !is_from_server(header.kind)) {
    ++counters_.dropped_misdirected;
    return;
  }
  if (header.epoch < server_epoch_) {
    ++counters_.dropped_stale;
    return;
  }
  take_server_epoch(header.epoch);
  last_heard_us_ = now_us;
  if (header.kind == MessageKind::kServerAcknowledgement) {
    handle_acknowledgement(opened->body, now_us);
  } else if (header.kind == MessageKind::kServerMapUpdate) {
    handle_map_update(header.sequence, opened->body);
  } else {
    handle_command(header.sequence, opened->body);
  }
}

// A server that has started again counts from 1 again.
void MapLink::take_server_epoch(std::uint32_t epoch) {
  if (epoch == server_epoch_) return;
  server_epoch_ = epoch;
  newest_update_ = 0;
  command_revision_ = 0;
  taken_ = {.epoch = epoch};
  acknowledgement_due_ = false;
}

void MapLink::handle_acknowledgement(std::span<const std::uint8_t> body, TimeUs now_us) {
  const auto ack = decode_acknowledgement(body);
  if (!ack.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  if (ack->epoch != config_.epoch) {
    ++counters_.dropped_stale;
    return;
  }
  for (std::size_t i = in_flight_size_; i-- > 0;) {
    if (ack->covers(in_flight_[i].sequence)) remove_in_flight(i);
  }
  for (Reliable* message : {&hello_, &found_}) {
    if (message->sequence != 0 && ack->covers(message->sequence)) message->pending = false;
  }
  last_acknowledged_us_ = now_us;
  timeout_us_ = config_.retry_us;
  open_datagrams_allowed_ = std::min(2 * open_datagrams_allowed_, kMaxOpenDatagrams);
}

void MapLink::handle_map_update(std::uint32_t sequence, std::span<const std::uint8_t> body) {
  if (!ok(check_map_update(body, cells_))) {
    ++counters_.dropped_malformed;
    return;
  }
  MapUpdateReader reader(body);
  if (reader.cell_um() != config_.cell_um) {
    ++counters_.dropped_cell_size;
    return;
  }
  if (sequence <= newest_update_) {
    ++counters_.dropped_stale;
    // Its acknowledgement may have been lost; one that was never taken is not acknowledged.
    acknowledgement_due_ = acknowledgement_due_ || taken_.covers(sequence);
    return;
  }
  newest_update_ = sequence;
  while (true) {
    const auto region = reader.next(cells_);
    if (!region.ok()) break;
    // Its only errors are programming errors: the size fits, cells outside the window are ignored.
    static_cast<void>(map_.write_peers(region->layer, region->rect, region->cells));
    ++counters_.regions_received;
  }
  note_taken(sequence);
}

void MapLink::handle_command(std::uint32_t sequence, std::span<const std::uint8_t> body) {
  const auto command = decode_command(body);
  if (!command.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  note_taken(sequence);
  if (command->revision <= command_revision_) {
    ++counters_.dropped_stale;
    return;
  }
  command_revision_ = command->revision;
  command_ = command->code;
}

// Adds a sequence number to the next acknowledgement; one too old for its bitmap is left out.
void MapLink::note_taken(std::uint32_t sequence) {
  acknowledgement_due_ = true;
  if (sequence > taken_.newest) {
    const std::uint32_t shift = sequence - taken_.newest;
    const std::uint64_t previous = taken_.newest != 0 && shift <= 64 ? 1ull << (shift - 1) : 0;
    taken_.earlier = (shift < 64 ? taken_.earlier << shift : 0) | previous;
    taken_.newest = sequence;
  } else if (const std::uint32_t age = taken_.newest - sequence; age >= 1 && age <= 64) {
    taken_.earlier |= 1ull << (age - 1);
  }
}

// --- What is on its way ------------------------------------------------------------------------

// What has waited too long for its acknowledgement becomes dirty again. Only when nothing at all
// was acknowledged since is the server taken for silent, and the pace goes down.
void MapLink::expire(TimeUs now_us) {
  bool silent = false;
  for (std::size_t i = in_flight_size_; i-- > 0;) {
    const TimeUs sent_us = in_flight_[i].sent_us;
    if (now_us - sent_us < timeout_us_) continue;
    silent = silent || (sent_us >= last_acknowledged_us_ && sent_us >= backed_off_us_);
    ++counters_.retransmissions;
    requeue(i);
  }
  if (!silent) return;
  timeout_us_ = std::min(2 * timeout_us_, config_.retry_max_us);
  open_datagrams_allowed_ = 1;
  backed_off_us_ = now_us;
}

void MapLink::requeue(std::size_t index) {
  const InFlight sent = in_flight_[index];
  const CellRect readable = sent.rect.intersection(window_);
  counters_.cells_lost += static_cast<std::uint64_t>(sent.rect.area() - readable.area());
  dirty_[index_of(sent.layer)].add(readable);
  remove_in_flight(index);
}

void MapLink::remove_in_flight(std::size_t index) {
  for (std::size_t i = index + 1; i < in_flight_size_; ++i) in_flight_[i - 1] = in_flight_[i];
  --in_flight_size_;
}

std::uint32_t MapLink::open_datagrams() const {
  std::uint32_t count = 0;
  for (std::size_t i = 0; i < in_flight_size_; ++i) {
    // Regions of one datagram stand side by side.
    if (i == 0 || in_flight_[i].sequence != in_flight_[i - 1].sequence) ++count;
  }
  return count;
}

// --- Sending -----------------------------------------------------------------------------------

void MapLink::refill_tokens(TimeUs now_us) {
  if (config_.bytes_per_second == 0) return;
  const auto elapsed_us =
      static_cast<std::int64_t>(std::min<TimeUs>(now_us - refilled_us_, kMicro));
  refilled_us_ = now_us;
  tokens_ = std::min(tokens_ + elapsed_us * config_.bytes_per_second, kMaxTokens);
}

bool MapLink::may_send() const { return config_.bytes_per_second == 0 || tokens_ > 0; }

Status MapLink::send(MessageKind kind, std::size_t body_size) {
  const DatagramHeader header{config_.robot, config_.epoch, next_sequence_++, kind};
  const auto size = seal_datagram(header, body_size, datagram_);
  if (!size.ok()) return size.status();
  const Status status = socket_.send(std::span(datagram_).first(*size));
  if (!ok(status)) {
    ++counters_.send_failures;
    return status;
  }
  const std::size_t bytes = *size + kUdpIpOverheadBytes;
  ++counters_.datagrams_sent;
  counters_.bytes_sent += bytes;
  tokens_ -= static_cast<std::int64_t>(bytes) * kMicro;
  return Status::kOk;
}

void MapLink::send_acknowledgement(TimeUs) {
  if (!acknowledgement_due_) return;
  acknowledgement_due_ = false;
  const auto size = encode(taken_, body_of(datagram_));
  if (size.ok()) static_cast<void>(send(MessageKind::kAcknowledgement, *size));
}

bool MapLink::is_due(const Reliable& message, TimeUs now_us) const {
  if (!message.pending) return false;
  return message.sequence == 0 || now_us - message.sent_us >= timeout_us_;
}

// A failure to send is like a loss on the way: the message is repeated after the time-out.
void MapLink::send_reliable(Reliable& message, MessageKind kind, std::size_t body_size,
                            TimeUs now_us) {
  message.sequence = next_sequence_;
  message.sent_us = now_us;
  static_cast<void>(send(kind, body_size));
}

void MapLink::send_hello(TimeUs now_us) {
  if (!is_due(hello_, now_us)) return;
  Hello hello;
  hello.cell_um = config_.cell_um;
  hello.window_width = config_.window_width;
  hello.window_height = config_.window_height;
  hello.set_name(config_.name);
  const auto size = encode(hello, body_of(datagram_));
  if (size.ok()) send_reliable(hello_, MessageKind::kHello, *size, now_us);
}

void MapLink::send_found(TimeUs now_us, const Pose& pose) {
  if (!is_due(found_, now_us)) return;
  const auto size = encode(FoundReport{pack_pose(pose), found_target_}, body_of(datagram_));
  if (size.ok()) send_reliable(found_, MessageKind::kFound, *size, now_us);
}

void MapLink::send_status(TimeUs now_us, const Pose& pose) {
  if (config_.status_period_us == 0 || !may_send()) return;
  if (last_status_us_ && now_us - *last_status_us_ < config_.status_period_us) return;
  last_status_us_ = now_us;
  status_.pose = pack_pose(pose);
  status_.datagrams_sent = static_cast<std::uint32_t>(counters_.datagrams_sent);
  status_.retransmissions = counters_.retransmissions;
  const auto size = encode(status_, body_of(datagram_));
  if (size.ok()) static_cast<void>(send(MessageKind::kStatus, *size));
}

bool MapLink::has_dirty() const {
  return std::any_of(dirty_.begin(), dirty_.end(), [](const auto& d) { return !d.empty(); });
}

// A batch, once begun, goes on until nothing is dirty: over several steps when the radio is slow.
void MapLink::send_map_updates(TimeUs now_us, const Pose& pose) {
  if (!has_dirty()) {
    flush_ = false;
    return;
  }
  if (flush_ || !last_batch_us_ || now_us - *last_batch_us_ >= config_.batch_period_us) {
    batch_open_ = true;
    flush_ = false;
    last_batch_us_ = now_us;
  }
  if (!batch_open_) return;
  std::uint32_t open = open_datagrams();
  while (has_dirty() && open < open_datagrams_allowed_ && in_flight_size_ < kMaxInFlight &&
         may_send()) {
    if (!send_map_update(now_us, pose)) return;
    ++open;
  }
  batch_open_ = has_dirty();
}

// False when the socket takes nothing more now.
bool MapLink::send_map_update(TimeUs now_us, const Pose& pose) {
  MapUpdateWriter writer(body_of(datagram_), config_.cell_um, pack_pose(pose));
  const std::uint32_t sequence = next_sequence_;
  while (has_dirty() && add_region(writer, now_us)) {
  }
  if (writer.regions() == 0) return true;
  const auto regions = static_cast<std::uint32_t>(writer.regions());
  if (send(MessageKind::kMapUpdate, writer.size()) != Status::kFull) {
    counters_.regions_sent += regions;
    return true;
  }
  while (in_flight_size_ > 0 && in_flight_[in_flight_size_ - 1].sequence == sequence) {
    requeue(in_flight_size_ - 1);
  }
  return false;
}

// The layers take turns, region by region.
DirtyRectangles* MapLink::next_dirty_layer() {
  for (std::size_t i = 0; i < kLayerCount; ++i) {
    turn_ = (turn_ + 1) % kLayerCount;
    if (!dirty_[turn_].empty()) return &dirty_[turn_];
  }
  return nullptr;
}

// Moves one piece from dirty to in flight. False when the datagram is full.
bool MapLink::add_region(MapUpdateWriter& writer, TimeUs now_us) {
  if (in_flight_size_ == kMaxInFlight) return false;
  DirtyRectangles* const dirty = next_dirty_layer();
  if (dirty == nullptr) return false;
  const auto layer = static_cast<Layer>(turn_);
  auto max_area = static_cast<std::int32_t>(kMaxBlockCells);
  while (true) {
    const CellRect piece = dirty->next_piece(max_area, kMaxRegionSide);
    const auto cells = std::span(cells_).first(static_cast<std::size_t>(piece.area()));
    if (!ok(map_.read_own(layer, piece, cells))) {
      dirty->take(piece);
      counters_.cells_lost += cells.size();
      return true;
    }
    const Status status = writer.add(layer, piece, cells);
    if (status == Status::kFull && writer.regions() == 0) {
      max_area /= 2;  // 1,024 cells fit even raw
      continue;
    }
    if (!ok(status)) return false;
    dirty->take(piece);
    in_flight_[in_flight_size_++] = {layer, piece, next_sequence_, now_us};
    return true;
  }
}

}  // namespace ivfm
