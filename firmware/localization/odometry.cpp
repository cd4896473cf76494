#include "firmware/localization/odometry.h"

#include <algorithm>

namespace ivfm {
namespace {

// numerator / denominator * 2^bits, rounded down; bit by bit, as 128 bit numbers are not portable.
// Both > 0, denominator < 2^62, result < 2^64.
std::uint64_t fixed_quotient(std::uint64_t numerator, std::uint64_t denominator, int bits) {
  std::uint64_t quotient = numerator / denominator;
  std::uint64_t rest = numerator % denominator;
  for (int i = 0; i < bits; ++i) {
    rest <<= 1;
    quotient = (quotient << 1) | (rest >= denominator ? 1u : 0u);
    if (rest >= denominator) rest -= denominator;
  }
  return quotient;
}

// b - a of counters that wrap around.
std::int32_t wrapped_difference(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(b) - static_cast<std::uint32_t>(a));
}

std::int64_t magnitude(std::int64_t value) { return value < 0 ? -value : value; }

// |value| < 2^33 in Q12 times a Q30 factor, in Q12, rounded to nearest.
std::int64_t scale(std::int64_t value_q12, std::int32_t factor_q30) {
  return (value_q12 * factor_q30 + (std::int64_t{1} << 29)) >> 30;
}

constexpr TimeUs kMaxGapUs = 500'000;      // longer pauses are judged as this long
constexpr std::int64_t kLateUs = 100'000;  // a frame may have come late by so much
constexpr std::int64_t kSlackCounts = 16;  // encoder jitter

}  // namespace

Odometry::Odometry(const WheelGeometry& geometry, std::int32_t max_wheel_um_s) {
  const auto turn_um = static_cast<std::uint64_t>(geometry.wheel_circumference_um);
  const auto counts = static_cast<std::uint64_t>(geometry.counts_per_turn);
  const auto track_um = static_cast<std::uint64_t>(geometry.track_um);
  // heading = (right - left) * turn_um / counts / track [rad], * 65536 / (2 pi), pi = 355/113.
  heading_per_count_q44_ = fixed_quotient(turn_um * 65536 * 113, counts * track_um * 2 * 355, 44);
  distance_per_count_q24_ = fixed_quotient(turn_um, 2 * counts, 24);
  max_wheel_counts_s_ =
      std::int64_t{max_wheel_um_s} * geometry.counts_per_turn / geometry.wheel_circumference_um + 1;
}

void Odometry::reset(const Pose& pose) {
  pose_ = pose;
  start_heading_ = pose.heading;
  difference_counts_ = sum_counts_ = 0;
  x_q12_ = std::int64_t{pose.position.x_um} * 4096;
  y_q12_ = std::int64_t{pose.position.y_um} * 4096;
  has_last_ = has_candidate_ = false;
}

bool Odometry::possible(const Sample& from, const Sample& to) const {
  const auto elapsed_us =
      static_cast<std::int64_t>(std::min(to.measured_us - from.measured_us, kMaxGapUs));
  const std::int64_t limit =
      max_wheel_counts_s_ * (elapsed_us + kLateUs) / 1'000'000 + kSlackCounts;
  return magnitude(wrapped_difference(from.left, to.left)) <= limit &&
         magnitude(wrapped_difference(from.right, to.right)) <= limit;
}

Status Odometry::update(std::int32_t left_counts, std::int32_t right_counts, TimeUs measured_us) {
  const Sample sample{left_counts, right_counts, measured_us};
  if (!has_last_) {
    last_ = sample;
    has_last_ = true;
    return Status::kOk;
  }
  if (measured_us <= last_.measured_us) return Status::kEmpty;
  if (possible(last_, sample)) {
    has_candidate_ = false;
    move(sample);
    return Status::kOk;
  }
  if (has_candidate_ && measured_us > candidate_.measured_us && possible(candidate_, sample)) {
    has_candidate_ = false;
    last_ = candidate_;
    move(sample);
    return Status::kOk;
  }
  candidate_ = sample;
  has_candidate_ = true;
  ++jumps_;
  return Status::kRefused;
}

void Odometry::move(const Sample& to) {
  const std::int64_t left = wrapped_difference(last_.left, to.left);
  const std::int64_t right = wrapped_difference(last_.right, to.right);
  last_ = to;
  // Arithmetic modulo 2^64 keeps every whole turn out and loses nothing.
  const std::uint64_t turned_q44 =
      static_cast<std::uint64_t>(difference_counts_) * heading_per_count_q44_;
  const std::uint64_t step_q44 = static_cast<std::uint64_t>(right - left) * heading_per_count_q44_;
  const auto half_q44 = static_cast<std::uint64_t>(static_cast<std::int64_t>(step_q44) / 2);
  const auto rounded = [this](std::uint64_t angle_q44) {
    const std::uint64_t half_unit = std::uint64_t{1} << 43;
    return start_heading_ + BinaryAngle(static_cast<std::uint16_t>((angle_q44 + half_unit) >> 44));
  };
  const BinaryAngle middle = rounded(turned_q44 + half_q44);
  const auto position_q12 = [this](std::int64_t sum) {
    return static_cast<std::int64_t>(static_cast<std::uint64_t>(sum) * distance_per_count_q24_) >>
           12;
  };
  const std::int64_t distance_q12 =
      position_q12(sum_counts_ + left + right) - position_q12(sum_counts_);
  difference_counts_ += right - left;
  sum_counts_ += left + right;
  travelled_q12_ += static_cast<std::uint64_t>(magnitude(distance_q12));
  x_q12_ += scale(distance_q12, cos_q30(middle));
  y_q12_ += scale(distance_q12, sin_q30(middle));
  pose_.position = {static_cast<std::int32_t>((x_q12_ + 2048) >> 12),
                    static_cast<std::int32_t>((y_q12_ + 2048) >> 12)};
  pose_.heading = rounded(turned_q44 + step_q44);
}

}  // namespace ivfm
