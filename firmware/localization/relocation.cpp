#include "firmware/localization/relocation.h"

#include <algorithm>
#include <cstdlib>

namespace ivfm {

namespace {

constexpr std::int32_t kStrideUm = 200'000;  // between places
constexpr std::int32_t kHeadings = 64;       // at each
constexpr std::size_t kSamples = 48;         // looked up for each pose
constexpr std::int32_t kPlacesPerStep = 48;  // 150,000 looks into the map
constexpr std::int32_t kSamePlaceUm = 400'000;
constexpr std::int32_t kSameTurn = 2'730;  // 15 degrees

bool same_place(const Pose& a, const Pose& b) {
  return squared_distance_um2(a.position, b.position) < std::int64_t{kSamePlaceUm} * kSamePlaceUm &&
         std::abs(int{(a.heading - b.heading).signed_raw()}) < kSameTurn;
}

}  // namespace

void Relocation::begin(const ExplorationMap& map) {
  region_ = map.known_rect();
  next_ = {region_.x, region_.y};
  candidates_ = {};
  judged_ = 0;
  best_ = {};
  second_fitting_ = 0;
}

Relocation::Result Relocation::step(const ExplorationMap& map, const SurfaceMap& surfaces,
                                    ScanMatcher& matcher, const Scan& scan) {
  if (next_.y >= region_.top()) return judge(map, surfaces, matcher, scan);
  const std::int32_t stride = std::max<std::int32_t>(1, kStrideUm / map.frame().cell_um());
  matcher.look_at(scan, map.frame().cell_um());
  std::int32_t skipped = 0;
  for (std::int32_t tried = 0; tried < kPlacesPerStep && next_.y < region_.top();) {
    const bool open = map.is_known_free(next_) && !map.is_blocked(next_);
    if (open) try_place(map, matcher.surfaces(), next_);
    skipped += open ? 0 : 1;
    tried += open || skipped % 64 == 0 ? 1 : 0;
    next_.x += stride;
    if (next_.x >= region_.right()) next_ = {region_.x, next_.y + stride};
  }
  return Result::kSearching;
}

// How many samples lie near obstacles, for each heading.
void Relocation::try_place(const ExplorationMap& map, const ScanSurfaces& scan, Cell cell) {
  const GridFrame& frame = map.frame();
  const auto samples = scan.samples();
  const std::size_t every = samples.size() / kSamples + 1;
  for (std::int32_t turn = 0; turn < kHeadings; ++turn) {
    Candidate candidate{
        {frame.center_of(cell), BinaryAngle(static_cast<std::uint16_t>(turn * 65536 / kHeadings))},
        0};
    for (std::size_t i = 0; i < samples.size(); i += every) {
      const Cell c = frame.cell_at(transform(candidate.pose, samples[i].x_um, samples[i].y_um));
      if (frame.contains(c) && map.layers().inflation[frame.index_of(c)] != 0) ++candidate.score;
    }
    keep(candidate);
  }
}

// The best at each place, and the best of the places.
void Relocation::keep(const Candidate& candidate) {
  Candidate* worst = &candidates_[0];
  for (Candidate& kept : candidates_) {
    if (kept.score >= 0 && same_place(kept.pose, candidate.pose)) {
      if (candidate.score > kept.score) kept = candidate;
      return;
    }
    if (kept.score < worst->score) worst = &kept;
  }
  if (candidate.score > worst->score) *worst = candidate;
}

// A candidate a revolution, by the matcher.
Relocation::Result Relocation::judge(const ExplorationMap& map, const SurfaceMap& surfaces,
                                     ScanMatcher& matcher, const Scan& scan) {
  if (judged_ < kCandidates) {
    const Candidate& candidate = candidates_[judged_++];
    if (candidate.score < 0) return Result::kSearching;
    const ScanMatch match = matcher.locate(map, surfaces, candidate.pose, scan);
    if (match.outcome != MatchOutcome::kMatched) return Result::kSearching;
    if (best_.outcome == MatchOutcome::kMatched && same_place(match.pose, best_.pose)) {
      if (match.fitting > best_.fitting) best_ = match;
    } else if (match.fitting > best_.fitting) {
      second_fitting_ = best_.fitting;
      best_ = match;
    } else {
      second_fitting_ = std::max(second_fitting_, match.fitting);
    }
    return Result::kSearching;
  }
  const bool found =
      best_.outcome == MatchOutcome::kMatched && second_fitting_ * 100 < best_.fitting * 90;
  if (found) return Result::kFound;
  begin(map);
  return Result::kNotFound;
}

}  // namespace ivfm
