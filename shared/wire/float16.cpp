#include "shared/wire/float16.h"

#include <bit>
#include <limits>

namespace ivfm {
namespace {

constexpr int kFractionBits = 10;
constexpr int kBias = 15;
constexpr int kMinExponent = -14;  // of normal numbers; subnormal ones share it
constexpr Float16 kSignBit = 0x8000;
constexpr Float16 kInfinity = 0x7c00;
constexpr Float16 kQuietNan = 0x7e00;
// pi in Q30, rounded.
constexpr std::uint64_t kPiQ30 = 3373259426u;

constexpr int width_of(std::uint64_t value) { return static_cast<int>(std::bit_width(value)); }

// a / b rounded to nearest, ties to even. Requires b > 0.
constexpr std::uint64_t divide_to_nearest_even(std::uint64_t a, std::uint64_t b) {
  const std::uint64_t quotient = a / b, rest = a % b;
  const bool up = rest > b - rest || (rest == b - rest && (quotient & 1u));
  return quotient + (up ? 1 : 0);
}

// The binary16 nearest to numerator / denominator (>= 0). Requires numerator < 2^48 and
// denominator <= 2^48, so that no shift below overflows.
constexpr Float16 from_ratio(std::uint64_t numerator, std::uint64_t denominator) {
  if (numerator == 0) return 0;
  int exponent = width_of(numerator) - width_of(denominator);
  const bool too_high = exponent >= 0 ? (denominator << exponent) > numerator
                                      : denominator > (numerator << -exponent);
  if (too_high) --exponent;
  if (exponent < kMinExponent) exponent = kMinExponent;
  const int shift = kFractionBits - exponent;
  const std::uint64_t significand = shift >= 0
                                        ? divide_to_nearest_even(numerator << shift, denominator)
                                        : divide_to_nearest_even(numerator, denominator << -shift);
  // A carry out of the significand raises the exponent by itself, up to infinity.
  const std::uint64_t bits =
      (static_cast<std::uint64_t>(exponent + kBias - 1) << kFractionBits) + significand;
  return bits >= kInfinity ? kInfinity : static_cast<Float16>(bits);
}

constexpr Float16 with_sign(Float16 magnitude, bool negative) {
  return static_cast<Float16>(magnitude | (negative ? kSignBit : 0));
}

// The value is significand * 2^(exponent - 10).
struct Parts {
  bool negative;
  int exponent;
  std::uint64_t significand;
};

constexpr bool is_finite(Float16 value) { return (value & kInfinity) != kInfinity; }

constexpr Parts parts_of(Float16 value) {
  const int field = (value >> kFractionBits) & 0x1f;
  const std::uint64_t fraction = value & 0x3ffu;
  if (field == 0) return {(value & kSignBit) != 0, kMinExponent, fraction};
  return {(value & kSignBit) != 0, field - kBias, fraction | 0x400u};
}

// parts * factor / divisor, rounded to nearest, ties away from zero, without its sign. The caller
// makes sure that nothing overflows.
constexpr std::uint64_t scaled(const Parts& parts, std::uint64_t factor, std::uint64_t divisor) {
  const int shift = parts.exponent - kFractionBits;
  std::uint64_t numerator = parts.significand * factor;
  if (shift >= 0) {
    numerator <<= shift;
  } else {
    divisor <<= -shift;
  }
  return (2 * numerator + divisor) / (2 * divisor);
}

}  // namespace

Float16 float16_from_um(std::int32_t um) {
  const std::int64_t wide = um;
  return with_sign(from_ratio(static_cast<std::uint64_t>(wide < 0 ? -wide : wide), 1000000),
                   um < 0);
}

Result<std::int32_t> um_from_float16(Float16 metres) {
  if (!is_finite(metres)) return Status::kOutOfRange;
  const Parts parts = parts_of(metres);
  const auto magnitude = static_cast<std::int64_t>(scaled(parts, 1000000, 1));
  const std::int64_t um = parts.negative ? -magnitude : magnitude;
  if (um > std::numeric_limits<std::int32_t>::max()) return Status::kOutOfRange;
  if (um < std::numeric_limits<std::int32_t>::min()) return Status::kOutOfRange;
  return static_cast<std::int32_t>(um);
}

Float16 float16_from_angle(BinaryAngle angle) {
  const int raw = angle.signed_raw();
  const auto magnitude = static_cast<std::uint64_t>(raw < 0 ? -raw : raw);
  return with_sign(from_ratio(magnitude * kPiQ30, std::uint64_t{1} << 45), raw < 0);
}

Result<BinaryAngle> angle_from_float16(Float16 radians) {
  constexpr Float16 kEight = 0x4800;
  if (!is_finite(radians) || (radians & ~kSignBit) >= kEight) return Status::kOutOfRange;
  const Parts parts = parts_of(radians);
  const std::uint64_t magnitude = scaled(parts, std::uint64_t{1} << 45, kPiQ30);  // * 32768 / pi
  const auto wrapped = static_cast<std::uint16_t>(magnitude & 0xffffu);
  return parts.negative ? -BinaryAngle(wrapped) : BinaryAngle(wrapped);
}

Float16 float16_from_float(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  const bool negative = (bits >> 31) != 0;
  const std::uint32_t magnitude = bits & 0x7fffffffu;
  constexpr std::uint32_t kFloatInfinity = 0x7f800000u;
  if (magnitude > kFloatInfinity) return with_sign(kQuietNan, negative);
  if (magnitude >= 0x47800000u) return with_sign(kInfinity, negative);  // 65536 and more
  if (magnitude < 0x33000000u) return with_sign(0, negative);           // less than 2^-25
  const int exponent = static_cast<int>(magnitude >> 23) - 127;         // -25 .. 15
  const std::uint64_t significand = (magnitude & 0x7fffffu) | 0x800000u;
  return with_sign(from_ratio(significand, std::uint64_t{1} << (23 - exponent)), negative);
}

float float_from_float16(Float16 value) {
  const std::uint32_t sign = static_cast<std::uint32_t>(value & kSignBit) << 16;
  if (!is_finite(value)) {
    return std::bit_cast<float>(sign | 0x7f800000u | ((value & 0x3ffu) << 13));
  }
  const Parts parts = parts_of(value);
  if (parts.significand == 0) return std::bit_cast<float>(sign);
  // Normalise: binary16 subnormals are normal in binary32.
  const int width = width_of(parts.significand);
  const int exponent = parts.exponent - kFractionBits + width - 1;
  const auto fraction = static_cast<std::uint32_t>(parts.significand << (24 - width)) & 0x7fffffu;
  return std::bit_cast<float>(sign | (static_cast<std::uint32_t>(exponent + 127) << 23) | fraction);
}

PackedPose pack_pose(const Pose& pose) {
  return {float16_from_um(pose.position.x_um), float16_from_um(pose.position.y_um),
          float16_from_angle(pose.heading)};
}

Result<Pose> unpack_pose(const PackedPose& packed) {
  const auto x = um_from_float16(packed.x);
  const auto y = um_from_float16(packed.y);
  const auto heading = angle_from_float16(packed.heading);
  if (!x.ok() || !y.ok() || !heading.ok()) return Status::kOutOfRange;
  return Pose{{*x, *y}, *heading};
}

}  // namespace ivfm
