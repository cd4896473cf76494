// A recorded drive: where the lidar was and what it measured, scan by scan; and its file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "firmware/hal/clock.h"
#include "firmware/lidar/scan.h"
#include "shared/geometry/pose.h"

namespace ivfm::host {

// One sweep, its rays evenly spread from `first_bearing` over `aperture` (lidar's frame,
// counter-clockwise).
struct RecordedScan {
  TimeUs time_us = 0;  // since the first scan
  Pose lidar_pose;     // in the frame of the recording's odometry
  BinaryAngle first_bearing;
  std::uint16_t aperture = 0;            // from the first to the last ray, binary angle units
  std::vector<std::uint16_t> ranges_mm;  // 0: nothing measured

  bool operator==(const RecordedScan&) const = default;
  BinaryAngle bearing_of(std::size_t ray) const;
};

struct Recording {
  std::string source;   // where it came from, one line
  std::string warning;  // empty, or what was wrong with the file it was read from
  // Where the lidar sits on the robot, if the source says so; files keep only the lidar's poses.
  Pose lidar_in_robot;
  std::vector<RecordedScan> scans;

  TimeUs duration_us() const { return scans.empty() ? 0 : scans.back().time_us; }
};

// The scan as a full turn of a lidar: the recorded rays, and rays that measured nothing in the
// directions that were not recorded. At most Scan::kMaxPoints.
std::vector<ScanPoint> full_turn(const RecordedScan& scan);

// The file: the line "IVFM-RECORDING 1 <source>\n"; u32 number of scans; for each: u32 time in ms,
// i32 x, i32 y in um, u16 heading, u16 first bearing, u16 aperture (binary angles), u16 number of
// rays, u16 range in mm for each ray; u32 CRC-32 of everything before. Little endian.
std::vector<std::uint8_t> encode_recording(const Recording& recording);
// Throws std::runtime_error that says what is wrong where.
Recording decode_recording(std::span<const std::uint8_t> bytes);

// The same with a file. Throw std::runtime_error that names the path. Of a file that was cut off
// the scans before that are read, with a warning.
void write_recording(const std::filesystem::path& path, const Recording& recording);
Recording read_recording(const std::filesystem::path& path);
// Whether the file begins like a recording.
bool is_recording(const std::filesystem::path& path);

}  // namespace ivfm::host
