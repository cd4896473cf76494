// Angles as 16-bit binary angles and integer trigonometry: the same bits on every target.
#pragma once

#include <array>
#include <cstdint>

namespace ivfm {

// An angle in units of a 65536th of a turn; wraps by itself. Counter-clockwise positive (REP 103).
class BinaryAngle {
 public:
  constexpr BinaryAngle() = default;
  constexpr explicit BinaryAngle(std::uint16_t raw) : raw_(raw) {}

  static constexpr BinaryAngle from_degrees(double degrees) { return from_turns(degrees / 360.0); }
  static constexpr BinaryAngle from_radians(double radians) {
    return from_turns(radians / 6.283185307179586);
  }

  constexpr std::uint16_t raw() const { return raw_; }
  // In (-32768 .. 32767], i.e. the representative in [-pi, pi).
  constexpr std::int16_t signed_raw() const { return static_cast<std::int16_t>(raw_); }
  constexpr double radians() const { return signed_raw() * (6.283185307179586 / 65536.0); }
  constexpr double degrees() const { return signed_raw() * (360.0 / 65536.0); }

  constexpr BinaryAngle operator+(BinaryAngle o) const { return wrap(raw_ + o.raw_); }
  constexpr BinaryAngle operator-(BinaryAngle o) const { return wrap(raw_ - o.raw_); }
  constexpr BinaryAngle operator-() const { return wrap(-raw_); }
  constexpr bool operator==(const BinaryAngle&) const = default;

 private:
  static constexpr BinaryAngle wrap(int raw) {
    return BinaryAngle(static_cast<std::uint16_t>(static_cast<unsigned>(raw) & 0xffffu));
  }
  static constexpr BinaryAngle from_turns(double turns) {
    const double scaled = turns * 65536.0;
    const auto rounded = static_cast<std::int64_t>(scaled + (scaled < 0 ? -0.5 : 0.5));
    return BinaryAngle(static_cast<std::uint16_t>(static_cast<std::uint64_t>(rounded) & 0xffffu));
  }

  std::uint16_t raw_ = 0;
};

namespace detail {

inline constexpr int kSineSteps = 1024;  // table entries per quarter turn

// sin(x) for x in [0, pi/2] by its Taylor series; only ever run by the compiler.
consteval double taylor_sine(double x) {
  double term = x, sum = x;
  for (int n = 1; n < 14; ++n) {
    term *= -x * x / ((2.0 * n) * (2.0 * n + 1.0));
    sum += term;
  }
  return sum;
}

consteval auto make_sine_table() {
  std::array<std::int32_t, kSineSteps + 1> table{};
  for (int i = 0; i <= kSineSteps; ++i) {
    const double s = taylor_sine(1.5707963267948966 * i / kSineSteps);
    table[static_cast<std::size_t>(i)] = static_cast<std::int32_t>(s * (1 << 30) + 0.5);
  }
  return table;
}

inline constexpr auto kSineTable = make_sine_table();

// atan(t) for t in [0, 1] in binary angle units, by Euler's series; only run by the compiler.
consteval auto make_arctan_table() {
  std::array<std::uint16_t, 257> table{};
  for (int i = 0; i <= 256; ++i) {
    const double t = i / 256.0;
    double term = t / (1 + t * t), sum = term;
    for (int n = 1; n < 60; ++n) {
      term *= 2.0 * n * t * t / ((2.0 * n + 1.0) * (1 + t * t));
      sum += term;
    }
    // Kept with two more bits than a binary angle has (units of 2^-18 turn).
    table[static_cast<std::size_t>(i)] =
        static_cast<std::uint16_t>(sum / 6.283185307179586 * 262144.0 + 0.5);
  }
  return table;
}

inline constexpr auto kArctanTable = make_arctan_table();

}  // namespace detail

// sin(angle) in Q30 (1.0 = 2^30); at most 1.3e-6 off.
constexpr std::int32_t sin_q30(BinaryAngle angle) {
  const unsigned quadrant = angle.raw() >> 14;
  unsigned in_quadrant = angle.raw() & 0x3fffu;
  if (quadrant & 1u) in_quadrant = 0x4000u - in_quadrant;
  const unsigned index = in_quadrant >> 4;
  const auto fraction = static_cast<std::int64_t>(in_quadrant & 15u);
  const std::int64_t low = detail::kSineTable[index];
  const std::int64_t high = detail::kSineTable[index + (index < detail::kSineSteps ? 1 : 0)];
  const auto value = static_cast<std::int32_t>(low + (((high - low) * fraction) >> 4));
  return quadrant & 2u ? -value : value;
}

// cos(angle) in Q30.
constexpr std::int32_t cos_q30(BinaryAngle angle) {
  return sin_q30(angle + BinaryAngle(std::uint16_t{0x4000}));
}

// `length` times sin or cos, rounded to nearest; |length| < 2^31.
constexpr std::int32_t scale_q30(std::int32_t length, std::int32_t factor_q30) {
  return static_cast<std::int32_t>(
      (static_cast<std::int64_t>(length) * factor_q30 + (std::int64_t{1} << 29)) >> 30);
}

// The direction of (x, y); 0 for the zero vector. At most 2 units (0.011 deg) off. |x|, |y| < 2^31.
constexpr BinaryAngle atan2_binary(std::int64_t y, std::int64_t x) {
  const std::int64_t ax = x < 0 ? -x : x, ay = y < 0 ? -y : y;
  const std::int64_t high = ax > ay ? ax : ay, low = ax > ay ? ay : ax;
  if (high == 0) return BinaryAngle();
  // The same quotient either way; 32-bit division is several times cheaper on small targets.
  const std::uint32_t ratio_q16 =
      high < 0x10000 ? (static_cast<std::uint32_t>(low) << 16) / static_cast<std::uint32_t>(high)
                     : static_cast<std::uint32_t>((low << 16) / high);
  const std::uint32_t index = ratio_q16 >> 8, fraction = ratio_q16 & 0xffu;
  const std::uint32_t a = detail::kArctanTable[index];
  const std::uint32_t b = detail::kArctanTable[index < 256 ? index + 1 : 256];
  std::uint32_t angle = (a + (((b - a) * fraction) >> 8) + 2) >> 2;  // in [0, 1/8 turn]
  if (ay > ax) angle = 0x4000u - angle;
  if (x < 0) angle = 0x8000u - angle;
  if (y < 0) angle = 0u - angle;
  return BinaryAngle(static_cast<std::uint16_t>(angle & 0xffffu));
}

}  // namespace ivfm
