#include "host/simulator/recording.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "shared/wire/byte_reader.h"
#include "shared/wire/crc.h"

namespace ivfm::host {

namespace {

constexpr std::string_view kMagic = "IVFM-RECORDING 1 ";
constexpr std::size_t kMaxSourceLine = 512;
constexpr std::uint32_t kMaxScans = 1'000'000;
constexpr std::uint16_t kMaxRays = 1440;  // with the rays around them they must fit into a Scan
constexpr double kFullTurn = 65536.0;

void append(std::vector<std::uint8_t>& bytes, std::uint32_t value, int size) {
  for (int i = 0; i < size; ++i) bytes.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error("broken recording: " + what);
}

RecordedScan decode_scan(ByteReader& reader, std::uint32_t index) {
  RecordedScan scan;
  scan.time_us = TimeUs{reader.u32()} * 1000;
  scan.lidar_pose.position.x_um = reader.i32();
  scan.lidar_pose.position.y_um = reader.i32();
  scan.lidar_pose.heading = BinaryAngle(reader.u16());
  scan.first_bearing = BinaryAngle(reader.u16());
  scan.aperture = reader.u16();
  const std::uint16_t rays = reader.u16();
  if (rays > kMaxRays || reader.remaining() < std::size_t{rays} * 2) {
    fail("scan " + std::to_string(index) + " claims " + std::to_string(rays) + " rays");
  }
  for (std::uint16_t i = 0; i < rays; ++i) scan.ranges_mm.push_back(reader.u16());
  return scan;
}

}  // namespace

BinaryAngle RecordedScan::bearing_of(std::size_t ray) const {
  const std::size_t steps = ranges_mm.size() > 1 ? ranges_mm.size() - 1 : 1;
  const std::size_t offset = (std::size_t{aperture} * ray * 2 + steps) / (2 * steps);
  return first_bearing + BinaryAngle(static_cast<std::uint16_t>(offset));
}

std::vector<ScanPoint> full_turn(const RecordedScan& scan) {
  std::vector<ScanPoint> points;
  const std::size_t rays = scan.ranges_mm.size();
  for (std::size_t i = 0; i < rays; ++i) {
    const std::uint16_t range_mm = scan.ranges_mm[i];
    const Echo echo = range_mm > 0 ? Echo::kHit : Echo::kNothing;
    points.push_back({scan.bearing_of(i), range_mm, echo, 47});
  }
  if (rays < 2 || scan.aperture == 0) return points;
  const double step = static_cast<double>(scan.aperture) / static_cast<double>(rays - 1);
  for (double offset = scan.aperture + step; offset < kFullTurn - step / 2; offset += step) {
    if (points.size() == Scan::kMaxPoints) break;
    const BinaryAngle bearing =
        scan.first_bearing + BinaryAngle(static_cast<std::uint16_t>(offset));
    points.push_back({bearing, 0, Echo::kNothing, 0});
  }
  return points;
}

std::vector<std::uint8_t> encode_recording(const Recording& recording) {
  std::string line = std::string(kMagic) + recording.source.substr(0, kMaxSourceLine / 2);
  std::replace(line.begin(), line.end(), '\n', ' ');
  line += '\n';
  std::vector<std::uint8_t> bytes(line.begin(), line.end());
  append(bytes, static_cast<std::uint32_t>(recording.scans.size()), 4);
  for (const RecordedScan& scan : recording.scans) {
    append(bytes, static_cast<std::uint32_t>(scan.time_us / 1000), 4);
    append(bytes, static_cast<std::uint32_t>(scan.lidar_pose.position.x_um), 4);
    append(bytes, static_cast<std::uint32_t>(scan.lidar_pose.position.y_um), 4);
    append(bytes, scan.lidar_pose.heading.raw(), 2);
    append(bytes, scan.first_bearing.raw(), 2);
    append(bytes, scan.aperture, 2);
    append(bytes, static_cast<std::uint32_t>(scan.ranges_mm.size()), 2);
    for (const std::uint16_t range_mm : scan.ranges_mm) append(bytes, range_mm, 2);
  }
  append(bytes, crc32(bytes), 4);
  return bytes;
}

Recording decode_recording(std::span<const std::uint8_t> bytes) {
  if (bytes.size() < kMagic.size() ||
      !std::equal(kMagic.begin(), kMagic.end(), bytes.begin(),
                  [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; })) {
    fail("it does not begin with \"" + std::string(kMagic) + "\"");
  }
  const auto head = bytes.first(std::min(bytes.size(), kMaxSourceLine));
  const auto line_end = std::find(head.begin(), head.end(), std::uint8_t{'\n'});
  if (line_end == head.end()) fail("its first line does not end");
  Recording recording;
  recording.source.assign(head.begin() + kMagic.size(), line_end);

  if (bytes.size() < static_cast<std::size_t>(line_end - head.begin()) + 9) fail("it is cut off");
  ByteReader tail(bytes.last(4));
  if (tail.u32() != crc32(bytes.first(bytes.size() - 4))) fail("its checksum is wrong");
  ByteReader reader(
      bytes.first(bytes.size() - 4).subspan(static_cast<std::size_t>(line_end - head.begin()) + 1));
  const std::uint32_t count = reader.u32();
  if (count > kMaxScans) fail("it claims " + std::to_string(count) + " scans");
  for (std::uint32_t i = 0; i < count && reader.ok(); ++i) {
    recording.scans.push_back(decode_scan(reader, i));
  }
  if (!reader.ok()) fail("it is cut off in scan " + std::to_string(recording.scans.size() - 1));
  if (reader.remaining() != 0) fail("bytes follow its last scan");
  return recording;
}

void write_recording(const std::filesystem::path& path, const Recording& recording) {
  const auto bytes = encode_recording(recording);
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  file.close();
  if (!file) throw std::runtime_error("cannot write " + path.string());
}

namespace {

// The scans before the place where a file was cut off; none when it was not.
Recording decode_beginning(std::span<const std::uint8_t> bytes) {
  Recording recording;
  const auto head = bytes.first(std::min(bytes.size(), kMaxSourceLine));
  const auto line_end = std::find(head.begin(), head.end(), std::uint8_t{'\n'});
  const auto line_bytes = static_cast<std::size_t>(line_end - head.begin());
  if (line_bytes < kMagic.size() || line_end == head.end()) return {};
  recording.source.assign(head.begin() + kMagic.size(), line_end);
  ByteReader reader(bytes.subspan(line_bytes + 1));
  const std::uint32_t count = std::min(reader.u32(), kMaxScans);
  try {
    for (std::uint32_t i = 0; i < count; ++i) {
      RecordedScan scan = decode_scan(reader, i);
      if (!reader.ok()) break;
      recording.scans.push_back(std::move(scan));
    }
  } catch (const std::runtime_error&) {
    // The last scan is not whole.
  }
  if (recording.scans.size() == count) return {};
  recording.warning = "breaks off after " + std::to_string(recording.scans.size()) + " of " +
                      std::to_string(count) + " scans; only these are used";
  return recording;
}

}  // namespace

bool is_recording(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string start(kMagic.size(), '\0');
  file.read(start.data(), static_cast<std::streamsize>(start.size()));
  return file && start == kMagic;
}

Recording read_recording(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot open " + path.string());
  const std::vector<char> text{std::istreambuf_iterator<char>(file), {}};
  const std::span bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  try {
    return decode_recording(bytes);
  } catch (const std::runtime_error& error) {
    if (is_recording(path)) {
      Recording beginning = decode_beginning(bytes);
      if (!beginning.scans.empty()) {
        beginning.warning = path.string() + " " + beginning.warning;
        return beginning;
      }
    }
    throw std::runtime_error(path.string() + ": " + error.what());
  }
}

}  // namespace ivfm::host
