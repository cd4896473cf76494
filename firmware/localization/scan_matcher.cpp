#include "firmware/localization/scan_matcher.h"

#include <algorithm>
#include <array>
#include <cstdlib>

namespace ivfm {

namespace {

constexpr std::int32_t kFitUm = 50'000;    // a sample this near to a surface fits
constexpr std::int32_t kSearchTurn = 182;  // binary angle units: a degree
constexpr double kRadiansPerUnit = 6.283185307179586 / 65536;
// A sample's distance at weight 256 is known to 1 cm.
constexpr double kInformationPerSample = 1 / (0.01 * 0.01);
constexpr double kReachSquares = 9;          // squared standard deviations
constexpr std::int32_t kMaxSearchCells = 4;  // along each axis, in steps
constexpr std::int32_t kMaxStride = 3;

std::int32_t rounded(double value) {
  return static_cast<std::int32_t>(value + (value < 0 ? -0.5 : 0.5));
}

BinaryAngle to_angle(std::int32_t units) {
  return BinaryAngle(static_cast<std::uint16_t>(static_cast<std::uint32_t>(units) & 0xffffu));
}

// `pose` moved by metres and radians, rounded to micrometres and binary angles.
Pose moved(const Pose& pose, const Vector3& step) {
  return {
      {pose.position.x_um + rounded(step[0] * 1e6), pose.position.y_um + rounded(step[1] * 1e6)},
      pose.heading + to_angle(rounded(step[2] / kRadiansPerUnit))};
}

}  // namespace

Vector3 difference(const Pose& from, const Pose& to) {
  return {(from.position.x_um - to.position.x_um) * 1e-6,
          (from.position.y_um - to.position.y_um) * 1e-6,
          (from.heading - to.heading).signed_raw() * kRadiansPerUnit};
}

ScanMatch ScanMatcher::match(const ExplorationMap& map, const SurfaceMap& surfaces,
                             const Pose& predicted, const Symmetric3& covariance,
                             const Scan& scan) {
  map_ = &map;
  surfaces_ = &surfaces;
  look_at(scan, map.frame().cell_um());
  ScanMatch nothing;
  nothing.pose = predicted;
  nothing.covariance = covariance;
  nothing.flat = count_flat();
  if (scan_surfaces_.samples().size() < config_.min_samples) return nothing;
  const Symmetric3 information = covariance.inverse();
  ScanMatch best = refine(predicted, predicted, information);
  // A few that fit well correct a heading, but do not contradict.
  const bool few_fit = best.judged >= config_.few_judged && best.explains(kGoodFitPercent) &&
                       in_reach(best, predicted, information);
  if (best.judged < config_.min_judged && !few_fit) {
    nothing.judged = best.judged;
    nothing.fitting = best.fitting;
    nothing.on_backs = best.on_backs;
    nothing.outcome = MatchOutcome::kUnknownPlace;
    return nothing;
  }
  if (!best.explains(kGoodFitPercent)) {
    const ScanMatch other = refine(search(predicted, covariance), predicted, information);
    if (other.fitting > best.fitting) best = other;
  }
  if (!in_reach(best, predicted, information) || !best.explains(config_.min_fit_percent)) {
    nothing.explained_elsewhere = best.explains(kGoodFitPercent);
    nothing.judged = best.judged;
    nothing.fitting = best.fitting;
    nothing.outcome = MatchOutcome::kPoorFit;
    return nothing;
  }
  best.outcome = MatchOutcome::kMatched;
  best.flat = nothing.flat;
  return best;
}

ScanMatch ScanMatcher::locate(const ExplorationMap& map, const SurfaceMap& surfaces,
                              const Pose& guess, const Scan& scan) {
  constexpr Symmetric3 kAnywhereNear{0.04, 0, 0, 0.04, 0, 0.01};  // 20 cm, 6 degrees
  map_ = &map;
  surfaces_ = &surfaces;
  look_at(scan, map.frame().cell_um());
  const Pose start = search_in_steps(guess, 1);
  ScanMatch found = refine(start, start, kAnywhereNear.inverse());
  found.flat = count_flat();
  found.outcome =
      found.judged >= config_.min_samples ? MatchOutcome::kMatched : MatchOutcome::kUnknownPlace;
  return found;
}

std::uint16_t ScanMatcher::count_flat() const {
  return static_cast<std::uint16_t>(
      std::ranges::count_if(scan_surfaces_.samples(), &SurfaceSample::is_flat));
}

// Gauss-Newton steps from `start`; the prediction pulls with its `information`.
ScanMatch ScanMatcher::refine(Pose start, const Pose& predicted,
                              const Symmetric3& information) const {
  constexpr int kMaxSteps = 8;
  ScanMatch found;
  found.pose = start;
  for (int step = 0; step < kMaxSteps; ++step) {
    const Evidence seen = weigh(found.pose, step < 2 ? 100'000 : 40'000);
    const Vector3 pull = information * difference(predicted, found.pose);
    found.covariance = (information + seen.information).inverse();
    found.judged = seen.judged;
    found.fitting = seen.fitting;
    found.on_backs = seen.on_backs;
    const Pose next = moved(found.pose, found.covariance * Vector3{pull[0] + seen.gradient[0],
                                                                   pull[1] + seen.gradient[1],
                                                                   pull[2] + seen.gradient[2]});
    const bool still = std::abs(next.position.x_um - found.pose.position.x_um) < 200 &&
                       std::abs(next.position.y_um - found.pose.position.y_um) < 200 &&
                       next.heading == found.pose.heading;
    found.pose = next;
    if (still && step >= 2) break;
  }
  return found;
}

ScanMatcher::Evidence ScanMatcher::weigh(const Pose& pose, std::int32_t kernel_um) const {
  const std::int32_t c = cos_q30(pose.heading), s = sin_q30(pose.heading);
  const GridFrame& frame = map_->frame();
  const std::int64_t kernel2 = std::int64_t{kernel_um} * kernel_um;
  Evidence sum;
  // Normals are Q14, weights Q8 and Q8, lever arms mm, distances um.
  std::int64_t xx = 0, xy = 0, xt = 0, yy = 0, yt = 0, tt = 0, gx = 0, gy = 0, gt = 0;
  for (const SurfaceSample& sample : scan_surfaces_.samples()) {
    const std::int32_t x_um = scale_q30(sample.x_um, c) - scale_q30(sample.y_um, s);
    const std::int32_t y_um = scale_q30(sample.x_um, s) + scale_q30(sample.y_um, c);
    const Point p{pose.position.x_um + x_um, pose.position.y_um + y_um};
    if (!sample.is_flat()) continue;
    const std::int32_t nx = scale_q30(sample.normal_x, c) - scale_q30(sample.normal_y, s);
    const std::int32_t ny = scale_q30(sample.normal_x, s) + scale_q30(sample.normal_y, c);
    const auto facing = static_cast<std::uint8_t>(atan2_binary(ny, nx).raw() >> 8);
    const SurfaceMap::Distance found = surfaces_->distance(*map_, p, nx, ny, facing);
    const bool fits = found.weight > 0 && std::abs(found.um) <= kFitUm;
    const Cell cell = frame.cell_at(p);
    const bool on_back = found.weight == 0 && found.beside_obstacle;
    const bool known = !on_back && frame.contains(cell) &&
                       map_->layers().occupancy[frame.index_of(cell)] != occupancy::kUnknown;
    sum.fitting = static_cast<std::uint16_t>(sum.fitting + (fits ? 1 : 0));
    sum.judged = static_cast<std::uint16_t>(sum.judged + (fits || known ? 1 : 0));
    sum.on_backs = static_cast<std::uint16_t>(sum.on_backs + (on_back ? 1 : 0));
    if (found.weight == 0) continue;
    const std::int64_t distance2 = std::int64_t{found.um} * found.um;
    // Cauchy's kernel; a place seen only once or twice is not well known.
    const std::int64_t weight = sample.weight_q8 * (256 * kernel2 / (kernel2 + distance2)) *
                                found.weight / (found.weight + 4);
    const std::int64_t lever =
        (std::int64_t{ny} * (x_um / 1000) - std::int64_t{nx} * (y_um / 1000)) >> 14;
    xx += (weight * nx * nx) >> 14;
    xy += (weight * nx * ny) >> 14;
    yy += (weight * ny * ny) >> 14;
    xt += (weight * nx * lever) >> 14;
    yt += (weight * ny * lever) >> 14;
    tt += weight * lever * lever;
    gx += (weight * nx * found.um) >> 14;
    gy += (weight * ny * found.um) >> 14;
    gt += weight * lever * found.um;
  }
  constexpr double kWeight = kInformationPerSample / 65536;
  const auto scaled = [](std::int64_t value, double unit) {
    return static_cast<double>(value) * (unit * kWeight);
  };
  constexpr double kNormal = 1.0 / 16384;
  sum.information = {scaled(xx, kNormal), scaled(xy, kNormal), scaled(xt, 1e-3),
                     scaled(yy, kNormal), scaled(yt, 1e-3),    scaled(tt, 1e-6)};
  sum.gradient = {scaled(gx, 1e-6), scaled(gy, 1e-6), scaled(gt, 1e-9)};
  return sum;
}

// As far off as is always searched; or as the prediction may be by its own covariance, if nearly
// all of the scan says so.
bool ScanMatcher::in_reach(const ScanMatch& match, const Pose& predicted,
                           const Symmetric3& information) const {
  const Pose& pose = match.pose;
  if (std::abs(pose.position.x_um - predicted.position.x_um) <= config_.search_um &&
      std::abs(pose.position.y_um - predicted.position.y_um) <= config_.search_um &&
      std::abs(int{(pose.heading - predicted.heading).signed_raw()}) <= config_.search_angle) {
    return true;
  }
  const Vector3 off = difference(pose, predicted);
  return match.explains(kGoodFitPercent) && dot(off, information * off) <= kReachSquares;
}

// Coarse to fine: a prediction that may be off farther than the reach is searched in wider steps
// first, near obstacles.
Pose ScanMatcher::search(const Pose& predicted, const Symmetric3& covariance) const {
  const double reach_m = config_.search_um * 1e-6, turn = config_.search_angle * kRadiansPerUnit;
  const double squares = std::max(std::max(covariance.xx, covariance.yy) / (reach_m * reach_m),
                                  covariance.tt / (turn * turn));
  std::int32_t stride = 1;
  while (stride < kMaxStride && kReachSquares * squares > stride * stride) ++stride;
  Pose best = predicted;
  if (stride > 1) best = search_in_steps(best, stride);
  return search_in_steps(best, 1);
}

// The reach, `stride` times as wide, in steps of as many cells and twice as many degrees: where
// most samples lie in obstacles, or near them when the steps are wide. Steps of whole cells move
// all samples by whole cells, so each is turned only once.
Pose ScanMatcher::search_in_steps(const Pose& middle, std::int32_t stride) const {
  const GridFrame& frame = map_->frame();
  const std::int32_t turns = config_.search_angle / (2 * kSearchTurn);
  const std::int32_t reach = std::min(kMaxSearchCells, config_.search_um / frame.cell_um());
  const std::int32_t side = 2 * reach + 1;
  std::array<std::uint8_t, (2 * kMaxSearchCells + 1) * (2 * kMaxSearchCells + 1)> hits;
  static_assert(ScanSurfaces::kMaxSamples <= 255);
  Pose best = middle;
  int most = -1;
  for (std::int32_t turn = -turns; turn <= turns; ++turn) {
    const Pose turned{middle.position, middle.heading + to_angle(turn * stride * 2 * kSearchTurn)};
    hits.fill(0);
    for (const SurfaceSample& sample : scan_surfaces_.samples()) {
      count_hits(frame.cell_at(transform(turned, sample.x_um, sample.y_um)), reach, stride, hits);
    }
    for (std::int32_t i = 0; i < side * side; ++i) {
      if (int{hits[static_cast<std::size_t>(i)]} <= most) continue;
      most = hits[static_cast<std::size_t>(i)];
      best = turned;
      best.position.x_um += (i % side - reach) * stride * frame.cell_um();
      best.position.y_um += (i / side - reach) * stride * frame.cell_um();
    }
  }
  return best;
}

// Counts for each step which obstacles a sample in `cell` would lie in, or near.
void ScanMatcher::count_hits(Cell cell, std::int32_t reach, std::int32_t stride,
                             std::span<std::uint8_t> hits) const {
  const GridFrame& frame = map_->frame();
  const MapLayers& layers = map_->layers();
  std::size_t i = 0;
  for (std::int32_t y = -reach; y <= reach; ++y) {
    for (std::int32_t x = -reach; x <= reach; ++x, ++i) {
      const Cell c{cell.x + x * stride, cell.y + y * stride};
      if (!frame.contains(c)) continue;
      const std::size_t at = frame.index_of(c);
      if (stride > 1 ? layers.inflation[at] != 0 : layers.occupancy[at] > 0) ++hits[i];
    }
  }
}

}  // namespace ivfm
