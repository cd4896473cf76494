#include "host/simulator/rawlog_replay.h"

#include <mrpt/io/CMemoryStream.h>
#include <mrpt/obs/CActionCollection.h>
#include <mrpt/obs/CActionRobotMovement2D.h>
#include <mrpt/obs/CObservation2DRangeScan.h>
#include <mrpt/obs/CObservationOdometry.h>
#include <mrpt/obs/CSensoryFrame.h>
#include <mrpt/rtti/CObject.h>
#include <mrpt/serialization/CArchive.h>
#include <zlib.h>

#include <cmath>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace ivfm::host {

namespace {

constexpr double kTurn = 6.283185307179586;
constexpr std::size_t kMaxFileBytes = std::size_t{1} << 30;
constexpr double kMaxCoordinateM = 2000;  // int32 micrometres reach a little farther

struct PoseOutOfRange : std::runtime_error {
  using std::runtime_error::runtime_error;
};

std::int32_t micrometres(double metres) {
  if (!(std::abs(metres) < kMaxCoordinateM)) {
    throw PoseOutOfRange("a pose lies " + std::to_string(metres) + " m from the start");
  }
  return static_cast<std::int32_t>(std::lround(metres * 1e6));
}

std::uint16_t binary_angle_units(double radians) {
  return static_cast<std::uint16_t>(std::lround(radians / kTurn * 65536.0) & 0xffff);
}

// Gathers scans in the order of the log.
class Collector {
 public:
  Collector(Recording& recording, std::uint16_t max_range_mm)
      : recording_(recording), max_range_mm_(max_range_mm) {}

  void add_motion(const mrpt::obs::CActionCollection& actions) {
    const auto movement = actions.getBestMovementEstimation();
    if (movement) odometry_ = odometry_ + movement->poseChange->getMeanVal();
  }
  void add(const mrpt::obs::CObservation::Ptr& observation) {
    if (const auto odo = std::dynamic_pointer_cast<mrpt::obs::CObservationOdometry>(observation)) {
      odometry_ = odo->odometry;
    }
    if (const auto scan =
            std::dynamic_pointer_cast<mrpt::obs::CObservation2DRangeScan>(observation)) {
      add_scan(*scan);
    }
  }

 private:
  void add_scan(const mrpt::obs::CObservation2DRangeScan& scan) {
    const std::size_t rays = scan.getScanSize();
    if (rays < 2) return;
    const double time_s = mrpt::Clock::toDouble(scan.timestamp);
    if (recording_.scans.empty()) {
      first_time_s_ = time_s;
      const mrpt::poses::CPose2D mount(scan.sensorPose);
      recording_.lidar_in_robot = {{micrometres(mount.x()), micrometres(mount.y())},
                                   BinaryAngle(binary_angle_units(mount.phi()))};
      origin_ = mrpt::poses::CPose2D(mrpt::poses::CPose3D(odometry_) + scan.sensorPose);
    }
    const mrpt::poses::CPose2D lidar =
        mrpt::poses::CPose2D(mrpt::poses::CPose3D(odometry_) + scan.sensorPose) - origin_;
    RecordedScan recorded;
    recorded.time_us =
        static_cast<TimeUs>(std::lround(std::max(0.0, time_s - first_time_s_) * 1000)) * 1000;
    recorded.lidar_pose = {{micrometres(lidar.x()), micrometres(lidar.y())},
                           BinaryAngle(binary_angle_units(lidar.phi()))};
    recorded.first_bearing = BinaryAngle(binary_angle_units(-scan.aperture / 2));
    recorded.aperture =
        static_cast<std::uint16_t>(std::min(65535l, std::lround(scan.aperture / kTurn * 65536.0)));
    for (std::size_t i = 0; i < rays; ++i) {
      recorded.ranges_mm.push_back(range_mm(scan, scan.rightToLeft ? i : rays - 1 - i));
    }
    recording_.scans.push_back(std::move(recorded));
  }

