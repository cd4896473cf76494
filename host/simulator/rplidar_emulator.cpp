#include "host/simulator/rplidar_emulator.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>
#include <utility>

namespace ivfm::host {

namespace {

using rplidar::Configuration;
using rplidar::kFullTurnQ6;
using rplidar::Request;
using rplidar::Response;

constexpr TimeUs kMaxBacklogUs = 1'000'000;
constexpr TimeUs kRequestTimeoutUs = 500'000;  // a half request is forgotten after this
constexpr std::int32_t kMaxCompensationQ3 = 63;

// Scan modes in the words of the configuration requests.
constexpr std::uint16_t kExpressMode = 1, kModeCount = 2;  // mode 0 is the standard scan

std::uint16_t wrap_q6(std::int32_t angle_q6) {
  angle_q6 %= kFullTurnQ6;
  return static_cast<std::uint16_t>(angle_q6 < 0 ? angle_q6 + kFullTurnQ6 : angle_q6);
}

// Clockwise degrees * 64 of a counter-clockwise bearing: 360 * 64 / 65536 = 45 / 128.
std::uint16_t clockwise_q6(BinaryAngle bearing) {
  return wrap_q6(((-bearing).raw() * 45 + 64) / 128);
}

BinaryAngle bearing_of_q6(std::uint16_t angle_q6) {
  return -BinaryAngle(static_cast<std::uint16_t>(((angle_q6 * 128 + 22) / 45) & 0xffff));
}

void append_u16(std::vector<std::uint8_t>& bytes, std::uint16_t value) {
  bytes.push_back(static_cast<std::uint8_t>(value));
  bytes.push_back(static_cast<std::uint8_t>(value >> 8));
}

void append_u32(std::vector<std::uint8_t>& bytes, std::uint32_t value) {
  append_u16(bytes, static_cast<std::uint16_t>(value));
  append_u16(bytes, static_cast<std::uint16_t>(value >> 16));
}

RplidarSample to_sample(const ScanPoint& point, std::uint16_t angle_q6,
                        std::uint16_t max_range_mm) {
  const bool measured =
      point.echo == Echo::kHit && point.range_mm > 0 && point.range_mm <= max_range_mm;
  if (!measured) return {angle_q6, 0, 0, false};
  const auto distance_q2 = static_cast<std::uint16_t>(point.range_mm << 2);
  return {angle_q6, distance_q2, std::min<std::uint8_t>(point.quality, 63), false};
}

std::int32_t raw_angle_q6(std::size_t index, std::size_t count) {
  return static_cast<std::int32_t>((2 * index * kFullTurnQ6 + count) / (2 * count));
}

bool is_request(std::uint8_t command) {
  switch (static_cast<Request>(command)) {
    case Request::kScan:
    case Request::kForceScan:
    case Request::kStop:
    case Request::kReset:
    case Request::kGetInfo:
    case Request::kGetHealth:
    case Request::kGetSampleRate:
    case Request::kExpressScan:
    case Request::kGetConfiguration: return true;
  }
  return false;
}

}  // namespace

RplidarEmulator::RplidarEmulator(const RplidarEmulatorConfig& config) : config_(config) {
  // Distances travel as 16 bits of quarter millimetres.
  config_.max_range_mm = std::min<std::uint16_t>(config_.max_range_mm, 16383);
  config_.compensation_q3 = std::min<std::uint8_t>(config_.compensation_q3, kMaxCompensationQ3);
}

void RplidarEmulator::set_revolution(std::span<const ScanPoint> points) {
  fixed_points_.clear();
  for (const ScanPoint& point : points) {
    fixed_points_.push_back(to_sample(point, clockwise_q6(point.bearing), config_.max_range_mm));
  }
  std::stable_sort(fixed_points_.begin(), fixed_points_.end(),
                   [](const auto& a, const auto& b) { return a.angle_q6 < b.angle_q6; });
  has_points_ = true;
}

void RplidarEmulator::set_motor(bool on, TimeUs now_us) {
  if (on && !motor_on_) motor_since_us_ = now_us;
  motor_on_ = on;
}

void RplidarEmulator::set_health(RplidarHealth health, bool until_reset) {
  health_ = health;
  health_until_reset_ = until_reset;
  if (health.level == RplidarHealth::kError) mode_ = Mode::kIdle;
}

void RplidarEmulator::inject_garbage(std::size_t count, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<std::uint8_t> garbage(count);
  for (auto& byte : garbage) byte = static_cast<std::uint8_t>(random());
  send(garbage);
}

std::size_t RplidarEmulator::samples_per_revolution() const {
  const double samples = 1e6 / (config_.rotation_hz * sample_us());
  return static_cast<std::size_t>(std::clamp(std::lround(samples), 32l, 16384l));
}

// --- Requests ---

void RplidarEmulator::receive(std::span<const std::uint8_t> bytes, TimeUs now_us) {
  if (silent_ || (booting_ && now_us < boot_done_us_)) return;
  if (now_us - last_byte_us_ > kRequestTimeoutUs) parse_ = Parse::kSync;
  last_byte_us_ = now_us;
  for (const std::uint8_t byte : bytes) parse(byte, now_us);
}

void RplidarEmulator::parse(std::uint8_t byte, TimeUs now_us) {
  switch (parse_) {
    case Parse::kSync:
      if (byte == rplidar::kRequestSync) parse_ = Parse::kCommand;
      break;
    case Parse::kCommand:
      if (byte == rplidar::kRequestSync) break;
      command_ = byte;
      payload_.clear();
      parse_ = (byte & rplidar::kHasPayload) != 0 ? Parse::kLength : Parse::kSync;
      if (parse_ == Parse::kSync) execute(now_us);
      break;
    case Parse::kLength:
      payload_size_ = byte;
      parse_ = byte > 0 ? Parse::kPayload : Parse::kChecksum;
      break;
    case Parse::kPayload:
      payload_.push_back(byte);
      if (payload_.size() == payload_size_) parse_ = Parse::kChecksum;
      break;
    case Parse::kChecksum: {
      auto checksum = static_cast<std::uint8_t>(rplidar::kRequestSync ^ command_ ^ payload_size_);
      for (const std::uint8_t b : payload_) checksum ^= b;
      parse_ = Parse::kSync;
      if (byte == checksum) {
        execute(now_us);
      } else {
        reject();
      }
      break;
    }
  }
}

// A valid request ends a running scan (document, figures 4-8 and 4-14); an unknown one is ignored.
void RplidarEmulator::execute(TimeUs now_us) {
  ++counters_.requests;
  emit_samples(now_us);
  if (!is_request(command_)) return reject();
  mode_ = Mode::kIdle;
  switch (static_cast<Request>(command_)) {
    case Request::kStop: return;
    case Request::kReset: return begin_reset(now_us);
    case Request::kScan: return begin_scan(Mode::kStandard, false, now_us);
    case Request::kForceScan: return begin_scan(Mode::kStandard, true, now_us);
    case Request::kExpressScan:
      // Working modes beyond the legacy one (0; some hosts say 1) are not those of this device.
      if (!firmware_is_at_least(1, 17) || payload_.size() != rplidar::kExpressPayloadSize ||
          payload_[0] > kExpressMode) {
        return reject();
      }
      return begin_scan(Mode::kExpress, false, now_us);
    case Request::kGetInfo: return answer_info();
    case Request::kGetHealth: return answer_health();
    case Request::kGetSampleRate: return answer_sample_rate();
    case Request::kGetConfiguration: return answer_configuration();
  }
}

void RplidarEmulator::begin_scan(Mode mode, bool force, TimeUs now_us) {
  if (health_.level == RplidarHealth::kError) return reject();
  mode_ = mode;
  forced_ = force;
  if (!config_.motor_by_dtr) set_motor(true, now_us);
  const bool express = mode == Mode::kExpress;
  const std::uint32_t size = express ? rplidar::kCapsuleSize : rplidar::kNodeSize;
  const std::uint8_t descriptor[rplidar::kDescriptorSize] = {
      rplidar::kDescriptorSync1,
      rplidar::kDescriptorSync2,
      static_cast<std::uint8_t>(size),
      0,
      0,
      0x40,
      static_cast<std::uint8_t>(express ? Response::kCapsules : Response::kNodes)};
  send(descriptor);
  next_sample_us_ = now_us;
  first_capsule_ = true;
  capsule_.clear();
  begin_revolution(now_us);
  // The motor turns already; the scan joins in wherever it is.
  index_ = static_cast<std::size_t>(now_us / sample_us()) % revolution_.size();
}

void RplidarEmulator::begin_reset(TimeUs now_us) {
  if (health_until_reset_) health_ = {};
  outgoing_.clear();
  booting_ = true;
  boot_done_us_ = now_us + config_.boot_us;
}

bool RplidarEmulator::firmware_is_at_least(int major, int minor) const {
  const RplidarInfo& info = config_.info;
  return info.firmware_major > major ||
         (info.firmware_major == major && info.firmware_minor >= minor);
}

void RplidarEmulator::answer_info() {
  const RplidarInfo& info = config_.info;
  std::vector<std::uint8_t> payload = {info.model, info.firmware_minor, info.firmware_major,
                                       info.hardware};
  payload.insert(payload.end(), info.serial_number.begin(), info.serial_number.end());
  answer(Response::kInfo, payload);
}

void RplidarEmulator::answer_health() {
  std::vector<std::uint8_t> payload = {health_.level};
  append_u16(payload, health_.error_code);
  answer(Response::kHealth, payload);
}

void RplidarEmulator::answer_sample_rate() {
  if (!firmware_is_at_least(1, 17)) return reject();
  std::vector<std::uint8_t> payload;
  append_u16(payload, config_.standard_sample_us);
  append_u16(payload, config_.express_sample_us);
  answer(Response::kSampleRate, payload);
}

void RplidarEmulator::answer_configuration() {
  if (!firmware_is_at_least(1, 24) || payload_.size() < 4) return reject();
  const auto type = static_cast<Configuration>(rplidar::read_u32(payload_.data()));
  const std::uint16_t mode = payload_.size() >= 6 ? rplidar::read_u16(&payload_[4]) : 0;
  const bool needs_mode =
      type != Configuration::kScanModeCount && type != Configuration::kTypicalMode;
  if (needs_mode && mode >= kModeCount) return reject();
  std::vector<std::uint8_t> value;
  append_u32(value, static_cast<std::uint32_t>(type));
  const bool express = mode == kExpressMode;
  switch (type) {
    case Configuration::kScanModeCount: append_u16(value, kModeCount); break;
    case Configuration::kTypicalMode: append_u16(value, kExpressMode); break;
    case Configuration::kMicrosPerSample:
      append_u32(value,
                 static_cast<std::uint32_t>(
                     (express ? config_.express_sample_us : config_.standard_sample_us) << 8));
      break;
    case Configuration::kMaxDistance: append_u32(value, config_.max_range_mm * 256u / 1000u); break;
    case Configuration::kAnswerType:
      value.push_back(static_cast<std::uint8_t>(express ? Response::kCapsules : Response::kNodes));
      break;
    case Configuration::kScanModeName: {
      const std::string name = express ? "Express" : "Standard";
      value.insert(value.end(), name.c_str(), name.c_str() + name.size() + 1);
      break;
    }
    default: return reject();
  }
  answer(Response::kConfiguration, value);
}

void RplidarEmulator::answer(Response type, std::span<const std::uint8_t> payload, bool repeats) {
  std::vector<std::uint8_t> bytes = {rplidar::kDescriptorSync1, rplidar::kDescriptorSync2};
  append_u32(bytes, static_cast<std::uint32_t>(payload.size()) | (repeats ? 1u << 30 : 0u));
  bytes.push_back(static_cast<std::uint8_t>(type));
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  send(bytes);
}

void RplidarEmulator::send(std::span<const std::uint8_t> bytes) {
  if (silent_) return;
  const std::size_t dropped = std::min(bytes_to_drop_, bytes.size());
  bytes_to_drop_ -= dropped;
  bytes = bytes.subspan(dropped);
  outgoing_.insert(outgoing_.end(), bytes.begin(), bytes.end());
}

// --- Scans ---

std::vector<std::uint8_t> RplidarEmulator::transmit(TimeUs now_us) {
  if (booting_ && now_us >= boot_done_us_) {
    booting_ = false;
    char text[96];
    const RplidarInfo& info = config_.info;
    const int size =
        std::snprintf(text, sizeof text,
                      "RP LIDAR System.\r\nFirmware Ver %d.%02d - rtm, HW Ver %d\r\n"
                      "Model: %02x\r\n",
                      info.firmware_major, info.firmware_minor, info.hardware, info.model);
    send({reinterpret_cast<const std::uint8_t*>(text), static_cast<std::size_t>(size)});
  }
  emit_samples(now_us);
  return std::exchange(outgoing_, {});
}

bool RplidarEmulator::motor_runs(TimeUs now_us) const {
  return forced_ || (motor_on_ && now_us >= motor_since_us_ + config_.spin_up_us);
}

std::uint16_t RplidarEmulator::sample_us() const {
  return std::max<std::uint16_t>(
      mode_ == Mode::kExpress ? config_.express_sample_us : config_.standard_sample_us, 1);
}

void RplidarEmulator::emit_samples(TimeUs now_us) {
  if (mode_ == Mode::kIdle) return;
  if (!motor_runs(now_us)) {
    next_sample_us_ = now_us;
    return;
  }
  if (now_us > next_sample_us_ + kMaxBacklogUs) next_sample_us_ = now_us - kMaxBacklogUs;
  for (; next_sample_us_ <= now_us; next_sample_us_ += sample_us(), ++index_) {
    if (index_ >= revolution_.size()) begin_revolution(next_sample_us_);
    if (beam_source_ && index_ >= measured_) measure_due_beams(now_us);
    RplidarSample sample = revolution_[index_];
    sample.starts_revolution = index_ == 0;
    ++counters_.samples;
    if (mode_ == Mode::kStandard) {
      emit_node(sample);
    } else {
      add_to_capsule(sample, raw_angle_q6(index_, revolution_.size()));
    }
  }
}

void RplidarEmulator::begin_revolution(TimeUs start_us) {
  index_ = 0;
  ++counters_.revolutions;
  if (has_points_) {
    fill_from_points();
  } else {
    fill_from_source(start_us);
  }
}

void RplidarEmulator::fill_from_source(TimeUs start_us) {
  const std::size_t count = samples_per_revolution();
  const std::int32_t lag_q6 = mode_ == Mode::kExpress ? config_.compensation_q3 * 8 : 0;
  std::vector<ScanPoint> beams(count);
  revolution_.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    revolution_[i].angle_q6 = wrap_q6(raw_angle_q6(i, count) - lag_q6);
    beams[i].bearing = bearing_of_q6(revolution_[i].angle_q6);
  }
  measured_ = count;
  if (beam_source_) {
    beams_ = std::move(beams);
    measured_ = 0;
    return;
  }
  if (source_) source_(start_us, beams);
  for (std::size_t i = 0; i < count; ++i) {
    revolution_[i] = to_sample(beams[i], revolution_[i].angle_q6, config_.max_range_mm);
  }
}

