#include "firmware/lidar/rplidar_decoder.h"

#include <algorithm>

namespace ivfm {

namespace {

using rplidar::kCapsuleSize;
using rplidar::kFullTurnQ6;
using rplidar::kNodeSize;
using rplidar::read_u16;
using rplidar::read_u32;
using rplidar::Response;

constexpr std::uint8_t kExpressQuality = 47;      // capsules carry none; Slamtec's SDK says 0x2f
constexpr std::int32_t kAngleSlackQ6 = 10 * 64;   // devices report slightly more than a full turn
constexpr std::int32_t kMaxNodeStepQ6 = 45 * 64;  // between two nodes in a row, either way
constexpr std::int32_t kMaxCapsuleSweepQ6 = 90 * 64;  // of one capsule: 31 Hz at 4,000 samples/s

constexpr std::uint16_t wrap_q6(std::int32_t angle_q6) {
  angle_q6 %= kFullTurnQ6;
  return static_cast<std::uint16_t>(angle_q6 < 0 ? angle_q6 + kFullTurnQ6 : angle_q6);
}

// The smaller of the two ways around, 0 .. half a turn.
constexpr std::int32_t distance_q6(std::uint16_t a, std::uint16_t b) {
  const std::int32_t way = a > b ? a - b : b - a;
  return std::min(way, kFullTurnQ6 - way);
}

// Protocol document, figure 4-4: start bit and its inverse, check bit, and an angle in range.
constexpr bool is_node(const std::uint8_t* b) {
  const bool start_bits = ((b[0] ^ (b[0] >> 1)) & 1) != 0;
  return start_bits && (b[1] & 1) != 0 && (read_u16(b + 1) >> 1) < kFullTurnQ6 + kAngleSlackQ6;
}

constexpr RplidarSample parse_node(const std::uint8_t* b) {
  return {wrap_q6(read_u16(b + 1) >> 1), read_u16(b + 3), static_cast<std::uint8_t>(b[0] >> 2),
          (b[0] & 1) != 0};
}

// The payload size that a descriptor of this type, mode and length announces; 0: impossible.
constexpr std::size_t announced_size(Response type, bool repeats, std::uint32_t length) {
  switch (type) {
    case Response::kInfo: return !repeats && length == rplidar::kInfoSize ? length : 0;
    case Response::kHealth: return !repeats && length == rplidar::kHealthSize ? length : 0;
    case Response::kSampleRate: return !repeats && length == rplidar::kSampleRateSize ? length : 0;
    case Response::kConfiguration:
      return !repeats && length >= 4 && length <= rplidar::kMaxConfigurationSize ? length : 0;
    case Response::kNodes: return repeats && length == kNodeSize ? length : 0;
    case Response::kCapsules: return repeats && length == kCapsuleSize ? length : 0;
  }
  return 0;
}

struct Descriptor {
  Response type;
  std::size_t size;
};

// Section "Response packets' format": 30 bits of length, 2 bits of mode (1: repeats), type.
constexpr Descriptor parse_descriptor(const std::uint8_t* b) {
  const std::uint32_t length_and_mode = read_u32(b + 2);
  const std::uint32_t mode = length_and_mode >> 30;
  const auto type = static_cast<Response>(b[6]);
  if (mode > 1) return {type, 0};
  return {type, announced_size(type, mode == 1, length_and_mode & 0x3fffffffu)};
}

}  // namespace

RplidarDecoder::Event RplidarDecoder::process(std::uint8_t byte) {
  sample_count_ = 0;
  frame_[size_++] = byte;
  while (size_ > 0) {
    switch (match_frame()) {
      case Match::kIncomplete: return Event::kNone;
      case Match::kComplete: return accept_frame();
      case Match::kImpossible: drop_first_byte();
    }
  }
  return Event::kNone;
}

void RplidarDecoder::reset() {
  state_ = State::kDescriptor;
  size_ = 0;
  sample_count_ = 0;
  in_sync_ = true;
  has_last_angle_ = false;
  has_previous_capsule_ = false;
  previous_step_q16_ = 0;
}

RplidarDecoder::Match RplidarDecoder::match_frame() {
  switch (state_) {
    case State::kDescriptor: return match_descriptor();
    case State::kAnswer: return size_ == answer_size_ ? Match::kComplete : Match::kIncomplete;
    case State::kNodes: return match_nodes();
    case State::kCapsules: return match_capsule();
  }
  return Match::kImpossible;
}

RplidarDecoder::Match RplidarDecoder::match_descriptor() {
  if (frame_[0] != rplidar::kDescriptorSync1) return Match::kImpossible;
  if (size_ >= 2 && frame_[1] != rplidar::kDescriptorSync2) return Match::kImpossible;
  if (size_ < rplidar::kDescriptorSize) return Match::kIncomplete;
  if (parse_descriptor(frame_.data()).size != 0) return Match::kComplete;
  ++counters_.dropped_frames;
  return Match::kImpossible;
}

// In step with the stream one node is enough, out of step several must agree. A jump of the angle
// may be a gap in the bytes or a false node: the nodes after it decide.
RplidarDecoder::Match RplidarDecoder::match_nodes() {
  std::uint16_t last = last_angle_q6_;
  bool has_last = in_sync_ && has_last_angle_;
  for (std::size_t i = 0; i + kNodeSize <= size_; i += kNodeSize) {
    if (!is_node(&frame_[i])) return Match::kImpossible;
    const std::uint16_t angle = parse_node(&frame_[i]).angle_q6;
    if (has_last && distance_q6(angle, last) > kMaxNodeStepQ6) {
      if (!in_sync_) return Match::kImpossible;
      lose_sync();
    }
    last = angle;
    has_last = true;
  }
  const std::size_t wanted = in_sync_ ? 1 : kNodesToConfirm;
  return size_ == wanted * kNodeSize ? Match::kComplete : Match::kIncomplete;
}

RplidarDecoder::Match RplidarDecoder::match_capsule() {
  if (frame_[0] >> 4 != 0xa) return Match::kImpossible;
  if (size_ >= 2 && frame_[1] >> 4 != 0x5) return Match::kImpossible;
  if (size_ < kCapsuleSize) return Match::kIncomplete;
  std::uint8_t checksum = 0;
  for (std::size_t i = 2; i < kCapsuleSize; ++i) {
    checksum = static_cast<std::uint8_t>(checksum ^ frame_[i]);
  }
  const auto expected = static_cast<std::uint8_t>((frame_[0] & 0xf) | (frame_[1] << 4));
  const bool angle_possible = (read_u16(&frame_[2]) & 0x7fff) < kFullTurnQ6;
  if (checksum == expected && angle_possible) return Match::kComplete;
  ++counters_.dropped_frames;
  return Match::kImpossible;
}

void RplidarDecoder::drop_first_byte() {
  if (in_sync_ && state_ != State::kDescriptor) lose_sync();
  ++counters_.skipped_bytes;
  --size_;
  std::copy_n(frame_.begin() + 1, size_, frame_.begin());
}

void RplidarDecoder::lose_sync() {
  ++counters_.resyncs;
  in_sync_ = false;
  has_last_angle_ = false;
  has_previous_capsule_ = false;
  previous_step_q16_ = 0;
}

RplidarDecoder::Event RplidarDecoder::accept_frame() {
  Event event = Event::kNone;
  switch (state_) {
    case State::kDescriptor: event = accept_descriptor(); break;
    case State::kAnswer: event = accept_answer(); break;
    case State::kNodes: event = accept_nodes(); break;
    case State::kCapsules: event = accept_capsule(); break;
  }
  size_ = 0;
  return event;
}

RplidarDecoder::Event RplidarDecoder::accept_descriptor() {
  const Descriptor descriptor = parse_descriptor(frame_.data());
  reset();
  if (descriptor.type == Response::kNodes || descriptor.type == Response::kCapsules) {
    state_ = descriptor.type == Response::kNodes ? State::kNodes : State::kCapsules;
    return Event::kScanStarted;
  }
  state_ = State::kAnswer;
  answer_type_ = descriptor.type;
  answer_size_ = descriptor.size;
  return Event::kNone;
}

RplidarDecoder::Event RplidarDecoder::accept_answer() {
  state_ = State::kDescriptor;
  const std::uint8_t* b = frame_.data();
  switch (answer_type_) {
    case Response::kInfo:
      info_ = {b[0], b[2], b[1], b[3], {}};
      std::copy_n(b + 4, info_.serial_number.size(), info_.serial_number.begin());
      return Event::kInfo;
    case Response::kHealth:
      if (b[0] > RplidarHealth::kError) break;
      health_ = {static_cast<RplidarHealth::Level>(b[0]), read_u16(b + 1)};
      return Event::kHealth;
    case Response::kSampleRate:
      sample_rate_ = {read_u16(b), read_u16(b + 2)};
      return Event::kSampleRate;
    case Response::kConfiguration:
      configuration_type_ = read_u32(b);
      configuration_size_ = answer_size_ - 4;
      std::copy_n(b + 4, configuration_size_, configuration_.begin());
      return Event::kConfiguration;
    case Response::kNodes:
    case Response::kCapsules: break;
  }
  ++counters_.dropped_frames;
  return Event::kNone;
}

RplidarDecoder::Event RplidarDecoder::accept_nodes() {
  for (std::size_t i = 0; i < size_; i += kNodeSize) {
    samples_[sample_count_++] = parse_node(&frame_[i]);
  }
  last_angle_q6_ = samples_[sample_count_ - 1].angle_q6;
  has_last_angle_ = true;
  in_sync_ = true;
  return Event::kSamples;
}

// The samples of a capsule lie between its own start angle and the next one's, so it is decoded
// when the next arrives. The S flag says that the angles begin anew.
RplidarDecoder::Event RplidarDecoder::accept_capsule() {
  const std::uint16_t flag_and_start = read_u16(&frame_[2]);
  const bool begins_anew = (flag_and_start & 0x8000) != 0;
  if (has_previous_capsule_ && !begins_anew) {
    const std::int32_t start_q6 = flag_and_start & 0x7fff;
    const std::int32_t previous_q6 = read_u16(&previous_capsule_[2]) & 0x7fff;
    const std::int32_t sweep_q6 = wrap_q6(start_q6 - previous_q6);
    if (sweep_q6 <= kMaxCapsuleSweepQ6) {
      decode_previous_capsule(sweep_q6);
    } else {
      ++counters_.dropped_frames;
      previous_step_q16_ = 0;
    }
  } else {
    previous_step_q16_ = 0;
  }
  previous_capsule_ = frame_;
  has_previous_capsule_ = true;
  in_sync_ = true;
  return sample_count_ > 0 ? Event::kSamples : Event::kNone;
}

// Cabin: 14 bits of distance in mm twice, each with the two high bits of its angle compensation
// (Q3 degrees), then the two low nibbles. The document calls the top bit of the compensation a
// sign; Slamtec's SDK takes all six as a magnitude that lags behind the raw angle, and so do we.
// A revolution starts where the raw angle passes zero (document, footnote to figure 4-14).
void RplidarDecoder::decode_previous_capsule(std::int32_t sweep_q6) {
  constexpr std::int32_t kFullTurnQ16 = 360 << 16;
  const std::int32_t step_q16 = (sweep_q6 << 10) / static_cast<std::int32_t>(samples_.size());
  std::int32_t raw_q16 = (read_u16(&previous_capsule_[2]) & 0x7fff) << 10;
  std::int32_t step_before_q16 = previous_step_q16_ > 0 ? previous_step_q16_ : step_q16;
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    const std::uint8_t* cabin = &previous_capsule_[4 + 5 * (k / 2)];
    const std::uint16_t distance = read_u16(cabin + 2 * (k % 2));
    const int low_bits = k % 2 == 0 ? cabin[4] & 0xf : cabin[4] >> 4;
    const std::int32_t compensation_q3 = low_bits | ((distance & 0x3) << 4);
    const auto distance_q2 = static_cast<std::uint16_t>(distance & 0xfffc);
    if (raw_q16 >= kFullTurnQ16) raw_q16 -= kFullTurnQ16;
    samples_[sample_count_++] = {wrap_q6((raw_q16 - (compensation_q3 << 13)) >> 10), distance_q2,
                                 distance_q2 == 0 ? std::uint8_t{0} : kExpressQuality,
                                 raw_q16 < step_before_q16};
    raw_q16 += step_q16;
    step_before_q16 = step_q16;
  }
  previous_step_q16_ = step_q16;
}

}  // namespace ivfm
