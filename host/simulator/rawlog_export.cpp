#include "host/simulator/rawlog_export.h"

#include <mrpt/io/CFileGZOutputStream.h>
#include <mrpt/obs/CObservation2DRangeScan.h>
#include <mrpt/obs/CObservationOdometry.h>
#include <mrpt/serialization/CArchive.h>

#include <stdexcept>

namespace ivfm::host {
namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kMaxRangeM = 60;  // more than any range in a recording's 16 bits of mm

mrpt::poses::CPose2D to_mrpt(const Pose& pose) {
  return {pose.position.x_um / 1e6, pose.position.y_um / 1e6, pose.heading.radians()};
}

// A rawlog is a plain sequence of serialized observations.
class RawlogWriter {
 public:
  explicit RawlogWriter(const std::filesystem::path& path) : path_(path) {
    if (!stream_.open(path.string())) fail();
  }
  void write(const mrpt::serialization::CSerializable& object) {
    mrpt::serialization::archiveFrom(stream_) << object;
  }
  void odometry(double unix_s, const std::string& label, const Pose& pose) {
    mrpt::obs::CObservationOdometry observation;
    observation.timestamp = mrpt::Clock::fromDouble(unix_s);
    observation.sensorLabel = label;
    observation.odometry = to_mrpt(pose);
    write(observation);
  }
  void close() {
    stream_.close();
    std::error_code error;
    if (std::filesystem::file_size(path_, error) == 0 || error) fail();
  }

 private:
  [[noreturn]] void fail() const {
    throw std::runtime_error("rawlog '" + path_.string() + "' cannot be written");
  }
  std::filesystem::path path_;
  mrpt::io::CFileGZOutputStream stream_;
};

mrpt::obs::CObservation2DRangeScan to_mrpt(const RecordedScan& scan, double unix_s) {
  mrpt::obs::CObservation2DRangeScan out;
  out.timestamp = mrpt::Clock::fromDouble(unix_s);
  out.sensorLabel = "lidar";
  out.rightToLeft = true;
  out.maxRange = kMaxRangeM;
  out.aperture = static_cast<float>(scan.aperture / 65536.0 * kTurn);
  // MRPT's rays are symmetric about the sensor's x axis; ours begin at `first_bearing`.
  const double first = scan.first_bearing.radians();
  out.sensorPose = mrpt::poses::CPose3D(0, 0, 0, first + scan.aperture / 65536.0 * kTurn / 2, 0, 0);
  out.resizeScan(scan.ranges_mm.size());
  for (std::size_t i = 0; i < scan.ranges_mm.size(); ++i) {
    out.setScanRange(i, static_cast<float>(scan.ranges_mm[i] / 1e3));
    out.setScanRangeValidity(i, scan.ranges_mm[i] != 0);
  }
  return out;
}

}  // namespace

void write_pose_rawlog(const std::filesystem::path& path, const std::vector<TimedPose>& poses,
                       const std::function<void(std::size_t)>& progress) {
  RawlogWriter rawlog(path);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    rawlog.odometry(poses[i].unix_s, poses[i].label, poses[i].pose);
    if (progress && i % 4096 == 0) progress(i);
  }
  rawlog.close();
}

void write_scan_rawlog(const std::filesystem::path& path, const Recording& recording,
                       double start_unix_s) {
  RawlogWriter rawlog(path);
  for (const RecordedScan& scan : recording.scans) {
    const double unix_s = start_unix_s + static_cast<double>(scan.time_us) / 1e6;
    rawlog.odometry(unix_s, "odometry", scan.lidar_pose);
    rawlog.write(to_mrpt(scan, unix_s));
  }
  rawlog.close();
}

}  // namespace ivfm::host
