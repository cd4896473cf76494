#include "host/log_analysis/drive_data.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "host/log_analysis/log_command.h"
#include "host/map_server/scratch_folder.h"
#include "host/simulator/recording.h"

namespace ivfm::host {
namespace {

// A round room: 4 m straight ahead at 0.5 m/s, then 5 s of rest, then 10 s without scans.
Recording drive() {
  Recording recording;
  recording.source = "a test";
  const auto add = [&](double time_s, double x_m) {
    RecordedScan scan;
    scan.time_us = static_cast<TimeUs>(time_s * 1e6);
    scan.lidar_pose = {{static_cast<std::int32_t>(x_m * 1e6), 0}, {}};
    scan.aperture = 65'000;
    scan.ranges_mm.assign(180, 5000);
    recording.scans.push_back(scan);
  };
  for (int i = 0; i <= 80; ++i) add(i * 0.1, i * 0.05);
  for (int i = 81; i <= 130; ++i) add(i * 0.1, 4);
  add(23, 4);
  return recording;
}

TEST(DriveData, TellsWhereTheRobotWasAndWhatItSaw) {
  const ScratchFolder folder;
  write_recording(folder / "drive.recording", drive());
  ASSERT_TRUE(is_recorded_drive(folder / "drive.recording"));
  const RunData run = load_drive(folder / "drive.recording");
  EXPECT_NEAR(run.driven_m, 4, 1e-6);
  EXPECT_NEAR(run.time_s, 23, 1e-6);
  // Discs of 3 m radius along 4 m.
  EXPECT_NEAR(run.scores.explored_m2, 9 * 3.1416 + 24, 3);
  EXPECT_NEAR(run.explored_m2.back().second, run.scores.explored_m2, 1e-6);
  const RobotRun& robot = run.robots.at(0);
  EXPECT_NEAR(robot.time_in(Activity::kDriving), 8, 0.11);
  EXPECT_NEAR(robot.time_in(Activity::kStanding), 5, 0.11);
  EXPECT_NEAR(robot.time_in(Activity::kUnheard), 10, 0.01);
  const auto timeline = drive_timeline(run);
  ASSERT_EQ(timeline.size(), 2u);
  EXPECT_EQ(timeline[0].text, "stands for 5 s");
  EXPECT_EQ(timeline[1].text, "no scan is recorded for 10 s");
}

TEST(DriveData, MakesAReportWithoutRadioAndDecisions) {
  const ScratchFolder folder;
  write_recording(folder / "drive.recording", drive());
  write_log_report(folder / "drive.recording", folder / "report.html");
  std::ifstream in(folder / "report.html");
  const std::string html{std::istreambuf_iterator<char>(in), {}};
  EXPECT_THAT(html, testing::HasSubstr("Explored over metres driven"));
  EXPECT_THAT(html, testing::HasSubstr("recorded no scan for 10 s"));
  EXPECT_THAT(html, testing::Not(testing::HasSubstr("Radio traffic")));
}

TEST(DriveData, RefusesWhatIsNoDrive) {
  const ScratchFolder folder;
  std::ofstream(folder / "junk.rawlog") << "junk";
  EXPECT_THROW(load_drive(folder / "junk.rawlog"), std::runtime_error);
  EXPECT_THROW(load_drive(folder / "missing.rawlog"), std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host