  std::uint16_t range_mm(const mrpt::obs::CObservation2DRangeScan& scan, std::size_t ray) const {
    const double range = std::round(static_cast<double>(scan.getScanRange(ray)) * 1000);
    const bool measured = scan.getScanRangeValidity(ray) && range > 0 && range <= max_range_mm_;
    return measured ? static_cast<std::uint16_t>(range) : std::uint16_t{0};
  }

  Recording& recording_;
  std::uint16_t max_range_mm_;
  mrpt::poses::CPose2D odometry_, origin_;
  double first_time_s_ = 0;
};

struct FileContents {
  std::vector<char> bytes;
  bool whole = true;  // false: a compressed file that breaks off
};

// Reads a plain or gzip file. A compressed one is checked against its own checksum before anything
// is parsed, since MRPT allocates whatever a damaged length says. Throws std::runtime_error.
FileContents read_file(const std::filesystem::path& path) {
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(
      std::filesystem::is_regular_file(path) ? ::gzopen(path.c_str(), "rb") : nullptr, ::gzclose);
  if (!file) throw std::runtime_error("cannot open " + path.string());
  FileContents contents;
  std::vector<char> chunk(1 << 16);
  for (;;) {
    const int size = ::gzread(file.get(), chunk.data(), static_cast<unsigned>(chunk.size()));
    if (size > 0) contents.bytes.insert(contents.bytes.end(), chunk.begin(), chunk.begin() + size);
    if (size < static_cast<int>(chunk.size())) break;
    if (contents.bytes.size() > kMaxFileBytes) {
      throw std::runtime_error(path.string() + " is larger than 1 GiB");
    }
  }
  int error = Z_OK;
  ::gzerror(file.get(), &error);
  if (error != Z_OK && error != Z_BUF_ERROR && error != Z_STREAM_END) {
    throw std::runtime_error(path.string() + " is damaged (gzip checksum or structure)");
  }
  contents.whole = error != Z_BUF_ERROR;
  return contents;
}

// MRPT's own loader prints page-long traces for a broken file, so the objects are read here, one by
// one. Returns false when the file breaks off in the middle of one.
bool collect(mrpt::serialization::CArchive& archive, Collector& collector) {
  try {
    for (;;) {
      const mrpt::serialization::CSerializable::Ptr object = archive.ReadObject();
      if (const auto actions = std::dynamic_pointer_cast<mrpt::obs::CActionCollection>(object)) {
        collector.add_motion(*actions);
      } else if (const auto frame = std::dynamic_pointer_cast<mrpt::obs::CSensoryFrame>(object)) {
        for (const auto& observation : *frame) collector.add(observation);
      } else if (const auto alone = std::dynamic_pointer_cast<mrpt::obs::CObservation>(object)) {
        collector.add(alone);
      }
    }
  } catch (const mrpt::serialization::CExceptionEOF&) {
    return true;
  } catch (const PoseOutOfRange&) {
    throw;
  } catch (const std::exception&) {
    return false;
  }
}

}  // namespace

Recording load_rawlog(const std::filesystem::path& path, std::uint16_t max_range_mm) {
  const FileContents contents = read_file(path);
  mrpt::io::CMemoryStream stream;
  stream.assignMemoryNotOwn(contents.bytes.data(), contents.bytes.size());
  mrpt::rtti::registerAllPendingClasses();
  Recording recording;
  recording.source = path.filename().string();
  Collector collector(recording, max_range_mm);
  bool whole = false;
  try {
    auto archive = mrpt::serialization::archiveFrom(stream);
    whole = collect(archive, collector) && contents.whole;
  } catch (const PoseOutOfRange& error) {
    throw std::runtime_error(path.string() + ": " + error.what());
  }
  if (recording.scans.empty()) {
    throw std::runtime_error(path.string() + " is no rawlog with 2D range scans");
  }
  if (!whole) {
    recording.warning = path.string() + " breaks off after " +
                        std::to_string(recording.scans.size()) + " scans; only these are used";
  }
  return recording;
}

}  // namespace ivfm::host
