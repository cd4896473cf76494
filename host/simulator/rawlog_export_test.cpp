#include "host/simulator/rawlog_export.h"

#include <gtest/gtest.h>
#include <mrpt/obs/CObservationOdometry.h>
#include <mrpt/obs/CRawlog.h>

#include <cstdlib>

#include "host/map_server/scratch_folder.h"
#include "host/simulator/rawlog_replay.h"

namespace ivfm::host {
namespace {

TEST(RawlogExport, MrptReadsThePosesBack) {
  const ScratchFolder folder;
  const std::vector<TimedPose> poses{
      {1000.5, "robot 1", {{1'500'000, -2'000'000}, BinaryAngle::from_degrees(90)}},
      {1001.25, "robot 2", {{0, 0}, BinaryAngle::from_degrees(-45)}}};
  write_pose_rawlog(folder / "run.rawlog", poses);
  mrpt::obs::CRawlog rawlog;
  ASSERT_TRUE(rawlog.loadFromRawLogFile((folder / "run.rawlog").string()));
  ASSERT_EQ(rawlog.size(), 2u);
  const auto first =
      std::dynamic_pointer_cast<mrpt::obs::CObservationOdometry>(rawlog.getAsObservation(0));
  ASSERT_TRUE(first);
  EXPECT_EQ(first->sensorLabel, "robot 1");
  EXPECT_NEAR(mrpt::Clock::toDouble(first->timestamp), 1000.5, 1e-6);
  EXPECT_DOUBLE_EQ(first->odometry.x(), 1.5);
  EXPECT_NEAR(first->odometry.phi(), 1.5707963, 1e-4);
}

TEST(RawlogExport, ARecordedDriveComesBackRayByRay) {
  const Recording recording =
      read_recording(IVFM_SOURCE_DIR "/tests/golden/telecom_faculty.recording");
  const ScratchFolder folder;
  write_scan_rawlog(folder / "drive.rawlog", recording, 1e9);
  const Recording back = load_rawlog((folder / "drive.rawlog").string());
  ASSERT_EQ(back.scans.size(), recording.scans.size());
  for (std::size_t i = 0; i < back.scans.size(); ++i) {
    EXPECT_EQ(back.scans[i].ranges_mm, recording.scans[i].ranges_mm) << i;
    EXPECT_EQ(back.scans[i].time_us, recording.scans[i].time_us) << i;
  }
}

TEST(RawlogExport, RawlogEditAcceptsIt) {
  if (std::system("command -v rawlog-edit > /dev/null") != 0) {
    GTEST_SKIP() << "no rawlog-edit (Debian package mrpt-apps)";
  }
  const ScratchFolder folder;
  write_pose_rawlog(folder / "run.rawlog", {{1000, "robot 1", {}}, {1001, "robot 1", {}}});
  const std::string file = (folder / "run.rawlog").string();
  const std::string command = "rawlog-edit -i " + file + " --info 2>&1 | grep -q 'robot 1 .* 2 '";
  EXPECT_EQ(std::system(command.c_str()), 0);
}

TEST(RawlogExport, SaysWhatCannotBeWritten) {
  EXPECT_THROW(write_pose_rawlog("/nowhere/x.rawlog", {}), std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host
