#include "firmware/localization/scan_matcher.h"

#include <algorithm>
#include <cstdlib>

#include "shared/geometry/integer_sqrt.h"

namespace ivfm {

namespace {

constexpr std::int32_t kSub = 256;  // positions are in 1/256 cell
constexpr std::int32_t kFullValue = 4096;
constexpr std::int32_t kFitValue = kFullValue / 8;
constexpr std::int32_t kGoodFitPercent = 75;  // the hill climb alone will do
constexpr std::int32_t kTurnDegree = 182;     // binary angle units

std::int32_t rounded_quotient(std::int64_t value, std::int64_t divisor) {
  const std::int64_t half = divisor / 2;
  return static_cast<std::int32_t>((value + (value < 0 ? -half : half)) / divisor);
}

std::int64_t squared(std::int64_t v) { return v * v; }

BinaryAngle to_angle(std::int32_t units) {
  return BinaryAngle(static_cast<std::uint16_t>(static_cast<std::uint32_t>(units) & 0xffffu));
}

// `gained` points (Q10) of information against `doubt` points of trust in the odometry.
std::int32_t weight_q10(std::int64_t gained, std::int64_t doubt) {
  return gained <= 0 ? 0 : static_cast<std::int32_t>(gained * 1024 / (gained + doubt));
}

}  // namespace

Pose blend(const Pose& predicted, const ScanMatch& match) {
  const MatchCertainty& known = match.certainty;
  const std::int32_t c = cos_q30(known.axis), s = sin_q30(known.axis);
  const std::int32_t dx = match.pose.position.x_um - predicted.position.x_um;
  const std::int32_t dy = match.pose.position.y_um - predicted.position.y_um;
  const auto share = [](std::int32_t value, std::int32_t q10) {
    return rounded_quotient(std::int64_t{value} * q10, 1024);
  };
  const std::int32_t along = share(scale_q30(dx, c) + scale_q30(dy, s), known.along_q10);
  const std::int32_t across = share(scale_q30(dy, c) - scale_q30(dx, s), known.across_q10);
  const std::int32_t turn =
      share((match.pose.heading - predicted.heading).signed_raw(), known.heading_q10);
  return {{predicted.position.x_um + scale_q30(along, c) - scale_q30(across, s),
           predicted.position.y_um + scale_q30(along, s) + scale_q30(across, c)},
          predicted.heading + to_angle(turn)};
}

ScanMatch ScanMatcher::match(const ExplorationMap& map, const SurfaceMap& surfaces,
                             const Pose& predicted, const Scan& scan) {
  const GridFrame& frame = map.frame();
  const std::int32_t cell_um = frame.cell_um();
  map_ = &map;
  surfaces_ = &surfaces;
  heading_ = predicted.heading;
  const auto from_corner = [&](std::int32_t position_um, std::int32_t corner) {
    const std::int64_t um = position_um - std::int64_t{corner} * cell_um;
    return rounded_quotient(um * kSub, cell_um) - kSub / 2;
  };
  origin_ = {from_corner(predicted.position.x_um, frame.window().x),
             from_corner(predicted.position.y_um, frame.window().y)};
  reach_ = rounded_quotient(std::int64_t{config_.search_um} * kSub, cell_um);
  take_points(scan, cell_um);
  ScanMatch result;
  result.pose = predicted;
  result.points = static_cast<std::uint16_t>(size_);
  if (size_ < config_.min_points) return result;
  find_normals();
  turn_to(0);
  Candidate best = settle(climb({{}, score({})}));
  judge(best.offset, result);
  if (result.judged < config_.min_judged) {
    result.outcome = MatchOutcome::kUnknownPlace;
    return result;
  }
  if (result.fitting * 100 < result.judged * kGoodFitPercent) {
    const Candidate other = settle(climb(search_everywhere()));
    if (other.score > best.score) best = other;
    judge(best.offset, result);
  }
  if (!in_reach(best.offset) || result.fitting * 100 < result.judged * config_.min_fit_percent) {
    result.outcome = MatchOutcome::kPoorFit;
    return result;
  }
  const auto to_um = [&](std::int32_t v) {
    return rounded_quotient(std::int64_t{v} * cell_um, kSub);
  };
  result.outcome = MatchOutcome::kMatched;
  result.pose = {{predicted.position.x_um + to_um(best.offset.x),
                  predicted.position.y_um + to_um(best.offset.y)},
                 predicted.heading + to_angle(best.offset.turn)};
  result.certainty = certainty(best.offset);
  return result;
}

// Points at even distances along the surfaces, so that near walls do not outvote far ones. When
// there are too many, the distance grows.
void ScanMatcher::take_points(const Scan& scan, std::int32_t cell_um) {
  for (std::int32_t spacing = kSub;; spacing += kSub / 2) {
    size_ = 0;
    bool all = true;
    for (const ScanPoint& beam : scan.points()) {
      const std::int32_t range_um = std::int32_t{beam.range_mm} * 1000;
      if (beam.echo != Echo::kHit || range_um > config_.range_um) continue;
      // Scan fusion puts a surface an eighth of a cell behind the end of the beam.
      const std::int32_t range =
          rounded_quotient(std::int64_t{range_um} * kSub, cell_um) + kSub / 8;
      const GridPoint p{scale_q30(range, cos_q30(beam.bearing)),
                        scale_q30(range, sin_q30(beam.bearing))};
      if (size_ > 0) {
        const GridPoint& last = points_[size_ - 1];
        if (squared(p.x - last.x) + squared(p.y - last.y) < squared(spacing)) continue;
      }
      all = size_ < kMaxPoints;
      if (!all) break;
      points_[size_++] = p;
    }
    if (all) return;
  }
}

void ScanMatcher::turn_to(std::int32_t turn) {
  turn_ = turn;
  const BinaryAngle heading = heading_ + to_angle(turn);
  const std::int32_t c = cos_q30(heading), s = sin_q30(heading);
  for (std::size_t i = 0; i < size_; ++i) {
    const GridPoint& p = points_[i];
    turned_[i] = {scale_q30(p.x, c) - scale_q30(p.y, s), scale_q30(p.x, s) + scale_q30(p.y, c)};
    const GridPoint& n = normals_[i];
    turned_normals_[i] = {scale_q30(n.x, c) - scale_q30(n.y, s),
                          scale_q30(n.x, s) + scale_q30(n.y, c)};
  }
}

// How near point `i`, at `p`, lies to a surface of the map: 0 .. kFullValue.
std::int32_t ScanMatcher::value(std::size_t i, GridPoint p) const {
  constexpr std::int64_t kReach = kSub * 5 / 4;
  const std::int32_t column = (p.x + kSub / 2) >> 8, row = (p.y + kSub / 2) >> 8;
  const CellRect& window = map_->frame().window();
  if (column < 1 || row < 1 || column + 1 >= window.width || row + 1 >= window.height) return 0;
  const GridPoint& n = turned_normals_[i];
  std::int64_t nearest2 = kReach * kReach;
  for (std::int32_t y = row - 1; y <= row + 1; ++y) {
    const std::size_t line = static_cast<std::size_t>(y) * static_cast<std::size_t>(window.width);
    for (std::int32_t x = column - 1; x <= column + 1; ++x) {
      if (map_->layers().occupancy[line + static_cast<std::size_t>(x)] <= 0) continue;
      const SurfaceMap::Mean mean = surfaces_->mean({window.x + x, window.y + y});
      const std::int64_t dx = x * kSub - kSub / 2 + mean.x - p.x;
      const std::int64_t dy = y * kSub - kSub / 2 + mean.y - p.y;
      const std::int64_t distance2 = squared(dx) + squared(dy);
      if (distance2 > 2 * kReach * kReach) continue;
      const bool flat = n.x != 0 || n.y != 0;
      nearest2 = std::min(nearest2, flat ? squared((dx * n.x + dy * n.y) >> 10) : distance2);
    }
  }
  return static_cast<std::int32_t>(kFullValue - kFullValue * nearest2 / (kReach * kReach));
}

bool ScanMatcher::is_known_at(GridPoint p) const {
  const std::int32_t column = (p.x + kSub / 2) >> 8, row = (p.y + kSub / 2) >> 8;
  const std::int32_t side = map_->frame().width();
  if (column < 0 || row < 0 || column >= side || row >= side) return false;
  return map_->layers().occupancy[static_cast<std::size_t>(row) * static_cast<std::size_t>(side) +
                                  static_cast<std::size_t>(column)] != occupancy::kUnknown;
}

ScanMatcher::GridPoint ScanMatcher::place(std::size_t i, const Offset& offset) const {
  return {origin_.x + offset.x + turned_[i].x, origin_.y + offset.y + turned_[i].y};
}

// Sum over all points.
std::int64_t ScanMatcher::overlap(const Offset& offset) {
  if (offset.turn != turn_) turn_to(offset.turn);
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < size_; ++i) sum += value(i, place(i, offset));
  return sum;
}

