// IEEE 754 binary16 ("half") as bits: from and to integers and float, rounded to nearest even.
#pragma once

#include <cstdint>

#include "shared/geometry/binary_angle.h"
#include "shared/geometry/pose.h"
#include "shared/status/status.h"

namespace ivfm {

// A binary16 value as its bits: sign, 5 exponent bits (bias 15), 10 fraction bits.
using Float16 = std::uint16_t;

// Metres from micrometres. Every int32 is representable (at most 2,147.5 m; steps of 2 m there,
// 1 mm near 1.5 m). Integer arithmetic only.
Float16 float16_from_um(std::int32_t um);
// Micrometres from metres, rounded to nearest, ties away from zero. kOutOfRange: infinite, not a
// number, or beyond int32.
Result<std::int32_t> um_from_float16(Float16 metres);

// Radians in [-pi, pi) from a binary angle; at worst 1 mrad off. Integer arithmetic only.
Float16 float16_from_angle(BinaryAngle angle);
// A binary angle from radians. kOutOfRange: infinite, not a number, or |angle| >= 8 rad.
Result<BinaryAngle> angle_from_float16(Float16 radians);

// Any float; overflow gives infinity, a NaN gives a quiet NaN.
Float16 float16_from_float(float value);
// Exact.
float float_from_float16(Float16 value);

// A pose as three binary16 (x and y in metres, heading in radians), as the paper sends it.
struct PackedPose {
  Float16 x = 0;
  Float16 y = 0;
  Float16 heading = 0;
  constexpr bool operator==(const PackedPose&) const = default;
};

PackedPose pack_pose(const Pose& pose);
// kOutOfRange as above.
Result<Pose> unpack_pose(const PackedPose& packed);

}  // namespace ivfm
