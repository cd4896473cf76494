// What a robot's CAN log tells: wheel speeds, states of the drives, faults, and what breaks the
// protocols (CiA 301, CiA 402, docs/can.md).
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "host/can_analysis/can_database.h"
#include "host/can_analysis/can_log.h"

namespace ivfm::host {

struct CanEvent {
  double time_s = 0;  // since the log's first frame
  std::string who;    // node's name in the DBC file
  std::string text;
};

// A stretch of one state of a drive.
struct CanStateSpan {
  double begin_s = 0, end_s = 0;
  std::size_t state = 0;  // cia402::State
};

// One drive as its frames show it. Speeds in counts/s.
struct DriveTrace {
  std::string name;
  std::vector<std::pair<double, double>> actual, target;  // a selection of a long log
  double fastest = 0;                                     // largest |actual|
  std::vector<CanStateSpan> states;
  std::string nmt_state;
};

struct ProtocolTiming {
  std::string what;  // "SYNC", "heartbeat of DriveLeft"
  std::uint64_t frames = 0;
  double period_s = 0;  // announced by SDO (1017h) or the median
  double longest_gap_s = 0;
  std::uint64_t late = 0;    // gaps of more than 1.5 periods
  std::uint64_t missed = 0;  // frames that should have come in them
};

struct BusReport {
  std::string bus;
  std::uint64_t frames = 0;
  double length_s = 0;
  double load_bits_per_s = 0;                              // without stuff bits
  std::map<std::string, std::uint64_t> frames_by_message;  // "unknown 123h" for others
  std::vector<DriveTrace> drives;
  std::vector<CanEvent> faults;  // emergencies, fault states, SDO aborts; the first kMostEvents
  std::uint64_t fault_count = 0;
  std::vector<CanEvent> violations;  // of the protocol; the first kMostEvents of them
  std::uint64_t violation_count = 0;
  std::vector<ProtocolTiming> timings;
  static constexpr std::size_t kMostEvents = 500;
};

struct CanReport {
  CanLogCounters counters;
  std::vector<BusReport> buses;  // in the order of their names
};

class CanAnalyzer {
 public:
  // Throws what parse_dbc() throws.
  CanAnalyzer(std::string_view dbc, std::string_view eds);
  ~CanAnalyzer();
  // Frames in the order of the log.
  void take(const CanLogFrame& frame);
  CanReport finish(const CanLogCounters& counters);

 private:
  class Bus;
  const std::map<std::uint32_t, DbcMessage> messages_;
  const std::map<std::pair<std::uint16_t, std::uint8_t>, std::string> objects_;
  std::map<std::string, std::unique_ptr<Bus>> buses_;
  std::optional<double> first_s_;
};

// Metres a second of the wheel for a count a second of its encoder.
struct WheelScale {
  double radius_m = 0.033;
  int counts_per_turn = 4096;
  double metres_per_count() const;
};

std::string can_report_text(const CanReport& report, const WheelScale& scale);
std::string can_report_json(const CanReport& report, const WheelScale& scale);
// A self-contained page with plots.
std::string can_report_html(const std::string& title, const CanReport& report,
                            const WheelScale& scale);

}  // namespace ivfm::host
