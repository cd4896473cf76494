// Status codes and Result<T>: how the core reports failure without exceptions.
#pragma once

#include <cassert>
#include <cstdint>
#include <utility>

namespace ivfm {

// What a call at a trust boundary can answer. Every function's comment lists the codes it returns.
enum class Status : std::uint8_t {
  kOk = 0,
  kInvalidArgument,  // a parameter or configuration value is outside its documented range
  kOutOfRange,       // a coordinate, index or size lies outside the map, table or buffer
  kTruncated,        // the bytes end before the message does
  kCorrupt,          // the bytes contradict themselves (checksum, structure, trailing garbage)
  kUnsupported,      // well formed, but a version or kind this build does not know
  kFull,             // fixed memory is used up; the caller may try again later
  kEmpty,            // nothing to deliver now
  kTimeout,          // a deadline passed without the expected event
  kUnavailable,      // the device or peer is not there (yet)
  kIoError,          // the operating system reported an error on a port
  kRefused,          // the peer or a safety rule said no (SDO abort, authentication, supervisor)
};

// A short English name, for logs. Never null.
constexpr const char* to_string(Status status) {
  switch (status) {
    case Status::kOk: return "ok";
    case Status::kInvalidArgument: return "invalid argument";
    case Status::kOutOfRange: return "out of range";
    case Status::kTruncated: return "truncated";
    case Status::kCorrupt: return "corrupt";
    case Status::kUnsupported: return "unsupported";
    case Status::kFull: return "full";
    case Status::kEmpty: return "empty";
    case Status::kTimeout: return "timeout";
    case Status::kUnavailable: return "unavailable";
    case Status::kIoError: return "i/o error";
    case Status::kRefused: return "refused";
  }
  return "unknown status";
}

constexpr bool ok(Status status) { return status == Status::kOk; }

// A value or the status that says why there is none. `T` must be default constructible.
template <typename T>
class [[nodiscard]] Result {
 public:
  constexpr Result(T value) : value_(std::move(value)), status_(Status::kOk) {}  // NOLINT: implicit
  constexpr Result(Status status) : status_(status) { assert(status != Status::kOk); }  // NOLINT

  constexpr bool ok() const { return status_ == Status::kOk; }
  constexpr Status status() const { return status_; }
  constexpr const T& value() const {
    assert(ok());
    return value_;
  }
  constexpr T& value() {
    assert(ok());
    return value_;
  }
  constexpr const T& operator*() const { return value(); }
  constexpr const T* operator->() const { return &value(); }

 private:
  T value_{};
  Status status_;
};

}  // namespace ivfm
