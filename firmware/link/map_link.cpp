#include "firmware/link/map_link.h"

#include <algorithm>
#include <limits>

namespace ivfm {
namespace {

constexpr CellRect kWireCells = {kMinCellNumber, kMinCellNumber, kMaxCellNumber - kMinCellNumber,
                                 kMaxCellNumber - kMinCellNumber};
constexpr std::int64_t kMicro = 1000000;
constexpr std::int64_t kMaxTokens =
    2 * static_cast<std::int64_t>(kMaxDatagramBytes + kUdpIpOverheadBytes) * kMicro;

constexpr std::size_t index_of(Layer layer) { return static_cast<std::size_t>(layer); }

}  // namespace

MapLink::MapLink(SharedMap& map, DatagramSocket& socket, const MapLinkConfig& config,
                 const DatagramSeal& seal)
    : map_(map),
      socket_(socket),
      config_(config),
      seal_(seal),
      window_(kWireCells),
      timeout_us_(config.retry_us),
      epoch_(config.epoch),
      rough_(config.rough),
      apart_(config.apart),
      frame_is_known_(!config.apart) {
  probe_.pending = true;
}

void MapLink::mark_dirty(Layer layer, const CellRect& rect) {
  const CellRect marked = rect.intersection(kWireCells);
  dirty_[index_of(layer)].add(marked);
  marked_[index_of(layer)] = marked_[index_of(layer)].united(marked);
}

void MapLink::clip(const CellRect& window) {
  const CellRect readable = window.intersection(kWireCells);
  if (readable == window_) return;
  window_ = readable;
  hello_ = {.pending = true};
  for (DirtyRectangles& dirty : dirty_) {
    counters_.cells_lost += static_cast<std::uint64_t>(dirty.clip(window_));
  }
}

void MapLink::step(TimeUs now_us, const Pose& pose) {
  refill_tokens(now_us);
  receive_all(now_us);
  expire(now_us);
  send_probe(now_us);
  if (!connected_) return;
  if (frame_is_known_) send_acknowledgement();
  send_hello(now_us);
  if (!frame_is_known_) return;
  send_restore_request(now_us);
  send_found(now_us, pose);
  send_status(now_us, pose);  // small and seldom: before maps, which may fill a slow radio for long
  send_map_updates(now_us, pose);
}

void MapLink::move_frame() {
  ++epoch_;
  moved_frame_ = true;
  frame_is_known_ = false;
  hello_ = {.pending = true};
  restore_request_ = {.pending = apart_};
  restore_from_ = {};
  apart_ = rough_ = false;
  in_flight_size_ = 0;
  for (DirtyRectangles& dirty : dirty_) dirty = {};
  marked_ = {};
}

void MapLink::end_rough() {
  rough_ = false;
  hello_ = {.pending = true};
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

std::optional<Pose> MapLink::take_frame() {
  const auto taken = frame_;
  frame_.reset();
  return taken;
}

bool MapLink::all_acknowledged() const {
  return connected_ && !has_dirty() && in_flight_size_ == 0 && !probe_.pending && !hello_.pending &&
         !restore_request_.pending && !found_.pending;
}

bool MapLink::is_acknowledged(Layer layer, const CellRect& rect) const {
  if (!welcomed_ || restore_request_.pending) return false;
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

void MapLink::handle(std::span<std::uint8_t> datagram, TimeUs now_us) {
  const auto robot = peek_robot(datagram);
  if (robot.ok() && *robot != config_.robot) {
    ++counters_.dropped_misdirected;
    return;
  }
  const auto opened = open_datagram(datagram, seal_, {true, config_.boot});
  if (!opened.ok() || !opened->bound) {
    const bool refused = opened.ok() || opened.status() == Status::kRefused;
    ++(refused ? counters_.dropped_refused : counters_.dropped_malformed);
    return;
  }
  if (!is_from_present_server(opened->header)) {
    ++counters_.dropped_stale;
    return;
  }
  if (!server_window_.take(opened->header.sequence)) {
    ++counters_.dropped_replayed;
    return;
  }
  last_heard_us_ = now_us;
  handle_body(*opened, now_us);
  if (connected_) probe_.pending = false;
}

// A server that has started again has a larger epoch and counts from 1 again; it has to welcome the
// robot before anything else is sent to it.
bool MapLink::is_from_present_server(const DatagramHeader& header) {
  if (header.epoch <= server_epoch_ && server_boot_ != 0) {
    return header.epoch == server_epoch_ && header.boot == server_boot_;
  }
  server_epoch_ = header.epoch;
  server_boot_ = header.boot;
  server_window_ = {};
  connected_ = false;
  frame_is_known_ = frame_is_known_ && !apart_;
  probe_.pending = true;
  newest_update_ = 0;
  newest_places_ = 0;
  command_revision_ = 0;
  taken_ = {};
  acknowledgement_due_ = false;
  return true;
}

void MapLink::handle_body(const OpenedDatagram& opened, TimeUs now_us) {
  const std::uint32_t sequence = opened.header.sequence;
  switch (opened.header.kind) {
    case MessageKind::kServerAcknowledgement: handle_acknowledgement(opened.body, now_us); break;
    case MessageKind::kServerMapUpdate: handle_map_update(sequence, opened.body); break;
    case MessageKind::kCommand: handle_command(sequence, opened.body); break;
    case MessageKind::kWelcome: handle_welcome(opened.body, now_us); break;
    case MessageKind::kRestore: handle_restore(opened.body, now_us); break;
    case MessageKind::kPlaces: handle_places(sequence, opened.body, now_us); break;
    case MessageKind::kMapFrame: handle_frame(opened.body); break;
    default: break;  // open_datagram() lets only the server's kinds through
  }
}

// The server is there: no need to be slow any more.
void MapLink::note_answer(TimeUs now_us) {
  last_answer_us_ = now_us;
  timeout_us_ = config_.retry_us;
  open_datagrams_allowed_ = std::min(2 * open_datagrams_allowed_, kMaxOpenDatagrams);
}

void MapLink::handle_acknowledgement(std::span<const std::uint8_t> body, TimeUs now_us) {
  const auto ack = decode_acknowledgement(body);
  if (!ack.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  for (std::size_t i = in_flight_size_; i-- > 0;) {
    if (ack->covers(in_flight_[i].sequence)) remove_in_flight(i);
  }
  for (Reliable* message : {&hello_, &found_}) {
    if (message->sequence != 0 && ack->covers(message->sequence)) message->pending = false;
  }
  frame_is_known_ = frame_is_known_ || !hello_.pending;
  note_answer(now_us);
}

void MapLink::handle_welcome(std::span<const std::uint8_t> body, TimeUs now_us) {
  const auto welcome = decode_welcome(body);
  if (!welcome.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  if (!probe_.pending) {  // nobody has asked
    ++counters_.dropped_stale;
    return;
  }
  note_answer(now_us);
  if (connected_) return;
  epoch_ = std::max(epoch_, welcome->epoch);
  connected_ = true;
  hello_ = {.pending = true};
  if (!welcomed_) {
    restore_request_.pending = welcome->has_cells;
  } else if (!welcome->knows_epoch) {  // a server that has lost what it once acknowledged
    for (std::size_t i = 0; i < kLayerCount; ++i) {
      dirty_[i].add(marked_[i].intersection(window_));
    }
  }
  welcomed_ = true;
}

void MapLink::handle_restore(std::span<const std::uint8_t> body, TimeUs now_us) {
  const auto header = decode_restore_header(body);
  if (!header.ok() || !has_right_cells(body.subspan(kRestoreHeaderBytes))) return;
  if (!restore_request_.pending || !(header->from == restore_from_)) {
    ++counters_.dropped_stale;
    return;
  }
  MapUpdateReader reader(body.subspan(kRestoreHeaderBytes));
  while (true) {
    const auto region = reader.next(cells_);
    if (!region.ok()) break;
    static_cast<void>(map_.restore_own(region->layer, region->rect, region->cells));
    counters_.cells_restored += static_cast<std::uint32_t>(region->cells.size());
  }
  restore_from_ = header->next;
  restore_request_ = {.pending = header->next.layer != RestoreCursor::kEnd};
  note_answer(now_us);
}

// Whether all regions can be read and have this map's cells; counted when not.
bool MapLink::has_right_cells(std::span<const std::uint8_t> map_update) {
  if (!ok(check_map_update(map_update, cells_))) {
    ++counters_.dropped_malformed;
    return false;
  }
  if (MapUpdateReader(map_update).cell_um() == config_.cell_um) return true;
  ++counters_.dropped_cell_size;
  return false;
}

void MapLink::handle_map_update(std::uint32_t sequence, std::span<const std::uint8_t> body) {
  if (!has_right_cells(body)) return;
  if (sequence <= newest_update_) {  // not acknowledged: its cells come again
    ++counters_.dropped_stale;
    return;
  }
  newest_update_ = sequence;
  MapUpdateReader reader(body);
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

void MapLink::handle_places(std::uint32_t sequence, std::span<const std::uint8_t> body,
                            TimeUs now_us) {
  const auto message = decode_robot_places(body);
  if (!message.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  if (sequence < newest_places_) {
    ++counters_.dropped_stale;
    return;
  }
  newest_places_ = sequence;
  peers_size_ = 0;
  for (const RobotPlace& place : message->places()) {
    const TimeUs age_us = std::min<TimeUs>(now_us, place.age_10ms * TimeUs{10'000});
    peers_[peers_size_++] = {{*um_from_float16(place.x), *um_from_float16(place.y)},
                             now_us - age_us};
  }
}

void MapLink::handle_frame(std::span<const std::uint8_t> body) {
  const auto message = decode_map_frame(body);
  if (!message.ok()) {
    ++counters_.dropped_malformed;
    return;
  }
  if (!(apart_ || rough_) || message->epoch != epoch_) {
    ++counters_.dropped_stale;
    return;
  }
  frame_ = message->frame;
}

void MapLink::note_taken(std::uint32_t sequence) {
  acknowledgement_due_ = true;
  taken_.take(sequence);
}

// --- What is on its way ------------------------------------------------------------------------

// What has waited too long for its acknowledgement becomes dirty again. Only when nothing at all
// was answered since is the server taken for silent, and the pace goes down.
void MapLink::expire(TimeUs now_us) {
  bool silent = false;
  for (std::size_t i = in_flight_size_; i-- > 0;) {
    if (now_us - in_flight_[i].sent_us < timeout_us_) continue;
    silent = silent || tells_silence(in_flight_[i].sent_us);
    ++counters_.retransmissions;
    requeue(i);
  }
  for (Reliable* message : {&probe_, &hello_, &restore_request_, &found_}) {
    if (!message->pending || message->sequence == 0) continue;
    if (now_us - message->sent_us < timeout_us_) continue;
    silent = silent || tells_silence(message->sent_us);
    message->sequence = 0;
  }
  if (silent) {
    timeout_us_ = std::min(2 * timeout_us_, config_.retry_max_us);
    open_datagrams_allowed_ = 1;
    backed_off_us_ = now_us;
  }
  // Perhaps another server is there now, which takes nothing before it has heard a hello.
  if (silent || now_us - last_heard_us_ >= config_.keepalive_us) probe_.pending = true;
}

bool MapLink::tells_silence(TimeUs sent_us) const {
  return sent_us >= last_answer_us_ && sent_us >= backed_off_us_;
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

Status MapLink::send(MessageKind kind, std::size_t body_size, std::uint64_t receiver_boot) {
  if (next_sequence_ == std::numeric_limits<std::uint32_t>::max()) return Status::kUnavailable;
  const DatagramHeader header{config_.robot, epoch_, next_sequence_++, config_.boot, kind};
  const auto size = seal_datagram(header, body_size, datagram_, seal_, receiver_boot);
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

void MapLink::send_acknowledgement() {
  if (!acknowledgement_due_) return;
  acknowledgement_due_ = false;
  const auto size = encode(Acknowledgement{taken_.newest(), taken_.earlier()}, body_of(datagram_));
  if (size.ok()) static_cast<void>(send(MessageKind::kAcknowledgement, *size, server_boot_));
}

bool MapLink::is_due(const Reliable& message) { return message.pending && message.sequence == 0; }

// A failure to send is like a loss on the way: the message is repeated after the time-out.
void MapLink::send_reliable(Reliable& message, MessageKind kind, std::size_t body_size,
                            TimeUs now_us, std::uint64_t receiver_boot) {
  message.sequence = next_sequence_;
  message.sent_us = now_us;
  static_cast<void>(send(kind, body_size, receiver_boot));
}

// The window for the server; empty when there is none, or none that the wire can tell.
CellRect MapLink::told_window() const {
  constexpr std::int32_t kMost = 0xffff;
  return window_.width <= kMost && window_.height <= kMost ? window_ : CellRect{};
}

std::size_t MapLink::write_hello() {
  Hello hello;
  hello.cell_um = config_.cell_um;
  hello.window = told_window();
  hello.resuming = welcomed_;
  hello.moved_frame = moved_frame_;
  hello.apart = apart_;
  hello.rough = rough_;
  hello.set_name(config_.name);
  return *encode(hello, body_of(datagram_));
}

void MapLink::send_probe(TimeUs now_us) {
  if (!is_due(probe_)) return;
  send_reliable(probe_, MessageKind::kHello, write_hello(), now_us, 0);
}

void MapLink::send_hello(TimeUs now_us) {
  if (!is_due(hello_)) return;
  send_reliable(hello_, MessageKind::kHello, write_hello(), now_us, server_boot_);
}

void MapLink::send_restore_request(TimeUs now_us) {
  if (!is_due(restore_request_)) return;
  RestoreRequest request;
  request.window = told_window();
  request.from = restore_from_;
  const std::size_t size = *encode(request, body_of(datagram_));
  send_reliable(restore_request_, MessageKind::kRestoreRequest, size, now_us, server_boot_);
}

void MapLink::send_found(TimeUs now_us, const Pose& pose) {
  if (!is_due(found_)) return;
  const auto size = encode(FoundReport{pack_pose(pose), found_target_}, body_of(datagram_));
  if (size.ok()) send_reliable(found_, MessageKind::kFound, *size, now_us, server_boot_);
}

void MapLink::send_status(TimeUs now_us, const Pose& pose) {
  if (config_.status_period_us == 0 || !may_send()) return;
  if (last_status_us_ && now_us - *last_status_us_ < config_.status_period_us) return;
  last_status_us_ = now_us;
  status_.pose = pack_pose(pose);
  status_.datagrams_sent = static_cast<std::uint32_t>(counters_.datagrams_sent);
  status_.retransmissions = counters_.retransmissions;
  const auto size = encode(status_, body_of(datagram_));
  if (size.ok()) static_cast<void>(send(MessageKind::kStatus, *size, server_boot_));
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
  if (restore_request_.pending) return;
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
  if (send(MessageKind::kMapUpdate, writer.size(), server_boot_) != Status::kFull) {
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
