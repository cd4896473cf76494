#include "host/can_analysis/can_analysis.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace ivfm::host {
namespace {

using testing::HasSubstr;

// A bus on which all is well, from 0 s on; tests leave something out or add something.
class Recorder {
 public:
  // 100 Hz of statuswords, SYNC every 20 ms, heartbeats every 100 ms.
  void run(double seconds) {
    for (const double end_s = now_s_ + seconds; now_s_ < end_s - 1e-9; now_s_ += 0.01) {
      const auto tick = static_cast<int>(now_s_ / 0.01 + 0.5);
      if (tick % 10 == 0 && heartbeat) send(0x701, {0x05});
      if (tick % 2 != 0) continue;
      if (sync) send(0x080, {});
      send(0x201, {control, 0, 0x10, 0, 0, 0});
      send(0x181, {status, 0x02, 0x0f, 0, 0, 0});
    }
  }
  void send(std::uint32_t id, std::initializer_list<std::uint8_t> bytes) {
    CanLogFrame frame;
    frame.time_s = 1000 + now_s_;
    frame.bus = "can0";
    frame.id = id;
    for (const std::uint8_t byte : bytes) frame.data[frame.size++] = byte;
    analyzer_.take(frame);
    ++frames_;
  }
  CanReport finish() { return analyzer_.finish({frames_, 0, 0}); }
  BusReport bus() { return finish().buses.at(0); }

  std::uint8_t control = 0x0f, status = 0x37;  // enable operation, operation enabled
  bool heartbeat = true, sync = true;

 private:
  CanAnalyzer analyzer_{shipped_dbc(), shipped_eds()};
  double now_s_ = 0;
  std::uint64_t frames_ = 0;
};

TEST(CanAnalysis, FindsNothingWrongWhereNothingIs) {
  Recorder recorder;
  recorder.run(2);
  const BusReport bus = recorder.bus();
  EXPECT_EQ(bus.violation_count, 0u);
  EXPECT_TRUE(bus.faults.empty());
  ASSERT_EQ(bus.drives.size(), 1u);
  EXPECT_EQ(bus.drives[0].name, "DriveLeft");
  EXPECT_EQ(bus.drives[0].fastest, 15);
  EXPECT_EQ(bus.drives[0].nmt_state, "operational");
  EXPECT_EQ(bus.drives[0].actual.size(), 100u);
  EXPECT_EQ(bus.frames_by_message.at("SYNC"), 100u);
}

TEST(CanAnalysis, FindsMissedHeartbeats) {
  Recorder recorder;
  recorder.run(1);
  recorder.heartbeat = false;
  recorder.run(0.3);
  recorder.heartbeat = true;
  recorder.run(1);
  const BusReport bus = recorder.bus();
  ASSERT_EQ(bus.violation_count, 1u);
  EXPECT_EQ(bus.violations[0].who, "DriveLeft");
  EXPECT_THAT(bus.violations[0].text, HasSubstr("missed heartbeat: 400 ms"));
  EXPECT_EQ(bus.timings[1].missed, 3u);
}

TEST(CanAnalysis, FindsLateSync) {
  Recorder recorder;
  recorder.run(1);
  recorder.sync = false;
  recorder.run(0.04);
  recorder.sync = true;
  recorder.run(1);
  const BusReport bus = recorder.bus();
  ASSERT_EQ(bus.violation_count, 1u);
  EXPECT_THAT(bus.violations[0].text, HasSubstr("late SYNC: 60 ms after the last instead of 20"));
}

TEST(CanAnalysis, FindsIllegalTransitions) {
  Recorder recorder;
  recorder.control = 0x00;  // disable voltage
  recorder.status = 0x50;   // switch on disabled
  recorder.run(0.1);
  recorder.status = 0x37;  // operation enabled, unasked
  recorder.run(0.1);
  const BusReport bus = recorder.bus();
  ASSERT_EQ(bus.violation_count, 1u);
  EXPECT_THAT(bus.violations[0].text,
              HasSubstr("from 'switch on disabled' to 'operation enabled'"));
}

TEST(CanAnalysis, AcceptsTheWayUpAndEveryFault) {
  Recorder recorder;
  const auto to = [&](std::uint8_t control, std::uint8_t status) {
    recorder.control = control;
    recorder.status = status;
    recorder.run(0.1);
  };
  to(0x00, 0x50);
  to(0x06, 0x31);
  to(0x07, 0x33);
  to(0x0f, 0x37);
  to(0x02, 0x17);  // quick stop active
  to(0x02, 0x50);  // by itself
  to(0x02, 0x1f);  // fault reaction
  to(0x02, 0x18);  // fault
  to(0x80, 0x50);  // reset
  const BusReport bus = recorder.bus();
  EXPECT_EQ(bus.violation_count, 0u);
  EXPECT_EQ(bus.faults.size(), 2u);
}

TEST(CanAnalysis, TellsEmergenciesAbortsAndWrongSizes) {
  Recorder recorder;
  recorder.run(0.1);
  recorder.send(0x081, {0x10, 0x23, 0x03, 0, 0, 0, 0, 0});
  recorder.send(0x601, {0x40, 0x00, 0x20, 0x00, 0, 0, 0, 0});
  recorder.send(0x581, {0x80, 0x00, 0x20, 0x00, 0x00, 0x00, 0x02, 0x06});
  recorder.send(0x581, {0x60, 0x17, 0x10, 0x00, 0, 0, 0, 0});  // nobody asked
  recorder.send(0x181, {0x37});
  recorder.send(0x333, {});
  const BusReport bus = recorder.bus();
  ASSERT_EQ(bus.faults.size(), 2u);
  EXPECT_EQ(bus.faults[0].text, "emergency 2310h (current), error register 03h");
  EXPECT_EQ(bus.faults[1].text, "refuses 2000h.00h: no such object");
  ASSERT_EQ(bus.violation_count, 2u);
  EXPECT_THAT(bus.violations[0].text, HasSubstr("1017h.00h (Producer heartbeat time)"));
  EXPECT_EQ(bus.violations[1].text, "TPDO1_Left has 1 bytes instead of 6");
  EXPECT_EQ(bus.frames_by_message.at("unknown 333h"), 1u);
}

TEST(CanAnalysis, ReportsInThreeForms) {
  Recorder recorder;
  recorder.run(1);
  const CanReport report = recorder.finish();
  EXPECT_THAT(can_report_text(report, {}), HasSubstr("violations of the protocol: 0"));
  const auto json = nlohmann::json::parse(can_report_json(report, {}));
  EXPECT_EQ(json["buses"][0]["drives"][0]["states"][0]["state"], "operation enabled");
  EXPECT_THAT(can_report_html("can.log", report, {}), HasSubstr("Wheel speeds"));
  EXPECT_NEAR(WheelScale{}.metres_per_count() * 4096, 0.2073, 1e-4);
}

}  // namespace
}  // namespace ivfm::host
