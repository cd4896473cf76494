#include "host/log_analysis/pose_errors.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ivfm::host {
namespace {

constexpr double kLongestDelayS = 0.3, kDelayStepS = 0.01;
constexpr double kLongestGapS = 1;  // in the truth

struct Sample {
  double time_s = 0, x_m = 0, y_m = 0, heading_rad = 0;
};

double wrapped(double angle_rad) { return std::remainder(angle_rad, 2 * std::numbers::pi); }

std::vector<Sample> read_samples(SqliteConnection& connection, const char* sql,
                                 std::uint16_t robot) {
  std::vector<Sample> samples;
  SqliteStatement rows(connection, sql);
  rows.bind(std::int64_t{robot});
  while (rows.row()) {
    samples.push_back({static_cast<double>(rows.integer(0)) / 1e6,
                       static_cast<double>(rows.integer(1)) / 1e6,
                       static_cast<double>(rows.integer(2)) / 1e6,
                       static_cast<double>(rows.integer(3)) * std::numbers::pi / 32768});
  }
  return samples;
}

// The robot's true pose at a time, straight between two samples; false where there are none.
bool truth_at(const std::vector<Sample>& truth, double time_s, Sample& out) {
  const auto after = std::upper_bound(truth.begin(), truth.end(), time_s,
                                      [](double t, const Sample& s) { return t < s.time_s; });
  if (after == truth.begin() || after == truth.end()) return false;
  const Sample &b = *after, &a = *std::prev(after);
  if (b.time_s - a.time_s > kLongestGapS) return false;
  const double share = (time_s - a.time_s) / (b.time_s - a.time_s);
  out = {time_s, a.x_m + share * (b.x_m - a.x_m), a.y_m + share * (b.y_m - a.y_m),
         a.heading_rad + share * wrapped(b.heading_rad - a.heading_rad)};
  return true;
}

// Mean square of the heading's error when poses come so late.
double heading_square(const std::vector<Sample>& poses, const std::vector<Sample>& truth,
                      double delay_s) {
  double sum = 0, count = 0;
  Sample real;
  for (const Sample& pose : poses) {
    if (!truth_at(truth, pose.time_s - delay_s, real)) continue;
    const double turn = wrapped(pose.heading_rad - real.heading_rad);
    sum += turn * turn;
    ++count;
  }
  return count > 0 ? sum / count : 0;
}

double delay_of(const std::vector<Sample>& poses, const std::vector<Sample>& truth) {
  double best_s = 0, least = heading_square(poses, truth, 0);
  for (double delay_s = kDelayStepS; delay_s <= kLongestDelayS; delay_s += kDelayStepS) {
    const double square = heading_square(poses, truth, delay_s);
    if (square >= least) continue;
    least = square;
    best_s = delay_s;
  }
  return best_s;
}

PoseErrors compare(const std::vector<Sample>& poses, const std::vector<Sample>& truth) {
  PoseErrors errors;
  errors.delay_s = delay_of(poses, truth);
  Sample real;
  for (const Sample& pose : poses) {
    if (!truth_at(truth, pose.time_s - errors.delay_s, real)) continue;
    const double off_m = std::hypot(pose.x_m - real.x_m, pose.y_m - real.y_m);
    const double off_deg =
        std::abs(wrapped(pose.heading_rad - real.heading_rad)) * 180 / std::numbers::pi;
    errors.position_m.emplace_back(pose.time_s, off_m);
    errors.heading_deg.emplace_back(pose.time_s, off_deg);
    errors.rms_m += off_m * off_m;
    errors.rms_deg += off_deg * off_deg;
    errors.largest_m = std::max(errors.largest_m, off_m);
    errors.largest_deg = std::max(errors.largest_deg, off_deg);
  }
  errors.poses = errors.position_m.size();
  const auto count = static_cast<double>(std::max<std::size_t>(errors.poses, 1));
  errors.rms_m = std::sqrt(errors.rms_m / count);
  errors.rms_deg = std::sqrt(errors.rms_deg / count);
  return errors;
}

// The largest of every so many points, so that no peak is lost.
void thin(std::vector<std::pair<double, double>>& curve, std::size_t most) {
  const std::size_t every = (curve.size() + most - 1) / most;
  if (every <= 1) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < curve.size(); i += every) {
    const auto begin = curve.begin() + static_cast<std::ptrdiff_t>(i);
    const auto end = curve.begin() + static_cast<std::ptrdiff_t>(std::min(i + every, curve.size()));
    curve[kept++] = *std::max_element(
        begin, end, [](const auto& a, const auto& b) { return a.second < b.second; });
  }
  curve.resize(kept);
}

}  // namespace

PoseErrors over_all(const std::map<std::uint16_t, PoseErrors>& robots) {
  PoseErrors all;
  for (const auto& [robot, errors] : robots) {
    const auto count = static_cast<double>(errors.poses);
    all.poses += errors.poses;
    all.rms_m += count * errors.rms_m * errors.rms_m;
    all.rms_deg += count * errors.rms_deg * errors.rms_deg;
    all.largest_m = std::max(all.largest_m, errors.largest_m);
    all.largest_deg = std::max(all.largest_deg, errors.largest_deg);
    all.delay_s = std::max(all.delay_s, errors.delay_s);
  }
  const auto count = static_cast<double>(std::max<std::size_t>(all.poses, 1));
  all.rms_m = std::sqrt(all.rms_m / count);
  all.rms_deg = std::sqrt(all.rms_deg / count);
  return all;
}

std::map<std::uint16_t, PoseErrors> load_pose_errors(SqliteConnection& connection,
                                                     std::size_t most_points) {
  std::map<std::uint16_t, PoseErrors> errors;
  if (!connection.integer("SELECT 1 FROM sqlite_master WHERE name = 'truth'")) return errors;
  SqliteStatement robots(connection, "SELECT DISTINCT robot FROM truth");
  while (robots.row()) {
    const auto robot = static_cast<std::uint16_t>(robots.integer(0));
    const auto truth = read_samples(
        connection, "SELECT time_us, x_um, y_um, heading FROM truth WHERE robot = ? ORDER BY 1",
        robot);
    const auto poses = read_samples(
        connection, "SELECT time_us, x_um, y_um, heading FROM poses WHERE robot = ? ORDER BY 1",
        robot);
    PoseErrors found = compare(poses, truth);
    if (found.poses == 0) continue;
    thin(found.position_m, most_points);
    thin(found.heading_deg, most_points);
    errors[robot] = std::move(found);
  }
  return errors;
}

}  // namespace ivfm::host
