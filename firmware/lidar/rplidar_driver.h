// Runs an RPLIDAR on a serial port: start-up, scans in the robot's frame, recovery.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/hal/clock.h"
#include "firmware/hal/serial_port.h"
#include "firmware/lidar/rplidar_decoder.h"
#include "firmware/lidar/scan.h"

namespace ivfm {

// How the lidar is mounted and used. All times in microseconds of the agent's clock.
struct RplidarConfig {
  bool prefer_express = true;          // EXPRESS_SCAN where the firmware has it, else SCAN
  BinaryAngle mounting_yaw;            // direction of the lidar's zero in the robot's frame
  std::uint16_t min_range_mm = 150;    // nearer or farther than these: no measurement
  std::uint16_t max_range_mm = 12000;  // RPLIDAR A1
  TimeUs answer_timeout_us = 500'000;
  TimeUs first_sample_timeout_us = 4'000'000;  // the motor spins up meanwhile
  TimeUs silence_timeout_us = 1'000'000;       // no sample for so long: start over
  TimeUs reset_time_us = 800'000;              // from RESET to being ready
  TimeUs min_backoff_us = 100'000;             // between attempts, doubled up to the maximum
  TimeUs max_backoff_us = 2'000'000;
};

// What the driver is doing.
enum class RplidarState : std::uint8_t {
  kStopped,   // motor off
  kStopping,  // STOP sent, draining what is still on the line
  kGettingInfo,
  kGettingHealth,
  kResetting,  // the device reported an error; RESET sent
  kStarting,   // scan requested
  kScanning,   // samples arrive
  kWaiting,    // an attempt failed; the next one comes after the back-off
};

// A short English name, for logs. Never null.
const char* to_string(RplidarState state);

// The ladder of one attempt: STOP, GET_INFO, GET_HEALTH, motor on, EXPRESS_SCAN or SCAN. Whatever
// fails on it (no answer, silence, device gone) leads to kWaiting and then to a new attempt.
class RplidarDriver {
 public:
  struct Counters {
    std::uint64_t bytes = 0;
    std::uint32_t scans = 0;
    std::uint32_t resyncs = 0;          // frame boundary lost in a stream
    std::uint32_t dropped_frames = 0;   // nodes, capsules or answers that contradicted themselves
    std::uint32_t dropped_samples = 0;  // of incomplete or overfull revolutions
    std::uint32_t skipped_bytes = 0;
    std::uint32_t reconnects = 0;  // attempts after the first one
    std::uint32_t resets = 0;      // RESET sent because of error health
    std::uint32_t port_errors = 0;
    constexpr bool operator==(const Counters&) const = default;
  };

  // `port` must outlive the driver.
  RplidarDriver(SerialPort& port, const RplidarConfig& config) : port_(port), config_(config) {}

  // Begins to scan, or goes on. No effect while it runs.
  void start(TimeUs now_us);
  // STOP and motor off.
  void stop(TimeUs now_us);
  // Reads what has arrived and does what is due. To be called every 10 ms or so. Returns the port's
  // status: kOk, kUnavailable (device gone), kFull (line does not drain), kIoError.
  Status step(TimeUs now_us);

  // The revolution completed since the last call, or null. Bearings in the robot's frame, in order
  // of measurement (clockwise); ranges in mm. Valid until the next step().
  const Scan* take_scan();
  // When the first and the last sample of that scan were received.
  TimeUs scan_start_us() const { return ready_start_us_; }
  TimeUs scan_end_us() const { return ready_end_us_; }

  RplidarState state() const { return state_; }
  const RplidarInfo& info() const { return decoder_.info(); }
  const RplidarHealth& health() const { return decoder_.health(); }
  bool uses_express() const { return express_; }
  Counters counters() const;

 private:
  Status read_port(TimeUs now_us);
  void handle(RplidarDecoder::Event event, TimeUs now_us);
  void add_samples(TimeUs now_us);
  void finish_revolution(TimeUs now_us);
  ScanPoint to_point(const RplidarSample& sample) const;

  void check_deadline(TimeUs now_us);
  void begin_attempt(TimeUs now_us);
  void start_scan(TimeUs now_us);
  void fail(TimeUs now_us);
  void enter(RplidarState state, TimeUs deadline_us);
  void request(rplidar::Request request, std::span<const std::uint8_t> payload = {});
  void note(Status status);

  static constexpr std::size_t kMaxBytesPerStep = 4096;
  static constexpr std::size_t kMinPointsPerScan = 16;  // fewer are no revolution
  static constexpr TimeUs kStopTimeUs = 20'000;         // document: 1 ms; and USB latency

  SerialPort& port_;
  RplidarConfig config_;
  RplidarDecoder decoder_;
  RplidarState state_ = RplidarState::kStopped;
  TimeUs deadline_us_ = 0;
  TimeUs backoff_us_ = 0;
  bool express_ = false;
  Status port_status_ = Status::kOk;

  std::array<Scan, 2> scans_{};
  std::uint8_t assembling_ = 0;  // index in scans_; the other one is ready or free
  bool revolution_begun_ = false;
  bool scan_ready_ = false;
  TimeUs assembling_start_us_ = 0;
  TimeUs ready_start_us_ = 0;
  TimeUs ready_end_us_ = 0;
  Counters counters_;
};

}  // namespace ivfm
