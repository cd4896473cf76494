#include "host/simulator/recording.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <random>
#include <stdexcept>

#include "firmware/agent/profile.h"
#include "host/simulator/recording_player.h"
#include "shared/wire/crc.h"

namespace ivfm::host {
namespace {

using Bytes = std::vector<std::uint8_t>;

Recording small_recording() {
  Recording recording;
  recording.source = "by hand";
  for (unsigned i = 0; i < 3; ++i) {
    RecordedScan scan;
    scan.time_us = i * 250'000;
    scan.lidar_pose = {{static_cast<std::int32_t>(i) * 100'000, -5}, BinaryAngle(std::uint16_t{7})};
    scan.first_bearing = BinaryAngle::from_degrees(-90);
    scan.aperture = 32768;
    scan.ranges_mm.assign(181, static_cast<std::uint16_t>(2000 + i));
    scan.ranges_mm[90] = 0;
    recording.scans.push_back(scan);
  }
  return recording;
}

// Replaces the checksum, so that the reader gets as far as the contents.
Bytes resealed(Bytes bytes) {
  const std::uint32_t crc = crc32(std::span(bytes).first(bytes.size() - 4));
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[bytes.size() - 4 + i] = static_cast<std::uint8_t>(crc >> (8 * i));
  }
  return bytes;
}

std::string error_of(const Bytes& bytes) {
  try {
    decode_recording(bytes);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(Recording, ComesBackFromItsBytes) {
  const Recording recording = small_recording();
  const Recording copy = decode_recording(encode_recording(recording));
  EXPECT_EQ(copy.source, "by hand");
  EXPECT_EQ(copy.scans, recording.scans);
}

TEST(Recording, SpreadsItsRaysEvenly) {
  const RecordedScan scan = small_recording().scans[0];
  EXPECT_EQ(scan.bearing_of(0), BinaryAngle::from_degrees(-90));
  EXPECT_EQ(scan.bearing_of(90), BinaryAngle::from_degrees(0));
  EXPECT_EQ(scan.bearing_of(180), BinaryAngle::from_degrees(90));
}

TEST(Recording, FillsTheTurnWithDirectionsThatSawNothing) {
  const auto points = full_turn(small_recording().scans[0]);
  ASSERT_EQ(points.size(), 360u);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(points[i].echo == Echo::kHit, i < 181 && i != 90) << i;
  }
}

TEST(Recording, SaysWhatIsWrongWithABrokenFile) {
  const Bytes good = encode_recording(small_recording());
  EXPECT_NE(error_of({}).find("does not begin"), std::string::npos);
  Bytes corrupt = good;
  corrupt[100] ^= 4;
  EXPECT_NE(error_of(corrupt).find("checksum"), std::string::npos);
  Bytes truncated(good.begin(), good.end() - 200);
  EXPECT_NE(error_of(resealed(truncated)).find("scan 2"), std::string::npos);
  Bytes longer = good;
  longer.insert(longer.end() - 4, 3, 0);
  EXPECT_NE(error_of(resealed(longer)).find("follow"), std::string::npos);
  Bytes oversized = good;
  const std::size_t count_at = std::string("IVFM-RECORDING 1 by hand\n").size();
  oversized[count_at + 3] = 0xff;
  EXPECT_NE(error_of(resealed(oversized)).find("claims"), std::string::npos);
}

TEST(Recording, ReadsWhatIsThereOfAFileThatWasCutOff) {
  const auto path = std::filesystem::temp_directory_path() /
                    ("ivfm_cut_" + std::to_string(::getpid()) + ".recording");
  const Recording whole = small_recording();
  write_recording(path, whole);
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 100);
  const Recording cut = read_recording(path);
  std::filesystem::remove(path);
  ASSERT_EQ(cut.scans.size(), whole.scans.size() - 1);
  EXPECT_EQ(cut.scans[0], whole.scans[0]);
  EXPECT_NE(cut.warning.find("breaks off"), std::string::npos);
}

TEST(Recording, SurvivesEveryTruncationAndRandomBytes) {
  const Bytes good = encode_recording(small_recording());
  for (std::size_t size = 0; size < good.size(); ++size) {
    EXPECT_NE(error_of(Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size))), "");
    if (size >= 30) {
      EXPECT_NE(
          error_of(resealed(Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size)))),
          "");
    }
  }
  std::mt19937 random(5);
  for (int round = 0; round < 2000; ++round) {
    Bytes bytes = good;
    for (int i = 0; i < 8; ++i)
      bytes[17 + random() % (bytes.size() - 17)] = static_cast<std::uint8_t>(random());
    error_of(resealed(bytes));
  }
}

TEST(Recording, NamesTheFileItCannotRead) {
  const auto path = std::filesystem::temp_directory_path() / "ivfm-no-recording";
  std::ofstream(path) << "something else";
  EXPECT_FALSE(is_recording(path));
  try {
    read_recording(path);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("ivfm-no-recording"), std::string::npos);
  }
  std::filesystem::remove(path);
}

TEST(ScanWire, DeliversExactlyWhatWasSent) {
  ScanWire wire;
  for (const RecordedScan& recorded : small_recording().scans) {
    const auto sent = full_turn(recorded);
    const Scan& scan = wire.send(sent);
    ASSERT_EQ(scan.size, sent.size());
    std::size_t hits = 0;
    for (const ScanPoint& point : scan.points()) {
      if (point.echo != Echo::kHit) continue;
      ++hits;
      EXPECT_EQ(point.range_mm, recorded.ranges_mm[0]);
      EXPECT_LE(std::abs(point.bearing.degrees()), 90.02);
    }
    EXPECT_EQ(hits, 180u);
  }
  EXPECT_EQ(wire.counters().resyncs, 0u);
  EXPECT_EQ(wire.counters().dropped_frames, 0u);
}

TEST(Replay, GivesTheSameMapAndGoalsEveryTime) {
  const auto explorer = std::make_unique<ExplorerFor<RobotProfile>>(
      ExplorerConfig::lidar(3'000'000, RobotProfile::kCellUm));
  NoPolicy policy;
  const ReplayResult first = replay(small_recording(), *explorer, policy, {1});
  const ReplayResult second = replay(small_recording(), *explorer, policy, {1});
  EXPECT_EQ(first.scans, 3u);
  EXPECT_EQ(first.points, 3u * 180);
  EXPECT_EQ(first.goals.size(), 3u);
  EXPECT_EQ(first.map_hash, second.map_hash);
  EXPECT_EQ(first.goals_hash, second.goals_hash);
  EXPECT_TRUE(explorer->map().is_obstacle(explorer->map().frame().cell_at({100'000, 2'000'000})) ||
              explorer->map().is_obstacle(explorer->map().frame().cell_at({50'000, 2'000'000})));
}

}  // namespace
}  // namespace ivfm::host
