#include "host/map_server/frame_finder.h"

namespace ivfm::host {
namespace {

constexpr TimeUs kPeriodUs = 5'000'000;
constexpr std::uint64_t kGrown = 40;  // obstacle cells
constexpr double kPlentyM = 40;       // of walls that both have seen
constexpr double kMoreM = 5;
constexpr std::int64_t kAgreeUm = 150'000;
constexpr std::int32_t kAgreeTurn = 364;  // 2 degrees

}  // namespace

std::optional<FrameFinder::Found> FrameFinder::step(const MapStore& team, const ApartMaps& apart,
                                                    std::int32_t cell_um, TimeUs now_us) {
  if (!alignment_) begin(team, apart, cell_um, now_us);
  if (!alignment_ || !alignment_->step()) return std::nullopt;
  const std::optional<MapMatch> match = alignment_->match();
  alignment_.reset();
  if (!match) return std::nullopt;
  Search& search = searches_[searching_];
  if (!confirms(search.likely, *match)) {
    const bool agrees =
        search.likely && is_near(search.likely->frame, match->frame, kAgreeUm, kAgreeTurn);
    if (!agrees) search.likely = match;
    return std::nullopt;
  }
  search.done = true;
  return Found{searching_, *match};
}

// The map that waits longest.
void FrameFinder::begin(const MapStore& team, const ApartMaps& apart, std::int32_t cell_um,
                        TimeUs now_us) {
  Search* next = nullptr;
  for (const auto& [robot, map] : apart) {
    Search& search = searches_[robot];
    if (!is_due(search, team, map, now_us)) continue;
    if (next != nullptr && next->begun_us <= search.begun_us) continue;
    next = &search;
    searching_ = robot;
  }
  if (next == nullptr) return;
  const MapStore& map = apart.at(searching_);
  next->team_cells = team.obstacle_cells();
  next->apart_cells = map.obstacle_cells();
  next->begun_us = now_us;
  alignment_ = std::make_unique<MapAlignment>(team, map, cell_um);
}

bool FrameFinder::is_due(const Search& search, const MapStore& team, const MapStore& apart,
                         TimeUs now_us) {
  if (search.done || now_us - search.begun_us < kPeriodUs) return false;
  return team.obstacle_cells() >= search.team_cells + kGrown ||
         apart.obstacle_cells() >= search.apart_cells + kGrown;
}

bool FrameFinder::confirms(const std::optional<MapMatch>& earlier, const MapMatch& match) {
  if (match.wall_m >= kPlentyM) return true;
  return earlier && is_near(earlier->frame, match.frame, kAgreeUm, kAgreeTurn) &&
         match.wall_m >= earlier->wall_m + kMoreM;
}

void FrameFinder::forget(std::uint16_t robot) {
  searches_.erase(robot);
  if (searching_ == robot) alignment_.reset();
}

}  // namespace ivfm::host
