// The device end of the RPLIDAR protocol as pure logic: requests in, answers and scans out.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "firmware/hal/clock.h"
#include "firmware/lidar/rplidar_protocol.h"
#include "firmware/lidar/scan.h"

namespace ivfm::host {

// What kind of device it is; the defaults are an RPLIDAR A1M8.
struct RplidarEmulatorConfig {
  RplidarInfo info{24, 1, 29, 7, {0x1f, 0xf7, 0x17}};
  double rotation_hz = 5.5;
  std::uint16_t standard_sample_us = 508;
  std::uint16_t express_sample_us = 254;
  std::uint16_t max_range_mm = 12000;  // farther points are sent as not measured
  // Express samples lag behind the raw angle by this (1/8 degree): about what an A1's optics need.
  std::uint8_t compensation_q3 = 60;
  // False: the motor runs whenever a scan is requested, for lines that carry no DTR.
  bool motor_by_dtr = false;
  TimeUs spin_up_us = 0;   // from motor on to the first sample
  TimeUs boot_us = 2'000;  // from RESET to the boot text; requests are not heard meanwhile
};

// Time is an argument and may run at any speed, but not backwards. Angles and bearings are in the
// lidar's frame: ScanPoint::bearing counter-clockwise from its zero, on the wire clockwise.
class RplidarEmulator {
 public:
  // Fills range_mm, echo and quality of one revolution's `beams`, whose bearings are set. Anything
  // but a hit within range is sent as not measured (an A1 cannot tell far from nothing).
  using RevolutionSource = std::function<void(TimeUs start_us, std::span<ScanPoint> beams)>;

  struct Counters {
    std::uint64_t requests = 0;
    std::uint64_t bad_requests = 0;  // bad checksum, unknown command, wrong payload, not possible
    std::uint64_t samples = 0;
    std::uint64_t revolutions = 0;  // begun
  };

  explicit RplidarEmulator(const RplidarEmulatorConfig& config = {});

  // Asked at the beginning of each revolution.
  void set_source(RevolutionSource source) { source_ = std::move(source); }
  // Instead of the above: asked for some beams after the other, each as late as it is due, so that
  // the source can measure them from where the robot is now. `now_us` is the time of the last one.
  using BeamSource = std::function<void(TimeUs now_us, std::span<ScanPoint> beams)>;
  void set_beam_source(BeamSource source) { beam_source_ = std::move(source); }
  // The points to send from the next revolution on, instead of asking a source. A standard scan
  // sends each point once, at its own angle, however many they are; an express scan sends its
  // usual number of samples, each the point next to it, if one is near enough.
  void set_revolution(std::span<const ScanPoint> points);

  // Bytes from the host.
  void receive(std::span<const std::uint8_t> bytes, TimeUs now_us);
  // All bytes to the host that are due by `now_us`. After a pause of more than a second the samples
  // of its beginning are left out.
  std::vector<std::uint8_t> transmit(TimeUs now_us);
  // The DTR line's meaning, not its level. Only with motor_by_dtr.
  void set_motor(bool on, TimeUs now_us);

  // Faults. Silent: neither hears nor says anything.
  void set_silent(bool silent) { silent_ = silent; }
  // Puts `count` random bytes on the line now.
  void inject_garbage(std::size_t count, std::uint32_t seed);
  // Drops the next `count` bytes that would be sent.
  void drop_bytes(std::size_t count) { bytes_to_drop_ = count; }
  // With level kError scans are refused (protection stop). RESET heals it if `until_reset`.
  void set_health(RplidarHealth health, bool until_reset = true);

  bool scanning() const { return mode_ != Mode::kIdle; }
  // Samples of one revolution of a source, in the current mode (standard when idle).
  std::size_t samples_per_revolution() const;
  const Counters& counters() const { return counters_; }

 private:
  enum class Mode : std::uint8_t { kIdle, kStandard, kExpress };
  enum class Parse : std::uint8_t { kSync, kCommand, kLength, kPayload, kChecksum };

  void parse(std::uint8_t byte, TimeUs now_us);
  void execute(TimeUs now_us);
  void reject() { ++counters_.bad_requests; }
  void begin_scan(Mode mode, bool force, TimeUs now_us);
  void begin_reset(TimeUs now_us);
  bool firmware_is_at_least(int major, int minor) const;
  void answer_info();
  void answer_health();
  void answer_sample_rate();
  void answer_configuration();
  void answer(rplidar::Response type, std::span<const std::uint8_t> payload, bool repeats = false);
  void send(std::span<const std::uint8_t> bytes);

  bool motor_runs(TimeUs now_us) const;
  std::uint16_t sample_us() const;
  void emit_samples(TimeUs now_us);
  void begin_revolution(TimeUs start_us);
  void fill_from_source(TimeUs start_us);
  void fill_from_points();
  void measure_due_beams(TimeUs now_us);
  void emit_node(const RplidarSample& sample);
  void add_to_capsule(const RplidarSample& sample, std::int32_t raw_q6);
  void emit_capsule();

  RplidarEmulatorConfig config_;
  RevolutionSource source_;
  BeamSource beam_source_;
  std::vector<ScanPoint> beams_;             // of this revolution, for beam_source_
  std::size_t measured_ = 0;                 // so many of them are
  std::vector<RplidarSample> fixed_points_;  // clockwise; used when has_points_
  bool has_points_ = false;

  Parse parse_ = Parse::kSync;
  TimeUs last_byte_us_ = 0;
  std::uint8_t command_ = 0;
  std::size_t payload_size_ = 0;
  std::vector<std::uint8_t> payload_;

  Mode mode_ = Mode::kIdle;
  bool forced_ = false;
  bool motor_on_ = false;
  TimeUs motor_since_us_ = 0;
  TimeUs next_sample_us_ = 0;
  std::vector<RplidarSample> revolution_;
  std::size_t index_ = 0;  // next sample of revolution_
  bool first_capsule_ = false;
  struct CapsuleSample {
    std::uint16_t distance_mm;
    std::uint8_t compensation_q3;
  };
  std::vector<CapsuleSample> capsule_;
  std::int32_t capsule_start_q6_ = 0;

  RplidarHealth health_;
  bool health_until_reset_ = true;
  bool silent_ = false;
  std::size_t bytes_to_drop_ = 0;
  bool booting_ = false;
  TimeUs boot_done_us_ = 0;
  std::vector<std::uint8_t> outgoing_;
  Counters counters_;
};

}  // namespace ivfm::host