// Less a little for every step away from the prediction: up to a 32nd of the whole at the edge of
// the search, next to nothing near its middle.
std::int64_t ScanMatcher::score(const Offset& offset) {
  const std::int64_t whole = static_cast<std::int64_t>(size_) * kFullValue / 32;
  const std::int64_t off = squared(offset.x) + squared(offset.y);
  return overlap(offset) - whole * off / squared(std::max<std::int32_t>(reach_, 1)) -
         whole * squared(offset.turn) / squared(std::max<std::int32_t>(config_.search_angle, 1));
}

ScanMatcher::Candidate ScanMatcher::climb(Candidate best) {
  constexpr int kMaxSteps = 12;  // at each step width
  std::int32_t turn_step = kTurnDegree / 2;
  for (std::int32_t step = kSub / 2; step >= kSub / 32; step /= 2, turn_step /= 2) {
    for (int i = 0; i < kMaxSteps && improve(best, step, turn_step); ++i) {
    }
  }
  return best;
}

// One step along an axis, the best of six, if any is better than staying.
bool ScanMatcher::improve(Candidate& best, std::int32_t step, std::int32_t turn_step) {
  const Offset from = best.offset;
  const std::array<Offset, 6> steps{{{-step, 0, 0},
                                     {step, 0, 0},
                                     {0, -step, 0},
                                     {0, step, 0},
                                     {0, 0, -turn_step},
                                     {0, 0, turn_step}}};
  bool better = false;
  for (const Offset& move : steps) {
    const Offset to{from.x + move.x, from.y + move.y, from.turn + move.turn};
    const std::int64_t value = score(to);
    if (value <= best.score) continue;
    best = {to, value};
    better = true;
  }
  return better;
}

