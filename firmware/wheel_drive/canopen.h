// CANopen (CiA 301) on the wire: identifiers, NMT, SYNC, heartbeat, EMCY and expedited SDO frames.
#pragma once

#include <cstdint>

#include "firmware/hal/can_bus.h"

namespace ivfm::canopen {

// The predefined connection set, CiA 301 section 7.3.3. A node's frames carry base + node id.
inline constexpr std::uint16_t kNmtId = 0x000;
inline constexpr std::uint16_t kSyncId = 0x080;
inline constexpr std::uint16_t kEmergencyBase = 0x080;
inline constexpr std::uint16_t kTpdo1Base = 0x180;
inline constexpr std::uint16_t kRpdo1Base = 0x200;
inline constexpr std::uint16_t kTpdo2Base = 0x280;
inline constexpr std::uint16_t kTpdo3Base = 0x380;
inline constexpr std::uint16_t kTpdo4Base = 0x480;
inline constexpr std::uint16_t kSdoResponseBase = 0x580;  // server to client
inline constexpr std::uint16_t kSdoRequestBase = 0x600;   // client to server
inline constexpr std::uint16_t kHeartbeatBase = 0x700;
inline constexpr std::uint8_t kMaxNodeId = 127;

// Bits of a PDO's COB-ID object (1400h.01h, 1800h.01h), CiA 301 section 7.5.2.35.
inline constexpr std::uint32_t kPdoInvalid = 0x80000000;
inline constexpr std::uint32_t kPdoNoRemoteRequest = 0x40000000;

// CiA 301 section 7.2.8.3.
enum class NmtCommand : std::uint8_t {
  kStart = 0x01,
  kStop = 0x02,
  kEnterPreOperational = 0x80,
  kResetNode = 0x81,
  kResetCommunication = 0x82,
};

enum class NmtState : std::uint8_t {
  kBootUp = 0x00,
  kStopped = 0x04,
  kOperational = 0x05,
  kPreOperational = 0x7f,
};

// SDO abort codes, CiA 301 section 7.2.4.3.17.
inline constexpr std::uint32_t kAbortToggle = 0x05030000;
inline constexpr std::uint32_t kAbortTimeout = 0x05040000;
inline constexpr std::uint32_t kAbortCommand =
    0x05040001;  // command specifier not valid or unknown
inline constexpr std::uint32_t kAbortOutOfMemory = 0x05040005;
inline constexpr std::uint32_t kAbortAccess = 0x06010000;  // unsupported access to an object
inline constexpr std::uint32_t kAbortWriteOnly = 0x06010001;
inline constexpr std::uint32_t kAbortReadOnly = 0x06010002;
inline constexpr std::uint32_t kAbortNoObject = 0x06020000;
inline constexpr std::uint32_t kAbortNotMappable = 0x06040041;
inline constexpr std::uint32_t kAbortPdoLength = 0x06040042;
inline constexpr std::uint32_t kAbortTooLong = 0x06070012;
inline constexpr std::uint32_t kAbortTooShort = 0x06070013;
inline constexpr std::uint32_t kAbortNoSubIndex = 0x06090011;
inline constexpr std::uint32_t kAbortValueRange = 0x06090030;
inline constexpr std::uint32_t kAbortDeviceState = 0x08000022;

// An object dictionary address.
struct ObjectKey {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  constexpr bool operator==(const ObjectKey&) const = default;
};

// Little endian fields of a frame's data; `at` + width must be <= 8.
constexpr void put_u16(CanFrame& frame, std::size_t at, std::uint16_t value) {
  frame.data[at] = static_cast<std::uint8_t>(value & 0xffu);
  frame.data[at + 1] = static_cast<std::uint8_t>(value >> 8);
}
constexpr void put_u32(CanFrame& frame, std::size_t at, std::uint32_t value) {
  put_u16(frame, at, static_cast<std::uint16_t>(value & 0xffffu));
  put_u16(frame, at + 2, static_cast<std::uint16_t>(value >> 16));
}
constexpr std::uint16_t get_u16(const CanFrame& frame, std::size_t at) {
  return static_cast<std::uint16_t>(frame.data[at] | (frame.data[at + 1] << 8));
}
constexpr std::uint32_t get_u32(const CanFrame& frame, std::size_t at) {
  return get_u16(frame, at) | (static_cast<std::uint32_t>(get_u16(frame, at + 2)) << 16);
}
constexpr std::int32_t get_i32(const CanFrame& frame, std::size_t at) {
  return static_cast<std::int32_t>(get_u32(frame, at));
}

// `node` 0 addresses every node. CiA 301 section 7.2.8.3.1.
constexpr CanFrame nmt_frame(NmtCommand command, std::uint8_t node) {
  CanFrame frame{.id = kNmtId, .size = 2};
  frame.data[0] = static_cast<std::uint8_t>(command);
  frame.data[1] = node;
  return frame;
}

constexpr CanFrame sync_frame() { return CanFrame{.id = kSyncId, .size = 0}; }

constexpr CanFrame heartbeat_frame(std::uint8_t node, NmtState state) {
  CanFrame frame{.id = static_cast<std::uint16_t>(kHeartbeatBase + node), .size = 1};
  frame.data[0] = static_cast<std::uint8_t>(state);
  return frame;
}

// CiA 301 section 7.2.7: error code, error register 1001h, five manufacturer bytes (0 here).
constexpr CanFrame emergency_frame(std::uint8_t node, std::uint16_t error_code,
                                   std::uint8_t error_register) {
  CanFrame frame{.id = static_cast<std::uint16_t>(kEmergencyBase + node), .size = 8};
  put_u16(frame, 0, error_code);
  frame.data[2] = error_register;
  return frame;
}

// An SDO frame's common part: command byte and object address (CiA 301 section 7.2.4.3).
constexpr CanFrame sdo_frame(std::uint16_t id, std::uint8_t command, ObjectKey key) {
  CanFrame frame{.id = id, .size = 8};
  frame.data[0] = command;
  put_u16(frame, 1, key.index);
  frame.data[3] = key.sub;
  return frame;
}

// Expedited download request of `size` (1 .. 4) bytes.
constexpr CanFrame sdo_download_request(std::uint8_t node, ObjectKey key, std::uint8_t size,
                                        std::uint32_t value) {
  const auto command = static_cast<std::uint8_t>(0x23u | ((4u - size) << 2));
  CanFrame frame = sdo_frame(static_cast<std::uint16_t>(kSdoRequestBase + node), command, key);
  put_u32(frame, 4, size >= 4 ? value : value & ((1u << (8 * size)) - 1));
  return frame;
}

constexpr CanFrame sdo_upload_request(std::uint8_t node, ObjectKey key) {
  return sdo_frame(static_cast<std::uint16_t>(kSdoRequestBase + node), 0x40, key);
}

// An abort, by the client (`base` kSdoRequestBase) or the server (kSdoResponseBase).
constexpr CanFrame sdo_abort_frame(std::uint16_t base, std::uint8_t node, ObjectKey key,
                                   std::uint32_t abort_code) {
  CanFrame frame = sdo_frame(static_cast<std::uint16_t>(base + node), 0x80, key);
  put_u32(frame, 4, abort_code);
  return frame;
}

constexpr ObjectKey sdo_key(const CanFrame& frame) { return {get_u16(frame, 1), frame.data[3]}; }

}  // namespace ivfm::canopen
