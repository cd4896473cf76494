#include "host/map_server/map_alignment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace ivfm::host {
namespace {

constexpr int kHeadings = 360;
constexpr int kPeaksPerHeading = 4;
constexpr std::size_t kMostCandidates = 48;
constexpr std::int32_t kCoarseUm = 200'000;
constexpr int kLargestImage = 4096;  // coarse cells to a side
constexpr std::size_t kMinWalls = 40;
constexpr std::size_t kRefineWalls = 1200;
// A wall's cells lie this near to the same wall's of the other map; farther away than the other
// distance nothing of it is.
constexpr double kHitM = 0.075;
constexpr double kMissM = 0.16;
// A wall where the other map has seen that nothing stands says more against a place than one that
// both have says for it.
constexpr double kMissWeight = 4;
constexpr double kMostMissed = 0.03;  // of the walls that either map should have
constexpr double kLeastWallM = 10;
// Another place that explains so much of what the best does makes it doubtful, unless much speaks
// against the other: so much more missing wall, and of all that could be there.
constexpr double kRivalShare = 0.5;
constexpr double kClearlyMissingM = 8;
constexpr double kClearlyMissed = 0.05;
constexpr double kElsewhereM = 0.35;
constexpr double kElsewhereRad = 4 * std::numbers::pi / 180;
constexpr double kSlideM = 1.2;

cv::Point2d turned(cv::Point2d p, double turn) {
  const double c = std::cos(turn), s = std::sin(turn);
  return {c * p.x - s * p.y, s * p.x + c * p.y};
}

// The pixel of `p`, a place in cells; outside the image {-1, -1}.
cv::Point pixel_of(const cv::Mat& image, Cell low, cv::Point2d p) {
  const cv::Point at(static_cast<int>(std::floor(p.x)) - low.x,
                     static_cast<int>(std::floor(p.y)) - low.y);
  const bool inside = at.x >= 0 && at.y >= 0 && at.x < image.cols && at.y < image.rows;
  return inside ? at : cv::Point(-1, -1);
}

cv::Mat coarse(const cv::Mat& image, int block, cv::Size size, double threshold) {
  cv::Mat out = cv::Mat::zeros(size, CV_32F);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      if (image.at<std::uint8_t>(y, x) != 0) out.at<float>(y / block, x / block) += 1;
    }
  }
  cv::threshold(out, out, threshold, 1, cv::THRESH_BINARY);
  return out;
}

cv::Mat grown(const cv::Mat& image) {
  cv::Mat out;
  cv::dilate(image, out, cv::Mat::ones(3, 3, CV_8U));
  return out;
}

}  // namespace

double MapAlignment::Agreement::score() const {
  return apart_hits + team_hits - kMissWeight * (apart_misses + team_misses);
}

bool MapAlignment::Agreement::rivals(const Agreement& best, double cell_m) const {
  const int hits = apart_hits + team_hits, misses = apart_misses + team_misses;
  const int more = misses - best.apart_misses - best.team_misses;
  const bool wrong = more * cell_m > kClearlyMissingM && misses > kClearlyMissed * (hits + misses);
  return !wrong && score() >= kRivalShare * best.score();
}

bool MapAlignment::Agreement::holds() const {
  const int hits = apart_hits + team_hits, misses = apart_misses + team_misses;
  return misses <= kMostMissed * (hits + misses);
}