// The whole reach in steps of a cell and a degree.
ScanMatcher::Candidate ScanMatcher::search_everywhere() {
  Candidate best{{}, score({})};
  const std::int32_t turns = config_.search_angle / kTurnDegree, cells = reach_ / kSub;
  for (std::int32_t turn = -turns; turn <= turns; ++turn) {
    for (std::int32_t y = -cells; y <= cells; ++y) {
      for (std::int32_t x = -cells; x <= cells; ++x) {
        const Offset offset{x * kSub, y * kSub, turn * kTurnDegree};
        const std::int64_t value = score(offset);
        if (value > best.score) best = {offset, value};
      }
    }
  }
  return best;
}

// The vector from `p` to the nearest mean in its own or a neighbouring cell.
bool ScanMatcher::nearest_surface(GridPoint p, GridPoint& to_surface) const {
  const std::int32_t column = (p.x + kSub / 2) >> 8, row = (p.y + kSub / 2) >> 8;
  const CellRect& window = map_->frame().window();
  if (column < 1 || row < 1 || column + 1 >= window.width || row + 1 >= window.height) return false;
  std::int64_t nearest2 = std::int64_t{2} * kSub * kSub;
  bool found = false;
  for (std::int32_t y = row - 1; y <= row + 1; ++y) {
    const std::size_t line = static_cast<std::size_t>(y) * static_cast<std::size_t>(window.width);
    for (std::int32_t x = column - 1; x <= column + 1; ++x) {
      if (map_->layers().occupancy[line + static_cast<std::size_t>(x)] <= 0) continue;
      const SurfaceMap::Mean mean = surfaces_->mean({window.x + x, window.y + y});
      const GridPoint d{x * kSub - kSub / 2 + mean.x - p.x, y * kSub - kSub / 2 + mean.y - p.y};
      const std::int64_t distance2 = squared(d.x) + squared(d.y);
      if (distance2 >= nearest2) continue;
      nearest2 = distance2;
      to_surface = d;
      found = true;
    }
  }
  return found;
}

