// The same recording gives the same map and the same goals on every machine, bit for bit.
//
// Data: tests/golden/telecom_faculty.recording, written by `ivfm replay RAWLOG --extract FILE` from
// MRPT 2.5.8's "2006-01ENE-21-SENA_Telecom Faculty_one_loop_only.rawlog" (package mrpt-common,
// BSD-3-Clause, Copyright 2005-2023 Individual contributors, MRPT). The hashes are not derived
// independently: they pin behaviour, across machines and over time. Who changes scan fusion or
// planning on purpose runs `ivfm replay` on the recording, looks at the picture, and enters them.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "firmware/agent/profile.h"
#include "host/simulator/recording_player.h"

namespace ivfm::host {
namespace {

constexpr std::uint64_t kMapHash = 0x7d292a56afaff9fa;
constexpr std::uint64_t kGoalsHash = 0x5e2317ad21e5f573;

const std::string kRecording =
    std::string(IVFM_SOURCE_DIR) + "/tests/golden/telecom_faculty.recording";

TEST(RecordedDrive, GivesTheSameMapAndGoalsOnEveryMachine) {
  const Recording recording = read_recording(kRecording);
  const auto explorer = std::make_unique<ExplorerFor<RobotProfile>>(
      ExplorerConfig::lidar(3'000'000, RobotProfile::kCellUm));
  NoPolicy policy;
  const ReplayResult result = replay(recording, *explorer, policy, {10});
  EXPECT_EQ(result.scans, 225u);
  EXPECT_EQ(result.goals.size(), 22u);
  EXPECT_EQ(result.lidar.resyncs, 0u);
  EXPECT_EQ(result.lidar.dropped_frames, 0u);
  EXPECT_EQ(result.map_hash, kMapHash) << std::hex << "the map's hash is now " << result.map_hash;
  EXPECT_EQ(result.goals_hash, kGoalsHash)
      << std::hex << "the goals' hash is now " << result.goals_hash;
}

// Every goal is a place that the map holds to be free; the recording's truth is not at hand.
TEST(RecordedDrive, NeverChoosesAGoalInsideAnObstacle) {
  const Recording recording = read_recording(kRecording);
  const auto explorer = std::make_unique<ExplorerFor<RobotProfile>>(
      ExplorerConfig::lidar(3'000'000, RobotProfile::kCellUm));
  NoPolicy policy;
  Recording part;
  for (std::size_t i = 0; i < 60; ++i) part.scans.push_back(recording.scans[i]);
  const ReplayResult result = replay(part, *explorer, policy, {60});
  ASSERT_EQ(result.goals.size(), 1u);
  ASSERT_NE(result.goals[0].decision.kind, Decision::Kind::kExplored);
  EXPECT_FALSE(explorer->map().is_obstacle(result.goals[0].decision.goal));
}

// The points that came through the wire lie where the recording has them.
TEST(RecordedDrive, LosesNoPointOnTheWire) {
  const Recording recording = read_recording(kRecording);
  ScanWire wire;
  for (std::size_t s = 0; s < recording.scans.size(); s += 25) {
    const RecordedScan& recorded = recording.scans[s];
    const Scan& scan = wire.send(full_turn(recorded));
    std::size_t hits = 0;
    for (const ScanPoint& point : scan.points()) {
      if (point.echo != Echo::kHit) continue;
      ++hits;
      // Half a degree a ray, from -90 degrees; the wire's angles are exact to 1/64 degree.
      const auto ray = static_cast<std::size_t>(std::lround((point.bearing.degrees() + 90) * 2));
      ASSERT_LT(ray, recorded.ranges_mm.size());
      EXPECT_EQ(point.range_mm, recorded.ranges_mm[ray]);
    }
    std::size_t measured = 0;
    for (const std::uint16_t range_mm : recorded.ranges_mm) measured += range_mm != 0;
    EXPECT_EQ(hits, measured);
  }
}

}  // namespace
}  // namespace ivfm::host