MapAlignment::View MapAlignment::view_of(const MapStore& store) {
  CellRect bounds;
  const std::set<TileKey> tiles = store.tiles();
  for (const TileKey& key : tiles) bounds = bounds.united(key.cells());
  View view;
  view.low = {bounds.x, bounds.y};
  view.seen = cv::Mat::zeros(bounds.height, bounds.width, CV_8U);
  cv::Mat open(bounds.height, bounds.width, CV_8U, cv::Scalar(1));
  std::array<std::uint8_t, kTileCells> cells;
  for (const TileKey& key : tiles) {
    store.read_merged(key, cells);
    for (std::size_t i = 0; i < kTileCells; ++i) {
      if (cells[i] == 0) continue;
      const Cell c = cell_of_tile_index(key, i);
      const cv::Point at(c.x - view.low.x, c.y - view.low.y);
      if (key.layer == Layer::kVisits) {
        view.seen.at<std::uint8_t>(at) = 1;
      } else {
        view.walls.emplace_back(static_cast<float>(c.x) + 0.5f, static_cast<float>(c.y) + 0.5f);
        open.at<std::uint8_t>(at) = 0;
      }
    }
  }
  if (view.walls.empty()) return view;
  cv::distanceTransform(open, view.distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  return view;
}

MapAlignment::MapAlignment(const MapStore& team, const MapStore& apart, std::int32_t cell_um)
    : cell_um_(cell_um),
      block_(std::max(1, kCoarseUm / cell_um)),
      team_(view_of(team)),
      apart_(view_of(apart)) {
  if (team_.walls.size() < kMinWalls || apart_.walls.size() < kMinWalls) {
    heading_ = kHeadings;
    return;
  }
  for (const cv::Point2f& wall : apart_.walls) middle_ += cv::Point2d(wall);
  middle_ *= 1.0 / static_cast<double>(apart_.walls.size());
  for (const cv::Point2f& wall : apart_.walls) {
    radius_ = std::max(radius_, cv::norm(cv::Point2d(wall) - middle_));
  }
  prepare_spectra();
}

// Of what a wall, and a free place, of the apart map says for or against lying there.
void MapAlignment::prepare_spectra() {
  const int extent = 2 * static_cast<int>(radius_ / block_ + 2);
  const cv::Size size(team_.seen.cols / block_ + 1, team_.seen.rows / block_ + 1);
  padded_ = {cv::getOptimalDFTSize(size.width + extent),
             cv::getOptimalDFTSize(size.height + extent)};
  if (std::max(padded_.width, padded_.height) > kLargestImage) {
    heading_ = kHeadings;
    return;
  }
  cv::Mat wall_cells = team_.distance == 0;
  const cv::Mat walls = coarse(wall_cells, block_, size, 0.5);
  const cv::Mat near = grown(walls);
  const cv::Mat seen = coarse(team_.seen, block_, size, block_ * block_ * 0.9);
  const cv::Mat free = seen.mul(1 - near);
  wall_spectrum_ = spectrum_of(0.5 * walls + 0.5 * near - free);
  free_spectrum_ = spectrum_of(-1 * walls);
}

cv::Mat MapAlignment::spectrum_of(const cv::Mat& image) const {
  cv::Mat padded = cv::Mat::zeros(padded_, CV_32F);
  image.copyTo(padded(cv::Rect({}, image.size())));
  cv::dft(padded, padded, 0, image.rows);
  return padded;
}

// All shifts at one heading.
void MapAlignment::try_heading() {
  const double turn = heading_++ * 2 * std::numbers::pi / kHeadings;
  const int half = static_cast<int>(radius_ / block_) + 2;
  const cv::Size size(2 * half, 2 * half);
  const auto place_of = [&](cv::Point2d p) {
    const cv::Point2d at = turned(p - middle_, turn) / block_;
    return cv::Point(static_cast<int>(std::floor(at.x)) + half,
                     static_cast<int>(std::floor(at.y)) + half);
  };
  cv::Mat walls = cv::Mat::zeros(size, CV_32F), seen = cv::Mat::zeros(size, CV_32F);
  for (const cv::Point2f& wall : apart_.walls) walls.at<float>(place_of(wall)) = 1;
  for (int y = 0; y < apart_.seen.rows; ++y) {
    for (int x = 0; x < apart_.seen.cols; ++x) {
      if (apart_.seen.at<std::uint8_t>(y, x) == 0) continue;
      const cv::Point at = place_of({apart_.low.x + x + 0.5, apart_.low.y + y + 0.5});
      if (cv::Rect({}, size).contains(at)) seen.at<float>(at) += 1;
    }
  }
  cv::threshold(seen, seen, block_ * block_ * 0.9, 1, cv::THRESH_BINARY);
  cv::Mat sum, part;
  cv::mulSpectrums(wall_spectrum_, spectrum_of(walls), sum, 0, true);
  cv::mulSpectrums(free_spectrum_, spectrum_of(seen.mul(1 - grown(walls))), part, 0, true);
  sum += part;
  cv::dft(sum, sum, cv::DFT_INVERSE | cv::DFT_SCALE | cv::DFT_REAL_OUTPUT);
  const int apart_cells = std::max(1, static_cast<int>(kElsewhereM * 1e6 / cell_um_ / block_));
  for (int i = 0; i < kPeaksPerHeading; ++i) {
    double most = 0;
    cv::Point at;
    cv::minMaxLoc(sum, nullptr, &most, nullptr, &at);
    if (most <= 0) return;
    const cv::Point corner(at.x - apart_cells, at.y - apart_cells);
    const cv::Rect around(corner, cv::Size(2 * apart_cells + 1, 2 * apart_cells + 1));
    sum(around & cv::Rect({}, padded_)).setTo(-1e9);
    const int dx = at.x > padded_.width - size.width ? at.x - padded_.width : at.x;
    const int dy = at.y > padded_.height - size.height ? at.y - padded_.height : at.y;
    note({turn,
          {team_.low.x + (dx + half) * 1.0 * block_, team_.low.y + (dy + half) * 1.0 * block_},
          most});
  }
}

bool MapAlignment::is_elsewhere(const Candidate& a, const Candidate& b) const {
  const double turn = std::remainder(a.turn - b.turn, 2 * std::numbers::pi);
  return cv::norm(a.middle - b.middle) * cell_um_ > kElsewhereM * 1e6 ||
         std::abs(turn) > kElsewhereRad;
}

// Keeps the best candidates, one for each place.
void MapAlignment::note(const Candidate& candidate) {
  for (Candidate& other : candidates_) {
    if (is_elsewhere(other, candidate)) continue;
    if (candidate.score <= other.score) return;
    other.score = -1;
  }
  std::erase_if(candidates_, [](const Candidate& other) { return other.score < 0; });
  const auto after = std::find_if(candidates_.begin(), candidates_.end(),
                                  [&](const Candidate& c) { return c.score < candidate.score; });
  candidates_.insert(after, candidate);
  if (candidates_.size() > kMostCandidates) candidates_.pop_back();
}

// How near the apart map's walls lie to the team's: 1 for each that lies on one.
double MapAlignment::closeness(const Candidate& candidate, double reach, std::size_t stride) const {
  double sum = 0;
  for (std::size_t i = 0; i < apart_.walls.size(); i += stride) {
    const cv::Point2d p =
        candidate.middle + turned(cv::Point2d(apart_.walls[i]) - middle_, candidate.turn);
    const cv::Point at = pixel_of(team_.distance, team_.low, p);
    if (at.x >= 0) sum += std::max(0.0, 1 - team_.distance.at<float>(at) / reach);
  }
  return sum;
}

// Climbs from step to smaller step; `reach` and steps in cells, turns as far as they move the
// map's rim.
void MapAlignment::refine(Candidate& candidate, double reach, double least_step) const {
  const std::size_t stride =
      least_step < 0.2 ? 1 : std::max<std::size_t>(1, apart_.walls.size() / kRefineWalls);
  for (double step = block_ / 2.0; step >= least_step; step /= 2) {
    const double reach_now = std::max(reach, 2 * step);
    candidate.score = closeness(candidate, reach_now, stride);
    for (int round = 0; round < 8; ++round) {
      const Candidate middle = candidate;
      for (int i = 0; i < 27; ++i) {
        Candidate other = middle;
        other.middle += cv::Point2d(i % 3 - 1, i / 3 % 3 - 1) * step;
        other.turn += (i / 9 - 1) * step / radius_;
        other.score = closeness(other, reach_now, stride);
        if (other.score > candidate.score) candidate = other;
      }
      if (candidate.score <= middle.score) break;
    }
  }
}

MapAlignment::Agreement MapAlignment::agreement(const Candidate& candidate) const {
  const double hit = kHitM * 1e6 / cell_um_, miss = kMissM * 1e6 / cell_um_;
  const auto judge = [&](const View& view, cv::Point2d p, int& hits, int& misses) {
    const cv::Point at = pixel_of(view.seen, view.low, p);
    if (at.x < 0) return;
    const float distance = view.distance.at<float>(at);
    if (distance <= hit) {
      ++hits;
    } else if (distance > miss && view.seen.at<std::uint8_t>(at) != 0) {
      ++misses;
    }
  };
  Agreement sum;
  for (const cv::Point2f& wall : apart_.walls) {
    const cv::Point2d p = candidate.middle + turned(cv::Point2d(wall) - middle_, candidate.turn);
    judge(team_, p, sum.apart_hits, sum.apart_misses);
  }
  for (const cv::Point2f& wall : team_.walls) {
    const cv::Point2d p = middle_ + turned(cv::Point2d(wall) - candidate.middle, -candidate.turn);
    judge(apart_, p, sum.team_hits, sum.team_misses);
  }
  return sum;
}

// Whether a place a little to the side explains much of what the best explains.
bool MapAlignment::slides(const Candidate& best) const {
  const Agreement found = agreement(best);
  const double step = 0.1e6 / cell_um_;
  const int steps = static_cast<int>(std::lround(kSlideM / 0.1));
  for (int y = -steps; y <= steps; ++y) {
    for (int x = -steps; x <= steps; ++x) {
      Candidate other = best;
      other.middle += cv::Point2d(x, y) * step;
      if (is_elsewhere(other, best) && agreement(other).rivals(found, cell_um_ / 1e6)) return true;
    }
  }
  return false;
}

// By all cells: the best place, if it has no rival.
void MapAlignment::decide() {
  for (Candidate& candidate : candidates_) candidate.score = agreement(candidate).score();
  std::sort(candidates_.begin(), candidates_.end(),
            [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  if (candidates_.empty()) return;
  Candidate best = candidates_.front();
  refine(best, 2, 0.1);
  const Agreement found = agreement(best);
  best.score = found.score();
  const double wall_m = std::min(found.apart_hits, found.team_hits) * (cell_um_ / 1e6);
  if (wall_m < kLeastWallM || !found.holds()) return;
  for (const Candidate& other : candidates_) {
    if (is_elsewhere(other, best) && agreement(other).rivals(found, cell_um_ / 1e6)) return;
  }
  if (!slides(best)) match_ = MapMatch{frame_of(best), wall_m};
}

Pose MapAlignment::frame_of(const Candidate& candidate) const {
  const cv::Point2d origin = (candidate.middle - turned(middle_, candidate.turn)) * cell_um_;
  const double units = candidate.turn * 65536 / (2 * std::numbers::pi);
  return {{static_cast<std::int32_t>(std::lround(origin.x)),
           static_cast<std::int32_t>(std::lround(origin.y))},
          BinaryAngle(static_cast<std::uint16_t>(std::lround(units) & 0xffff))};
}

bool MapAlignment::step() {
  if (heading_ < kHeadings) {
    try_heading();
    return false;
  }
  if (refined_ < candidates_.size()) {
    refine(candidates_[refined_++], 3, 0.5);
    return false;
  }
  decide();
  return true;
}

}  // namespace ivfm::host