// Coordinates tried one by one get stuck where a turn and a shift belong together: a few joint
// steps, kept unless they led away.
ScanMatcher::Candidate ScanMatcher::settle(const Candidate& climbed) {
  constexpr int kSteps = 8;
  Offset offset = climbed.offset;
  for (int i = 0; i < kSteps && newton_step(offset); ++i) {
  }
  const std::int64_t before = overlap(climbed.offset);
  if (overlap(offset) < before - before / 64) return climbed;
  return {offset, score(offset)};
}

// Solves sum(w a a^T) d = sum(w a e) for the flat points: e the distance to the surface along the
// point's normal n, a = (n, lever arm / 32 cells), w = 1 - (e / 1.25 cells)^2. False: nothing
// moved.
bool ScanMatcher::newton_step(Offset& offset) {
  constexpr std::int64_t kReach = kSub * 5 / 4;
  if (offset.turn != turn_) turn_to(offset.turn);
  std::int64_t xx = 0, xy = 0, xt = 0, yy = 0, yt = 0, tt = 0, gx = 0, gy = 0, gt = 0;
  for (std::size_t i = 0; i < size_; ++i) {
    const std::int64_t nx = turned_normals_[i].x, ny = turned_normals_[i].y;
    GridPoint d;
    if ((nx == 0 && ny == 0) || !nearest_surface(place(i, offset), d)) continue;
    const std::int64_t e = (nx * d.x + ny * d.y) >> 10;
    const std::int64_t w = 64 - 64 * squared(e) / squared(kReach);
    if (w <= 0) continue;
    const std::int64_t nt = (turned_[i].x * ny - turned_[i].y * nx) >> 13;
    xx += w * nx * nx;
    xy += w * nx * ny;
    xt += w * nx * nt;
    yy += w * ny * ny;
    yt += w * ny * nt;
    tt += w * nt * nt;
    gx += w * nx * e;
    gy += w * ny * e;
    gt += w * nt * e;
  }
  int shift = 0;  // to 16 bits, so that the determinants fit
  while ((std::max({xx, yy, tt}) >> shift) > 0xffff) ++shift;
  for (std::int64_t* v : {&xx, &xy, &xt, &yy, &yt, &tt}) *v >>= shift;
  for (std::int64_t* v : {&gx, &gy, &gt}) *v = *v * 1024 >> shift;
  const std::int64_t damping = std::max({xx, yy, tt}) / 256 + 1;
  xx += damping;
  yy += damping;
  tt += damping;
  const std::int64_t cx = yy * tt - yt * yt, cy = xt * yt - xy * tt, ct = xy * yt - xt * yy;
  const std::int64_t determinant = xx * cx + xy * cy + xt * ct;
  if (determinant <= 0) return false;
  const auto solved = [&](std::int64_t numerator, std::int32_t limit) {
    return static_cast<std::int32_t>(
        std::clamp<std::int64_t>(numerator / determinant, -limit, limit));
  };
  const std::int32_t dx = solved(gx * cx + gy * cy + gt * ct, kSub / 2);
  const std::int32_t dy =
      solved(gx * cy + gy * (xx * tt - xt * xt) + gt * (xt * xy - xx * yt), kSub / 2);
  // d_t is in 1/8192 rad; a turn has 65536 = 2 pi 10430 units.
  const std::int32_t turn =
      solved(gx * ct + gy * (xt * xy - xx * yt) + gt * (xx * yy - xy * xy), 72) * 10430 / 8192;
  offset = {offset.x + dx, offset.y + dy, offset.turn + turn};
  return dx != 0 || dy != 0 || turn != 0;
}

bool ScanMatcher::in_reach(const Offset& offset) const {
  return std::abs(offset.x) <= reach_ && std::abs(offset.y) <= reach_ &&
         std::abs(offset.turn) <= config_.search_angle;
}

