#include "firmware/localization/relocation.h"

#include <algorithm>

namespace ivfm {

namespace {

constexpr std::int32_t kStrideUm = 200'000;  // between places
constexpr std::int32_t kHeadings = 64;       // at each
constexpr std::size_t kSamples = 48;         // looked up for each pose
constexpr std::size_t kPlacesPerStep = 48;   // 150,000 looks into the map
constexpr std::int32_t kSamePlaceUm = 400'000;
constexpr std::int32_t kSameTurn = 2'730;  // 15 degrees
constexpr int kLooks = 6;                  // revolutions that a place is judged by
// Where a robot is nearly all samples fit: at most so many percent of them may lie where the map is
// unknown, or a quarter as many where nothing stands.
constexpr std::int32_t kOddPercent = 36;
// The place where it was lost is hardly found by chance: there a door may have opened, or closed.
constexpr std::int32_t kOddPercentByWheels = 60;
constexpr std::int32_t kUnknownPerWrong = 4;

}  // namespace

void Relocation::begin(const ExplorationMap& map) {
  region_ = map.known_rect();
  next_ = {region_.x, region_.y};
  candidates_ = {};
  judged_ = 0;
  best_ = {};
  second_ = 0;
  looks_ = 0;
  odd_ = could_fit_ = 0;
}

Relocation::Result Relocation::step(const ExplorationMap& map, const SurfaceMap& surfaces,
                                    ScanMatcher& matcher, const Scan& scan, const Pose& by_wheels) {
  if (next_.y >= region_.top()) return judge(map, surfaces, matcher, scan, by_wheels);
  const std::int32_t stride = std::max<std::int32_t>(1, kStrideUm / map.frame().cell_um());
  matcher.look_at(scan, map.frame().cell_um());
  std::array<Cell, kPlacesPerStep> places;
  std::size_t count = 0;
  // Cells that are no places cost little, but something.
  for (std::size_t seen = 0; count < places.size() && seen < 64 * places.size(); ++seen) {
    if (next_.y >= region_.top()) break;
    if (map.is_known_free(next_) && !map.is_blocked(next_)) places[count++] = next_;
    next_.x += stride;
    if (next_.x >= region_.right()) next_ = {region_.x, next_.y + stride};
  }
  try_places(map, matcher.surfaces(), std::span(places).first(count));
  return Result::kSearching;
}

// How many samples lie near obstacles, less those that lie where nothing stands, for each heading.
// A sample is as many cells away from one place as from another, so each is turned only once a
// heading.
void Relocation::try_places(const ExplorationMap& map, const ScanSurfaces& scan,
                            std::span<const Cell> places) {
  const GridFrame& frame = map.frame();
  const auto samples = scan.samples();
  const std::size_t every = samples.size() / kSamples + 1;
  const Point origin = frame.center_of({0, 0});
  std::array<Cell, kSamples> offsets;
  for (std::int32_t turn = 0; turn < kHeadings; ++turn) {
    const BinaryAngle heading(static_cast<std::uint16_t>(turn * 65536 / kHeadings));
    std::size_t count = 0;
    for (std::size_t i = 0; i < samples.size(); i += every) {
      offsets[count++] =
          frame.cell_at(transform({origin, heading}, samples[i].x_um, samples[i].y_um));
    }
    for (const Cell place : places) {
      Candidate candidate{{frame.center_of(place), heading}, 0};
      for (const Cell offset : std::span(offsets).first(count)) {
        const Cell c{place.x + offset.x, place.y + offset.y};
        if (!frame.contains(c)) continue;
        const std::size_t at = frame.index_of(c);
        if (map.layers().inflation[at] != 0) {
          ++candidate.score;
        } else if (map.layers().occupancy[at] < 0) {
          --candidate.score;
        }
      }
      keep(candidate);
    }
  }
}

// The best at each place, and the best of the places.
void Relocation::keep(const Candidate& candidate) {
  Candidate* worst = &candidates_[0];
  for (Candidate& kept : candidates_) {
    if (kept.score > 0 && is_near(kept.pose, candidate.pose, kSamePlaceUm, kSameTurn)) {
      if (candidate.score > kept.score) kept = candidate;
      return;
    }
    if (kept.score < worst->score) worst = &kept;
  }
  if (candidate.score > worst->score) *worst = candidate;
}

// A candidate a revolution, by the matcher; then the best of them again and again: among many poses
// and searches one fits a single revolution by chance.
Relocation::Result Relocation::judge(const ExplorationMap& map, const SurfaceMap& surfaces,
                                     ScanMatcher& matcher, const Scan& scan,
                                     const Pose& by_wheels) {
  if (judged_ <= kCandidates) {
    const std::size_t i = judged_++;
    const bool is_candidate = i < kCandidates && candidates_[i].score > 0;
    if (is_candidate) note(matcher.locate(map, surfaces, candidates_[i].pose, scan));
    if (i == kCandidates) note(matcher.locate(map, surfaces, by_wheels, scan));
    return Result::kSearching;
  }
  const bool alone = second_ * 100 < support(best_) * 90;
  if (!alone) return give_up(map);
  const ScanMatch again = matcher.locate(map, surfaces, best_.pose, scan);
  if (again.outcome != MatchOutcome::kMatched || !is_same_place(again.pose, best_.pose)) {
    return give_up(map);
  }
  best_ = again;
  odd_ += kUnknownPerWrong * (again.judged - again.fitting) + again.could_fit() - again.judged;
  could_fit_ += again.could_fit();
  if (++looks_ < kLooks) return Result::kSearching;
  const bool expected = is_same_place(best_.pose, by_wheels);
  const std::int32_t most_odd = expected ? kOddPercentByWheels : kOddPercent;
  return odd_ * 100 <= could_fit_ * most_odd ? Result::kFound : give_up(map);
}

Relocation::Result Relocation::give_up(const ExplorationMap& map) {
  begin(map);
  return Result::kNotFound;
}

// A place that is not known well enough to be taken may still be the right one.
void Relocation::note(const ScanMatch& match) {
  if (support(match) <= support(best_)) {
    if (!is_same_place(match.pose, best_.pose)) second_ = std::max(second_, support(match));
    return;
  }
  if (!is_same_place(match.pose, best_.pose)) second_ = std::max(second_, support(best_));
  best_ = match;
}

bool Relocation::is_same_place(const Pose& a, const Pose& b) {
  return is_near(a, b, kSamePlaceUm, kSameTurn);
}

// Samples that speak for a place, less those that speak against it.
std::int32_t Relocation::support(const ScanMatch& match) {
  return 2 * match.fitting - match.judged + match.on_backs;
}

}  // namespace ivfm
