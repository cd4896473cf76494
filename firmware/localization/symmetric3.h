// Symmetric 3 x 3 matrices over (x, y, heading): covariances and information. Only IEEE basic
// operations, without contraction: the same bits on every target.
#pragma once

#include <array>

namespace ivfm {

using Vector3 = std::array<double, 3>;

constexpr double dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

struct Symmetric3 {
  double xx = 0, xy = 0, xt = 0, yy = 0, yt = 0, tt = 0;

  constexpr Symmetric3 operator+(const Symmetric3& o) const {
    return {xx + o.xx, xy + o.xy, xt + o.xt, yy + o.yy, yt + o.yt, tt + o.tt};
  }
  constexpr Vector3 operator*(const Vector3& v) const {
    return {xx * v[0] + xy * v[1] + xt * v[2], xy * v[0] + yy * v[1] + yt * v[2],
            xt * v[0] + yt * v[1] + tt * v[2]};
  }
  constexpr Symmetric3 operator*(double factor) const {
    return {xx * factor, xy * factor, xt * factor, yy * factor, yt * factor, tt * factor};
  }
  // Requires a positive definite matrix.
  constexpr Symmetric3 inverse() const {
    const double a = yy * tt - yt * yt, b = xt * yt - xy * tt, c = xy * yt - yy * xt;
    const double scale = 1 / (xx * a + xy * b + xt * c);
    return {a * scale,
            b * scale,
            c * scale,
            (xx * tt - xt * xt) * scale,
            (xy * xt - xx * yt) * scale,
            (xx * yy - xy * xy) * scale};
  }
};

}  // namespace ivfm
