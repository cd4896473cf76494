// Turns the bytes of an RPLIDAR into samples and answers, one byte at a time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/lidar/rplidar_protocol.h"

namespace ivfm {

// A state machine over a buffer of one frame. It first looks for a response descriptor that is
// known in every byte (type, length and mode), then reads what it announces: one answer, or an
// endless stream of nodes (standard scan) or capsules (express scan). A frame that contradicts
// itself is dropped byte by byte until the rest could be the start of a frame again, so that
// garbage costs at most the frames it touched. Announced lengths are compared with what the type
// allows and never used otherwise.
class RplidarDecoder {
 public:
  enum class Event : std::uint8_t {
    kNone,           // more bytes needed
    kScanStarted,    // a scan's descriptor; samples follow
    kSamples,        // samples() holds 1 .. 32 new ones
    kInfo,           // info()
    kHealth,         // health()
    kSampleRate,     // sample_rate()
    kConfiguration,  // configuration_type(), configuration_value()
  };

  struct Counters {
    std::uint32_t skipped_bytes = 0;   // belonged to no frame
    std::uint32_t dropped_frames = 0;  // bad checksum, impossible value or unknown descriptor
    std::uint32_t resyncs = 0;         // times the frame boundary of a stream was lost
  };

  // Takes the next byte; after any event but kNone the accessor named there is fresh.
  Event process(std::uint8_t byte);
  // Forgets the stream and waits for a descriptor: to be called with every request sent.
  void reset();

  // Valid until the next call of process().
  std::span<const RplidarSample> samples() const { return {samples_.data(), sample_count_}; }
  const RplidarInfo& info() const { return info_; }
  const RplidarHealth& health() const { return health_; }
  const RplidarSampleRate& sample_rate() const { return sample_rate_; }
  std::uint32_t configuration_type() const { return configuration_type_; }
  std::span<const std::uint8_t> configuration_value() const {
    return {configuration_.data(), configuration_size_};
  }
  const Counters& counters() const { return counters_; }

 private:
  enum class State : std::uint8_t { kDescriptor, kAnswer, kNodes, kCapsules };
  enum class Match : std::uint8_t { kIncomplete, kComplete, kImpossible };

  Match match_frame();
  Match match_descriptor();
  Match match_nodes();
  Match match_capsule();
  void drop_first_byte();
  void lose_sync();

  Event accept_frame();
  Event accept_descriptor();
  Event accept_answer();
  Event accept_nodes();
  Event accept_capsule();
  void decode_previous_capsule(std::int32_t sweep_q6);

  // A standard node has three check bits only: after a loss, this many in a row must fit.
  static constexpr std::size_t kNodesToConfirm = 5;

  State state_ = State::kDescriptor;
  rplidar::Response answer_type_ = rplidar::Response::kInfo;
  std::size_t answer_size_ = 0;
  bool in_sync_ = true;
  std::size_t size_ = 0;
  std::array<std::uint8_t, rplidar::kCapsuleSize> frame_{};

  bool has_last_angle_ = false;
  std::uint16_t last_angle_q6_ = 0;

  bool has_previous_capsule_ = false;
  std::int32_t previous_step_q16_ = 0;  // angle between samples of the capsule before; 0: unknown
  std::array<std::uint8_t, rplidar::kCapsuleSize> previous_capsule_{};

  std::array<RplidarSample, rplidar::kSamplesPerCapsule> samples_{};
  std::size_t sample_count_ = 0;
  RplidarInfo info_;
  RplidarHealth health_;
  RplidarSampleRate sample_rate_;
  std::uint32_t configuration_type_ = 0;
  std::size_t configuration_size_ = 0;
  std::array<std::uint8_t, rplidar::kMaxConfigurationSize> configuration_{};
  Counters counters_;
};

}  // namespace ivfm
