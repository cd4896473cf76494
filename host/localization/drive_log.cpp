#include "host/localization/drive_log.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <random>
#include <span>
#include <stdexcept>

namespace ivfm::host {
namespace {

// Two wheels whose encoders are wrong.
class WrongEncoders {
 public:
  WrongEncoders(const OdometryNoise& noise, const WheelGeometry& wheels, std::mt19937_64& random)
      : random_(random),
        metres_per_count_(wheels.wheel_circumference_um * 1e-6 / wheels.counts_per_turn),
        slip_(noise.slip_m_per_sqrt_m) {
    left_scale_ += noise.radius_error * normal_(random_);
    right_scale_ += noise.radius_error * normal_(random_);
    base_scale_ += noise.wheel_base_error * normal_(random_);
  }
  // Advances by true wheel motions in counts.
  void roll(double left, double right) {
    const double middle = (left + right) / 2, half = (right - left) / 2 * base_scale_;
    left_ += with_slip(middle - half, left_scale_);
    right_ += with_slip(middle + half, right_scale_);
  }
  std::int32_t left() const { return static_cast<std::int32_t>(std::llround(left_)); }
  std::int32_t right() const { return static_cast<std::int32_t>(std::llround(right_)); }

 private:
  double with_slip(double counts, double scale) {
    const double slip_m = slip_ * std::sqrt(std::abs(counts) * metres_per_count_);
    return (counts + slip_m * normal_(random_) / metres_per_count_) / scale;
  }

  std::mt19937_64& random_;
  std::normal_distribution<double> normal_;
  double metres_per_count_;
  double slip_;
  double left_scale_ = 1, right_scale_ = 1, base_scale_ = 1;
  double left_ = 0, right_ = 0;
};

void spoil(ScanPoint& point, const SensorNoise& noise, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> share;
  const double range_m = point.range_mm * 1e-3;
  const double error = normal(random) * (noise.lidar.noise_m + noise.lidar.noise_share * range_m);
  const bool dropped = share(random) < noise.lidar.dropout;
  const bool wrong = share(random) < noise.wrong_points;
  const double anywhere_m = noise.lidar.min_range_m + share(random) * 8;
  if (point.echo != Echo::kHit) return;
  if (dropped) {
    point = {point.bearing, 0, Echo::kNothing, 0};
    return;
  }
  const double measured_m = wrong ? anywhere_m : range_m + error;
  point.range_mm =
      static_cast<std::uint16_t>(std::lround(std::clamp(measured_m * 1000, 1.0, 12'000.0)));
}

template <typename T>
void write(std::ofstream& out, const std::vector<T>& values) {
  const std::size_t size = values.size();
  out.write(reinterpret_cast<const char*>(&size), sizeof size);
  out.write(reinterpret_cast<const char*>(values.data()),
            static_cast<std::streamsize>(size * sizeof(T)));
}

template <typename T>
void read(std::ifstream& in, std::vector<T>& values) {
  std::size_t size = 0;
  in.read(reinterpret_cast<char*>(&size), sizeof size);
  if (!in || size > 100'000'000) throw std::runtime_error("a drive log is cut off");
  values.resize(size);
  in.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(size * sizeof(T)));
}

struct LogHead {
  WheelGeometry wheels;
  Pose start;
  double driven_m;
};

struct RevolutionTimes {
  TimeUs arrived_us, start_us, end_us;
};

}  // namespace

Pose to_pose(const TruePose& pose) {
  return {{static_cast<std::int32_t>(std::lround(pose.x_m * 1e6)),
           static_cast<std::int32_t>(std::lround(pose.y_m * 1e6))},
          BinaryAngle::from_radians(pose.heading_rad)};
}

std::vector<ScanPoint> seen_from_axle(const std::vector<ScanPoint>& points,
                                      const Pose& lidar_in_robot) {
  if (lidar_in_robot == Pose{}) return points;
  std::vector<ScanPoint> moved = points;
  for (ScanPoint& point : moved) {
    const std::int32_t range_um = std::int32_t{point.range_mm} * 1000;
    const Point end = transform(lidar_in_robot, scale_q30(range_um, cos_q30(point.bearing)),
                                scale_q30(range_um, sin_q30(point.bearing)));
    point.bearing = point.echo == Echo::kNothing ? point.bearing + lidar_in_robot.heading
                                                 : atan2_binary(end.y_um, end.x_um);
    const double range_mm = std::hypot(end.x_um, end.y_um) * 1e-3;
    if (point.echo != Echo::kNothing) {
      point.range_mm = static_cast<std::uint16_t>(std::lround(range_mm));
    }
  }
  return moved;
}

SensorNoise SensorNoise::preset(const std::string& name) {
  SensorNoise noise{OdometryNoise::preset(name), LidarModel{}, 0};
  if (name == "none") noise.lidar = LidarModel::preset("none");
  if (name == "harsh") {
    noise.lidar.noise_m = 0.004;
    noise.lidar.noise_share = 0.008;
    noise.lidar.dropout = 0.05;
    noise.wrong_points = 0.05;
  }
  return noise;
}

DriveLog with_noise(const DriveLog& exact, const SensorNoise& noise, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  DriveLog log = exact;
  WrongEncoders encoders(noise.odometry, exact.wheels, random);
  for (std::size_t i = 1; i < log.wheel_samples.size(); ++i) {
    const WheelSample &before = exact.wheel_samples[i - 1], &now = exact.wheel_samples[i];
    encoders.roll(now.left - before.left, now.right - before.right);
    log.wheel_samples[i].left = exact.wheel_samples[0].left + encoders.left();
    log.wheel_samples[i].right = exact.wheel_samples[0].right + encoders.right();
  }
  for (Revolution& revolution : log.revolutions) {
    for (ScanPoint& point : revolution.points) spoil(point, noise, random);
  }
  return log;
}

void save_drive_log(const std::filesystem::path& path, const DriveLog& log) {
  std::ofstream out(path, std::ios::binary);
  const LogHead head{log.wheels, log.start, log.driven_m};
  out.write(reinterpret_cast<const char*>(&head), sizeof head);
  write(out, log.wheel_samples);
  write(out, log.truth);
  std::vector<RevolutionTimes> times;
  for (const Revolution& r : log.revolutions) times.push_back({r.arrived_us, r.start_us, r.end_us});
  write(out, times);
  for (const Revolution& r : log.revolutions) write(out, r.points);
  if (!out.flush()) throw std::runtime_error("cannot write " + path.string());
}

DriveLog load_drive_log(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  LogHead head{};
  in.read(reinterpret_cast<char*>(&head), sizeof head);
  if (!in) throw std::runtime_error("cannot read " + path.string());
  DriveLog log;
  log.wheels = head.wheels;
  log.start = head.start;
  log.driven_m = head.driven_m;
  read(in, log.wheel_samples);
  read(in, log.truth);
  std::vector<RevolutionTimes> times;
  read(in, times);
  for (const RevolutionTimes& t : times) {
    Revolution& revolution = log.revolutions.emplace_back();
    revolution.arrived_us = t.arrived_us;
    revolution.start_us = t.start_us;
    revolution.end_us = t.end_us;
    read(in, revolution.points);
  }
  if (!in) throw std::runtime_error(path.string() + " is cut off");
  return log;
}

}  // namespace ivfm::host
