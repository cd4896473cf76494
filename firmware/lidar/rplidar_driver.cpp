#include "firmware/lidar/rplidar_driver.h"

#include <algorithm>

namespace ivfm {

const char* to_string(RplidarState state) {
  switch (state) {
    case RplidarState::kStopped: return "stopped";
    case RplidarState::kStopping: return "stopping";
    case RplidarState::kGettingInfo: return "getting info";
    case RplidarState::kGettingHealth: return "getting health";
    case RplidarState::kResetting: return "resetting";
    case RplidarState::kStarting: return "starting";
    case RplidarState::kScanning: return "scanning";
    case RplidarState::kWaiting: return "waiting";
  }
  return "unknown";
}

void RplidarDriver::start(TimeUs now_us) {
  if (state_ != RplidarState::kStopped) return;
  backoff_us_ = config_.min_backoff_us;
  begin_attempt(now_us);
}

void RplidarDriver::stop(TimeUs now_us) {
  request(rplidar::Request::kStop);
  note(port_.set_motor(false));
  scan_ready_ = false;
  enter(RplidarState::kStopped, now_us);
}

Status RplidarDriver::step(TimeUs now_us) {
  scan_ready_ = false;
  port_status_ = Status::kOk;
  note(read_port(now_us));
  check_deadline(now_us);
  return port_status_;
}

const Scan* RplidarDriver::take_scan() {
  if (!scan_ready_) return nullptr;
  scan_ready_ = false;
  return &scans_[1 - assembling_];
}

RplidarDriver::Counters RplidarDriver::counters() const {
  Counters counters = counters_;
  counters.resyncs = decoder_.counters().resyncs;
  counters.dropped_frames = decoder_.counters().dropped_frames;
  counters.skipped_bytes = decoder_.counters().skipped_bytes;
  return counters;
}

// kOk, or the port's error.
Status RplidarDriver::read_port(TimeUs now_us) {
  std::array<std::uint8_t, 256> chunk;
  for (std::size_t total = 0; total < kMaxBytesPerStep;) {
    const Result<std::size_t> got = port_.read(chunk);
    if (!got.ok()) return got.status();
    const std::size_t size = std::min(*got, chunk.size());
    counters_.bytes += size;
    total += size;
    // What comes before the line is quiet belongs to a scan that nobody wants any more.
    const bool listening = state_ != RplidarState::kStopped && state_ != RplidarState::kStopping &&
                           state_ != RplidarState::kWaiting;
    for (std::size_t i = 0; listening && i < size; ++i) {
      handle(decoder_.process(chunk[i]), now_us);
    }
    if (size < chunk.size()) break;
  }
  return Status::kOk;
}

void RplidarDriver::handle(RplidarDecoder::Event event, TimeUs now_us) {
  using Event = RplidarDecoder::Event;
  if (event == Event::kInfo && state_ == RplidarState::kGettingInfo) {
    request(rplidar::Request::kGetHealth);
    enter(RplidarState::kGettingHealth, now_us + config_.answer_timeout_us);
  } else if (event == Event::kHealth && state_ == RplidarState::kGettingHealth) {
    if (decoder_.health().level == RplidarHealth::kError) {
      ++counters_.resets;
      request(rplidar::Request::kReset);
      enter(RplidarState::kResetting, now_us + config_.reset_time_us);
    } else {
      start_scan(now_us);
    }
  } else if (event == Event::kSamples) {
    add_samples(now_us);
  }
}

void RplidarDriver::add_samples(TimeUs now_us) {
  if (state_ != RplidarState::kStarting && state_ != RplidarState::kScanning) return;
  enter(RplidarState::kScanning, now_us + config_.silence_timeout_us);
  for (const RplidarSample& sample : decoder_.samples()) {
    if (sample.starts_revolution) finish_revolution(now_us);
    if (!revolution_begun_ || !scans_[assembling_].push(to_point(sample))) {
      ++counters_.dropped_samples;
    }
  }
}

// Hands over the revolution just completed and begins the next one.
void RplidarDriver::finish_revolution(TimeUs now_us) {
  Scan& scan = scans_[assembling_];
  if (revolution_begun_ && scan.size >= kMinPointsPerScan) {
    assembling_ = static_cast<std::uint8_t>(1 - assembling_);
    scan_ready_ = true;
    ready_start_us_ = assembling_start_us_;
    ready_end_us_ = now_us;
    ++counters_.scans;
    backoff_us_ = config_.min_backoff_us;
  } else {
    counters_.dropped_samples += static_cast<std::uint32_t>(scan.size);
  }
  scans_[assembling_].clear();
  revolution_begun_ = true;
  assembling_start_us_ = now_us;
}

// The lidar counts degrees clockwise, REP 103 counter-clockwise. 65536 / (360 * 64) = 128 / 45.
ScanPoint RplidarDriver::to_point(const RplidarSample& sample) const {
  const auto clockwise = static_cast<std::uint16_t>(((sample.angle_q6 * 128 + 22) / 45) & 0xffff);
  const auto range_mm = static_cast<std::uint16_t>((sample.distance_q2 + 2) >> 2);
  const BinaryAngle bearing = config_.mounting_yaw - BinaryAngle(clockwise);
  if (sample.distance_q2 == 0 || range_mm < config_.min_range_mm ||
      range_mm > config_.max_range_mm) {
    return {bearing, 0, Echo::kNothing, sample.quality};
  }
  return {bearing, range_mm, Echo::kHit, sample.quality};
}

void RplidarDriver::check_deadline(TimeUs now_us) {
  if (state_ == RplidarState::kStopped || now_us < deadline_us_) return;
  switch (state_) {
    case RplidarState::kStopped: break;
    case RplidarState::kStopping:
      request(rplidar::Request::kGetInfo);
      enter(RplidarState::kGettingInfo, now_us + config_.answer_timeout_us);
      break;
    case RplidarState::kResetting:
    case RplidarState::kGettingInfo:
    case RplidarState::kGettingHealth:
    case RplidarState::kStarting:
    case RplidarState::kScanning: fail(now_us); break;
    case RplidarState::kWaiting:
      ++counters_.reconnects;
      begin_attempt(now_us);
      break;
  }
}

void RplidarDriver::begin_attempt(TimeUs now_us) {
  revolution_begun_ = false;
  scans_[assembling_].clear();
  request(rplidar::Request::kStop);
  enter(RplidarState::kStopping, now_us + kStopTimeUs);
}

void RplidarDriver::start_scan(TimeUs now_us) {
  note(port_.set_motor(true));
  express_ = config_.prefer_express && decoder_.info().has_express();
  if (express_) {
    // Working mode 0 is the legacy express scan with 84-byte capsules; the rest is reserved.
    const std::array<std::uint8_t, rplidar::kExpressPayloadSize> legacy_mode{};
    request(rplidar::Request::kExpressScan, legacy_mode);
  } else {
    request(rplidar::Request::kScan);
  }
  enter(RplidarState::kStarting, now_us + config_.first_sample_timeout_us);
}

void RplidarDriver::fail(TimeUs now_us) {
  enter(RplidarState::kWaiting, now_us + backoff_us_);
  backoff_us_ = std::min(backoff_us_ * 2, config_.max_backoff_us);
}

void RplidarDriver::enter(RplidarState state, TimeUs deadline_us) {
  state_ = state;
  deadline_us_ = deadline_us;
}

void RplidarDriver::request(rplidar::Request request, std::span<const std::uint8_t> payload) {
  std::array<std::uint8_t, 16> bytes;
  const Result<std::size_t> size = rplidar::encode_request(request, payload, bytes);
  if (!size.ok()) return note(size.status());
  decoder_.reset();
  note(port_.write({bytes.data(), *size}));
}

// Remembers the first error of a step.
void RplidarDriver::note(Status status) {
  if (ok(status)) return;
  ++counters_.port_errors;
  if (ok(port_status_)) port_status_ = status;
}

}  // namespace ivfm