void RplidarEmulator::measure_due_beams(TimeUs now_us) {
  const auto due = static_cast<std::size_t>((now_us - next_sample_us_) / sample_us()) + 1;
  const std::size_t end = std::min(index_ + due, beams_.size());
  beam_source_(now_us, std::span(beams_).subspan(index_, end - index_));
  for (measured_ = index_; measured_ < end; ++measured_) {
    revolution_[measured_] =
        to_sample(beams_[measured_], revolution_[measured_].angle_q6, config_.max_range_mm);
  }
}

void RplidarEmulator::fill_from_points() {
  measured_ = std::numeric_limits<std::size_t>::max();
  if (mode_ == Mode::kStandard && !fixed_points_.empty()) {
    revolution_ = fixed_points_;
    return;
  }
  const std::size_t count = samples_per_revolution();
  const std::int32_t lag_q6 = mode_ == Mode::kExpress ? config_.compensation_q3 * 8 : 0;
  const std::int32_t near_q6 = kFullTurnQ6 / static_cast<std::int32_t>(2 * count) + 1;
  const auto turn_between = [](std::int32_t a, std::int32_t b) {
    const std::int32_t way = std::abs(a - b);
    return std::min(way, kFullTurnQ6 - way);
  };
  revolution_.assign(count, {});
  for (std::size_t i = 0; i < count; ++i) {
    RplidarSample& sample = revolution_[i];
    sample.angle_q6 = wrap_q6(raw_angle_q6(i, count) - lag_q6);
    if (fixed_points_.empty()) continue;
    auto next = std::lower_bound(
        fixed_points_.begin(), fixed_points_.end(), sample.angle_q6,
        [](const RplidarSample& point, std::uint16_t angle) { return point.angle_q6 < angle; });
    const auto before = next == fixed_points_.begin() ? fixed_points_.end() - 1 : next - 1;
    if (next == fixed_points_.end()) next = fixed_points_.begin();
    const auto nearest = turn_between(next->angle_q6, sample.angle_q6) <
                                 turn_between(before->angle_q6, sample.angle_q6)
                             ? next
                             : before;
    if (turn_between(nearest->angle_q6, sample.angle_q6) <= near_q6) sample = *nearest;
  }
}

