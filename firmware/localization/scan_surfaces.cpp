#include "firmware/localization/scan_surfaces.h"

#include <algorithm>
#include <cstdlib>

#include "shared/geometry/integer_sqrt.h"
#include "shared/geometry/pose.h"

namespace ivfm {

namespace {

// Sums over the points around a sample, in millimetres relative to it.
struct Spread {
  std::int64_t n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;

  void add(Point d) {
    const std::int64_t dx = d.x_um / 1000, dy = d.y_um / 1000;
    ++n;
    x += dx;
    y += dy;
    xx += dx * dx;
    xy += dx * dy;
    yy += dy * dy;
  }
};

// The points next to beam `i` on its surface: up to `reach_um` away, across a few wrong ones.
Spread gather(std::span<const ScanPoint> beams, std::size_t i, Point middle,
              std::int32_t reach_um) {
  constexpr int kMaxWrong = 4;  // in a row
  Spread spread;
  spread.add({0, 0});
  const std::int64_t reach2 = std::int64_t{reach_um} * reach_um;
  for (const int side : {-1, 1}) {
    int wrong = 0;
    for (std::size_t step = 1; step < beams.size() / 8 && wrong <= kMaxWrong; ++step) {
      const std::size_t k = (i + (side < 0 ? beams.size() - step : step)) % beams.size();
      const Point p = beams[k].echo == Echo::kHit ? end_of(beams[k]) : Point{};
      const bool near = squared_distance_um2(p, middle) <= reach2;
      wrong = near ? 0 : wrong + 1;
      if (near) spread.add({p.x_um - middle.x_um, p.y_um - middle.y_um});
    }
  }
  return spread;
}

// The normal of the line through the points, if they lie on one, and the sample moved onto it.
void fit_line(const Spread& s, std::int32_t range_mm, SurfaceSample& sample) {
  if (s.n < 5) return;
  // Scatter about the mean, times n.
  const std::int64_t xx = s.n * s.xx - s.x * s.x, xy = s.n * s.xy - s.x * s.y;
  const std::int64_t yy = s.n * s.yy - s.y * s.y;
  const std::int64_t difference = xx - yy;
  const auto root = static_cast<std::int64_t>(
      integer_sqrt(static_cast<std::uint64_t>(difference * difference + 4 * xy * xy)));
  const std::int64_t along = (xx + yy + root) / 2, across = (xx + yy - root) / 2;
  // Flat: the points scatter no more across than the lidar's noise and the floor plan's edges do.
  const std::int64_t noise_mm = 12 + range_mm / 150;
  if (across > noise_mm * noise_mm * s.n * s.n || along < 8 * across) return;
  const BinaryAngle tangent(
      static_cast<std::uint16_t>(atan2_binary(2 * xy, difference).signed_raw() / 2));
  const BinaryAngle normal = tangent + BinaryAngle(std::uint16_t{0x4000});
  std::int32_t nx = cos_q30(normal) >> 16, ny = sin_q30(normal) >> 16;
  if (std::int64_t{nx} * sample.x_um + std::int64_t{ny} * sample.y_um > 0) {
    nx = -nx;
    ny = -ny;
  }
  sample.normal_x = static_cast<std::int16_t>(nx);
  sample.normal_y = static_cast<std::int16_t>(ny);
  const std::int64_t off_um = (nx * s.x + ny * s.y) * 1000 / (s.n * 16384);
  sample.x_um += static_cast<std::int32_t>(off_um * nx / 16384);
  sample.y_um += static_cast<std::int32_t>(off_um * ny / 16384);
}

}  // namespace

Point end_of(const ScanPoint& beam) {
  const std::int32_t range_um = std::int32_t{beam.range_mm} * 1000;
  return {scale_q30(range_um, cos_q30(beam.bearing)), scale_q30(range_um, sin_q30(beam.bearing))};
}

void ScanSurfaces::take(const Scan& scan, std::int32_t range_um, std::int32_t spacing_um) {
  std::int32_t spacing = spacing_um;
  backwards_ = !backwards_;
  while (!pick(scan, range_um, spacing)) spacing += spacing_um / 2;
  const auto beams = scan.points();
  for (std::size_t i = 0; i < size_; ++i) {
    SurfaceSample& sample = samples_[i];
    const std::int32_t range_mm = beams[sample.beam].range_mm;
    // Where noise hides which way a short piece faces, a longer one shows it.
    const Point middle{sample.x_um, sample.y_um};
    const std::int32_t reach_um = 100'000 + range_mm * 20;
    fit_line(gather(beams, sample.beam, middle, reach_um), range_mm, sample);
    if (!sample.is_flat())
      fit_line(gather(beams, sample.beam, middle, reach_um * 2), range_mm, sample);
    // Variances: 1 cm at the robot, 0.5 % of the range.
    const std::int64_t far2 = squared_distance_um2({}, {0, range_mm * 5});
    sample.weight_q8 =
        static_cast<std::uint16_t>(std::int64_t{256} * 100'000'000 / (100'000'000 + far2));
  }
}

// False when there are too many.
bool ScanSurfaces::pick(const Scan& scan, std::int32_t range_um, std::int32_t spacing_um) {
  const std::int64_t spacing2 = std::int64_t{spacing_um} * spacing_um;
  size_ = 0;
  for (std::size_t i = 0; i < scan.size; ++i) {
    const std::size_t at = backwards_ ? scan.size - 1 - i : i;
    const ScanPoint& beam = scan.storage[at];
    if (beam.echo != Echo::kHit || std::int32_t{beam.range_mm} * 1000 > range_um) continue;
    const Point p = end_of(beam);
    if (size_ > 0) {
      const SurfaceSample& last = samples_[size_ - 1];
      if (squared_distance_um2(p, {last.x_um, last.y_um}) < spacing2) continue;
    }
    if (size_ == kMaxSamples) return false;
    samples_[size_++] = {p.x_um, p.y_um, 0, 0, 0, static_cast<std::uint16_t>(at)};
  }
  if (backwards_)
    std::reverse(samples_.begin(), samples_.begin() + static_cast<std::ptrdiff_t>(size_));
  return true;
}

}  // namespace ivfm
