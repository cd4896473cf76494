#include "host/simulator/rawlog_replay.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>
#include <string>

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;

const fs::path kRawlog =
    "/usr/share/mrpt/datasets/2006-01ENE-21-SENA_Telecom Faculty_one_loop_only.rawlog";
const fs::path kRecording = fs::path(IVFM_SOURCE_DIR) / "tests/golden/telecom_faculty.recording";

class RawlogReplay : public testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(kRawlog)) GTEST_SKIP() << "package mrpt-common is not installed";
    broken_ = fs::temp_directory_path() / ("ivfm-rawlog-" + std::to_string(::getpid()));
  }
  void TearDown() override { fs::remove(broken_); }
  std::string rawlog_bytes() {
    std::ifstream file(kRawlog, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void write_broken(const std::string& bytes) { std::ofstream(broken_, std::ios::binary) << bytes; }
  fs::path broken_;
};

TEST_F(RawlogReplay, ReadsTheRealRecordingAsItIs) {
  const Recording recording = load_rawlog(kRawlog);
  // rawlog-edit --info and RawLogViewer say: 225 scans of 361 rays over 180 degrees, 59 s.
  ASSERT_EQ(recording.scans.size(), 225u);
  EXPECT_EQ(recording.warning, "");
  EXPECT_EQ(recording.scans[0].lidar_pose, Pose{});
  for (const RecordedScan& scan : recording.scans) {
    EXPECT_EQ(scan.ranges_mm.size(), 361u);
    EXPECT_EQ(scan.aperture, 32768);
    EXPECT_EQ(scan.first_bearing, BinaryAngle::from_degrees(-90));
    EXPECT_LE(*std::max_element(scan.ranges_mm.begin(), scan.ranges_mm.end()), 12000);
  }
  EXPECT_NEAR(static_cast<double>(recording.duration_us()) / 1e6, 59.075, 0.01);
}

TEST_F(RawlogReplay, IsWhatTheGoldenRecordingWasMadeFrom) {
  EXPECT_EQ(load_rawlog(kRawlog).scans, read_recording(kRecording).scans);
}

TEST_F(RawlogReplay, KeepsFarReadingsWhenAskedTo) {
  const Recording recording = load_rawlog(kRawlog, 60000);
  const auto& ranges = recording.scans[0].ranges_mm;
  EXPECT_NEAR(*std::max_element(ranges.begin(), ranges.end()), 46450, 10);
}

TEST_F(RawlogReplay, UsesWhatCameBeforeABreakAndSaysSo) {
  write_broken(rawlog_bytes().substr(0, 60'000));
  const Recording recording = load_rawlog(broken_);
  EXPECT_GT(recording.scans.size(), 20u);
  EXPECT_LT(recording.scans.size(), 225u);
  EXPECT_NE(recording.warning.find("breaks off after"), std::string::npos);
}

TEST_F(RawlogReplay, RefusesWhatIsNoRawlogAndNamesIt) {
  write_broken("this is not a rawlog");
  for (const fs::path& path : {broken_, fs::path("/nowhere.rawlog"), fs::path("/tmp")}) {
    try {
      load_rawlog(path);
      FAIL() << path;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(path.string()), std::string::npos);
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
}

TEST_F(RawlogReplay, RefusesADamagedFile) {
  std::mt19937 random(11);
  const std::string good = rawlog_bytes();
  for (int round = 0; round < 50; ++round) {
    std::string bytes = good;
    bytes[12 + random() % (bytes.size() - 12)] ^= static_cast<char>(1 + random() % 255);
    write_broken(bytes);
    EXPECT_THROW(load_rawlog(broken_), std::runtime_error);
  }
}

}  // namespace
}  // namespace ivfm::host