// Protocol document, figure 4-4.
void RplidarEmulator::emit_node(const RplidarSample& sample) {
  const auto flags = static_cast<std::uint8_t>(sample.starts_revolution ? 1 : 2);
  std::vector<std::uint8_t> node = {static_cast<std::uint8_t>(sample.quality << 2 | flags)};
  append_u16(node, static_cast<std::uint16_t>(sample.angle_q6 << 1 | 1));
  append_u16(node, sample.distance_q2);
  send(node);
}

void RplidarEmulator::add_to_capsule(const RplidarSample& sample, std::int32_t raw_q6) {
  if (capsule_.empty()) capsule_start_q6_ = raw_q6;
  std::int32_t lag_q6 = wrap_q6(raw_q6 - sample.angle_q6);
  if (lag_q6 > kFullTurnQ6 / 2) lag_q6 = 0;  // the wire cannot say that a sample runs ahead
  const std::int32_t lag_q3 = std::min((lag_q6 + 4) / 8, kMaxCompensationQ3);
  capsule_.push_back(
      {static_cast<std::uint16_t>(sample.distance_q2 >> 2), static_cast<std::uint8_t>(lag_q3)});
  if (capsule_.size() == rplidar::kSamplesPerCapsule) emit_capsule();
}

// Protocol document, figures 4-11 to 4-13. The S flag marks the first capsule of a scan.
void RplidarEmulator::emit_capsule() {
  std::vector<std::uint8_t> bytes(2);
  append_u16(bytes, static_cast<std::uint16_t>(capsule_start_q6_ | (first_capsule_ ? 0x8000 : 0)));
  for (std::size_t i = 0; i < capsule_.size(); i += 2) {
    const CapsuleSample& a = capsule_[i];
    const CapsuleSample& b = capsule_[i + 1];
    append_u16(bytes, static_cast<std::uint16_t>(a.distance_mm << 2 | a.compensation_q3 >> 4));
    append_u16(bytes, static_cast<std::uint16_t>(b.distance_mm << 2 | b.compensation_q3 >> 4));
    bytes.push_back(
        static_cast<std::uint8_t>((a.compensation_q3 & 0xf) | (b.compensation_q3 & 0xf) << 4));
  }
  std::uint8_t checksum = 0;
  for (std::size_t i = 2; i < bytes.size(); ++i) checksum ^= bytes[i];
  bytes[0] = static_cast<std::uint8_t>(0xa0 | (checksum & 0xf));
  bytes[1] = static_cast<std::uint8_t>(0x50 | (checksum >> 4));
  first_capsule_ = false;
  capsule_.clear();
  send(bytes);
}

}  // namespace ivfm::host
