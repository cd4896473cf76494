// A planar velocity setpoint of a differential drive, in integers.
#pragma once

#include <cstdint>

namespace ivfm {

// Forward speed in micrometres a second and turn rate in milliradians a second
// (counter-clockwise positive, REP 103). All zero: stand still.
struct Velocity {
  std::int32_t v_um_s = 0;
  std::int32_t omega_mrad_s = 0;
  constexpr bool operator==(const Velocity&) const = default;
  constexpr bool is_zero() const { return v_um_s == 0 && omega_mrad_s == 0; }
};

}  // namespace ivfm
