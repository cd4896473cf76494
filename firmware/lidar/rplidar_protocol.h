// The RPLIDAR serial protocol: requests, response types and what the responses carry.
//
// Source: Slamtec, "RPLIDAR Interface Protocol and Application Notes" (A1 and A2, rev. 1.1), with
// the configuration requests of rplidar_sdk's rplidar_cmd.h. Little endian throughout.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/status/status.h"

namespace ivfm {

namespace rplidar {

inline constexpr std::uint8_t kRequestSync = 0xa5;
inline constexpr std::uint8_t kDescriptorSync1 = 0xa5;
inline constexpr std::uint8_t kDescriptorSync2 = 0x5a;
inline constexpr std::size_t kDescriptorSize = 7;
inline constexpr std::uint8_t kHasPayload = 0x80;  // bit of a request's command byte

// Requests; those with bit 7 carry a payload.
enum class Request : std::uint8_t {
  kScan = 0x20,
  kForceScan = 0x21,
  kStop = 0x25,
  kReset = 0x40,
  kGetInfo = 0x50,
  kGetHealth = 0x52,
  kGetSampleRate = 0x59,
  kExpressScan = 0x82,
  kGetConfiguration = 0x84,
};

// Response types (last byte of a descriptor).
enum class Response : std::uint8_t {
  kInfo = 0x04,
  kHealth = 0x06,
  kSampleRate = 0x15,
  kConfiguration = 0x20,
  kNodes = 0x81,
  kCapsules = 0x82,
};

inline constexpr std::size_t kInfoSize = 20;
inline constexpr std::size_t kHealthSize = 3;
inline constexpr std::size_t kSampleRateSize = 4;
inline constexpr std::size_t kNodeSize = 5;
inline constexpr std::size_t kCapsuleSize = 84;
inline constexpr std::size_t kCabinsPerCapsule = 16;
inline constexpr std::size_t kSamplesPerCapsule = 32;
inline constexpr std::size_t kExpressPayloadSize = 5;
inline constexpr std::size_t kMaxConfigurationSize = 64;  // type and value, as we accept it

inline constexpr std::int32_t kFullTurnQ6 = 360 * 64;  // a turn in 64ths of a degree

// Entries of kGetConfiguration (rplidar_cmd.h, RPLIDAR_CONF_*).
enum class Configuration : std::uint32_t {
  kScanModeCount = 0x70,    // u16
  kMicrosPerSample = 0x71,  // u32, Q8; argument: u16 mode
  kMaxDistance = 0x74,      // u32, Q8 metres; argument: u16 mode
  kAnswerType = 0x75,       // u8; argument: u16 mode
  kTypicalMode = 0x7c,      // u16
  kScanModeName = 0x7f,     // zero-terminated text; argument: u16 mode
};

constexpr std::uint16_t read_u16(const std::uint8_t* bytes) {
  return static_cast<std::uint16_t>(bytes[0] | (bytes[1] << 8));
}

constexpr std::uint32_t read_u32(const std::uint8_t* bytes) {
  return read_u16(bytes) | (static_cast<std::uint32_t>(read_u16(bytes + 2)) << 16);
}

// Writes a request into `out`: sync, command and, for commands with a payload, its length, the
// payload and the XOR of everything before. Returns the number of bytes.
// kInvalidArgument: a payload where the command has none, or the other way round, or one of more
// than 255 bytes; kFull: `out` is too small.
constexpr Result<std::size_t> encode_request(Request request, std::span<const std::uint8_t> payload,
                                             std::span<std::uint8_t> out) {
  const auto command = static_cast<std::uint8_t>(request);
  const bool has_payload = (command & kHasPayload) != 0;
  if (has_payload == payload.empty() || payload.size() > 255) return Status::kInvalidArgument;
  const std::size_t size = has_payload ? payload.size() + 4 : 2;
  if (out.size() < size) return Status::kFull;
  out[0] = kRequestSync;
  out[1] = command;
  if (!has_payload) return size;
  out[2] = static_cast<std::uint8_t>(payload.size());
  std::uint8_t checksum = static_cast<std::uint8_t>(out[0] ^ out[1] ^ out[2]);
  for (std::size_t i = 0; i < payload.size(); ++i) {
    out[3 + i] = payload[i];
    checksum = static_cast<std::uint8_t>(checksum ^ payload[i]);
  }
  out[size - 1] = checksum;
  return size;
}

}  // namespace rplidar

// What GET_INFO answers.
struct RplidarInfo {
  std::uint8_t model = 0;
  std::uint8_t firmware_major = 0;
  std::uint8_t firmware_minor = 0;
  std::uint8_t hardware = 0;
  std::array<std::uint8_t, 16> serial_number{};
  constexpr bool operator==(const RplidarInfo&) const = default;
  // EXPRESS_SCAN came with firmware 1.17.
  constexpr bool has_express() const {
    return firmware_major > 1 || (firmware_major == 1 && firmware_minor >= 17);
  }
};

// What GET_HEALTH answers.
struct RplidarHealth {
  enum Level : std::uint8_t { kGood = 0, kWarning = 1, kError = 2 };
  Level level = kGood;
  std::uint16_t error_code = 0;
  constexpr bool operator==(const RplidarHealth&) const = default;
};

// What GET_SAMPLERATE answers: microseconds between two samples.
struct RplidarSampleRate {
  std::uint16_t standard_us = 0;
  std::uint16_t express_us = 0;
  constexpr bool operator==(const RplidarSampleRate&) const = default;
};

// One range sample in the lidar's own frame.
struct RplidarSample {
  std::uint16_t angle_q6 = 0;     // clockwise from the lidar's zero, degrees * 64, 0 .. 23039
  std::uint16_t distance_q2 = 0;  // mm * 4; 0: nothing measured
  std::uint8_t quality = 0;       // 0 .. 63
  bool starts_revolution = false;
  constexpr bool operator==(const RplidarSample&) const = default;
};

}  // namespace ivfm
