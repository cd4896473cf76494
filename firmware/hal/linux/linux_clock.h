// Monotonic time on Linux, optionally faster than real time for software in the loop.
#pragma once

#include <ctime>

#include "firmware/hal/clock.h"

namespace ivfm {

// Starts near zero at construction. With a scale of K it runs K times as fast as the wall clock;
// simulator and agent of one run must use the same scale.
class LinuxClock final : public Clock {
 public:
  // `scale`: > 0.
  explicit LinuxClock(double scale = 1.0) : scale_(scale), start_(read()) {}

  TimeUs now_us() override {
    return 1 + static_cast<TimeUs>(static_cast<double>(read() - start_) * scale_ / 1000.0);
  }
  // Sleeps until about `time_us` of this clock; returns early when a signal comes.
  void sleep_until(TimeUs time_us) {
    const TimeUs now = now_us();
    if (time_us <= now) return;
    const double wait_ns = static_cast<double>(time_us - now) * 1000.0 / scale_;
    const timespec wait{static_cast<std::time_t>(wait_ns / 1e9),
                        static_cast<long>(wait_ns) % 1'000'000'000L};
    nanosleep(&wait, nullptr);
  }

 private:
  static std::uint64_t read() {
    timespec t{};
    clock_gettime(CLOCK_MONOTONIC, &t);
    return static_cast<std::uint64_t>(t.tv_sec) * 1'000'000'000u +
           static_cast<std::uint64_t>(t.tv_nsec);
  }

  double scale_;
  std::uint64_t start_;
};

}  // namespace ivfm