void ScanMatcher::judge(const Offset& offset, ScanMatch& match) {
  if (offset.turn != turn_) turn_to(offset.turn);
  match.judged = match.fitting = 0;
  for (std::size_t i = 0; i < size_; ++i) {
    const GridPoint p = place(i, offset);
    const bool fits = value(i, p) >= kFitValue;
    match.fitting = static_cast<std::uint16_t>(match.fitting + (fits ? 1 : 0));
    match.judged = static_cast<std::uint16_t>(match.judged + (fits || is_known_at(p) ? 1 : 0));
  }
}

// The surface's direction from neighbours some cells away on both sides; none at corners and edges.
ScanMatcher::GridPoint ScanMatcher::surface_normal(std::size_t i) const {
  constexpr std::int64_t kNear2 = std::int64_t{3 * kSub} * (3 * kSub);
  constexpr std::int64_t kFar2 = std::int64_t{10 * kSub} * (10 * kSub);
  const auto neighbour = [&](std::ptrdiff_t direction, GridPoint& found) {
    for (std::ptrdiff_t k = static_cast<std::ptrdiff_t>(i) + direction;
         k >= 0 && k < static_cast<std::ptrdiff_t>(size_); k += direction) {
      const GridPoint& p = points_[static_cast<std::size_t>(k)];
      const std::int64_t gap = squared(p.x - points_[i].x) + squared(p.y - points_[i].y);
      if (gap > kFar2) return false;
      found = p;
      if (gap >= kNear2) return true;
    }
    return false;
  };
  GridPoint a, b;
  if (!neighbour(-1, a) || !neighbour(1, b)) return {};
  const std::int64_t dx = b.x - a.x, dy = b.y - a.y;
  const std::int64_t length = integer_sqrt(static_cast<std::uint64_t>(dx * dx + dy * dy));
  if (length < 4 * kSub) return {};
  const std::int64_t off = dx * (points_[i].y - a.y) - dy * (points_[i].x - a.x);
  if (std::abs(off) > length * kSub) return {};  // a cell off the chord: no flat surface
  return {static_cast<std::int32_t>(-dy * 1024 / length),
          static_cast<std::int32_t>(dx * 1024 / length)};
}

void ScanMatcher::find_normals() {
  for (std::size_t i = 0; i < size_; ++i) normals_[i] = surface_normal(i);
}

// The information matrix of the position, sum of n n^T over the fitting points' surface normals
// (Censi, "On achievable accuracy for range-finder localization", ICRA 2007, equation 5), by its
// main axes; and of the heading, sum of the squared lever arms.
MatchCertainty ScanMatcher::certainty(const Offset& offset) {
  constexpr std::int64_t kTrust = 8 * 1024;       // the odometry counts as much as 8 points
  constexpr std::int64_t kTurnTrust = 3'000'000;  // and as 12 points at a lever arm of 0.5 m
  constexpr std::int64_t kNoisePercent = 3;       // what a rough wall seems to tell sideways
  if (offset.turn != turn_) turn_to(offset.turn);
  std::int64_t xx = 0, xy = 0, yy = 0, turning = 0;  // Q10; mm^2
  for (std::size_t i = 0; i < size_; ++i) {
    if (value(i, place(i, offset)) < kFitValue) continue;
    const GridPoint& n = turned_normals_[i];
    xx += squared(n.x) >> 10;
    xy += (std::int64_t{n.x} * n.y) >> 10;
    yy += squared(n.y) >> 10;
    const std::int64_t lever =
        (std::int64_t{turned_[i].x} * n.y - std::int64_t{turned_[i].y} * n.x) >> 10;
    turning += squared(lever * map_->frame().cell_um() / (kSub * 1000));
  }
  const std::int64_t sum = xx + yy;
  const std::int64_t spread =
      integer_sqrt(static_cast<std::uint64_t>(squared(xx - yy) + squared(2 * xy)));
  const std::int64_t noise = sum * kNoisePercent / 100;
  MatchCertainty known;
  known.axis = to_angle(atan2_binary(2 * xy, xx - yy).signed_raw() / 2);
  known.along_q10 = weight_q10((sum + spread) / 2 - noise, kTrust);
  known.across_q10 = weight_q10((sum - spread) / 2 - noise, kTrust);
  known.heading_q10 = weight_q10(turning, kTurnTrust);
  return known;
}

}  // namespace ivfm
