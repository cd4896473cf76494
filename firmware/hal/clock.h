// Port: monotonic time. The core never reads it; time is an argument of every call.
#pragma once

#include <cstdint>

namespace ivfm {

// Microseconds since some fixed moment before start-up; never goes back.
using TimeUs = std::uint64_t;

class Clock {
 public:
  virtual TimeUs now_us() = 0;

 protected:
  ~Clock() = default;
};

}  // namespace ivfm
