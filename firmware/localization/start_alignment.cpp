#include "firmware/localization/start_alignment.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdlib>

namespace ivfm {

namespace {

constexpr std::int32_t kDegree = 182;    // binary angle units
constexpr std::uint8_t kMostPasses = 4;  // of 17 revolutions
constexpr std::size_t kMinSamples = 40;
constexpr std::int32_t kMinPercent = 60;  // of the samples lie on obstacles
constexpr std::int32_t kSecondPercent = 93;
constexpr std::int64_t kSamePlaceUm = 250'000;
constexpr std::int32_t kSameTurn = 5 * kDegree;

BinaryAngle turned(BinaryAngle heading, std::int32_t units) {
  return heading +
         BinaryAngle(static_cast<std::uint16_t>(static_cast<std::uint32_t>(units) & 0xffffu));
}

// Bit i: whether the others hold cell i of four for an obstacle. Most hold nothing: one load tells.
std::uint32_t obstacles_among_four(const std::uint8_t* flags) {
  static_assert(cell_flag::kPeerTold == 128);
  const std::uint32_t told = (std::uint32_t{flags[0]} | std::uint32_t{flags[1]} << 8 |
                              std::uint32_t{flags[2]} << 16 | std::uint32_t{flags[3]} << 24) &
                             0x80808080u;
  // Moves bits 0, 8, 16 and 24 to 24, 25, 26 and 27; no two products fall on the same bit.
  return told == 0 ? 0 : ((told >> 7) * 0x01020408u) >> 24 & 15u;
}

// Bit i: whether the others hold the cell i - reach columns from `middle` for an obstacle.
std::uint64_t row_of(const ExplorationMap& map, Cell middle, std::int32_t reach) {
  const CellRect& window = map.frame().window();
  const std::int32_t left = middle.x - reach;
  const std::int32_t first = std::max<std::int32_t>(0, window.x - left);
  const std::int32_t end = std::min<std::int32_t>(2 * reach + 1, window.right() - left);
  if (middle.y < window.y || middle.y >= window.top() || first >= end) return 0;
  const std::uint8_t* flags = &map.layers().flags[map.frame().index_of({left + first, middle.y})];
  std::uint64_t bits = 0;
  std::int32_t i = first;
  for (; i + 4 <= end; i += 4, flags += 4) {
    const std::uint32_t four = obstacles_among_four(flags);
    if (four != 0) bits |= std::uint64_t{four} << i;
  }
  for (; i < end; ++i, ++flags) bits |= static_cast<std::uint64_t>(*flags >> 7) << i;
  return bits;
}

}  // namespace

void StartAlignment::begin(const Pose& start) {
  start_ = start;
  far_ = false;
  turn_ = -kNear.turns;
  reach_ = kNear;
  passes_ = 0;
}

void StartAlignment::search_far() {
  far_ = true;
  passes_ = 0;
}

StartAlignment::Result StartAlignment::step(const ExplorationMap& map,
                                            std::span<const SurfaceSample> samples,
                                            const Pose& pose) {
  if (turn_ == -reach_.turns) begin_pass(samples, pose);
  for (std::int32_t i = 0; i < reach_.headings_per_step && turn_ <= reach_.turns; ++i, ++turn_) {
    try_turn(map, turn_);
  }
  if (turn_ <= reach_.turns) return Result::kSearching;
  turn_ = -reach_.turns;
  if (is_clear()) {
    refine(map);
    return Result::kFound;
  }
  passes_ = std::min<std::uint8_t>(kMostPasses, passes_ + 1);
  return passes_ < kMostPasses ? Result::kSearching : Result::kNotFound;
}

void StartAlignment::begin_pass(std::span<const SurfaceSample> samples, const Pose& pose) {
  seen_from_ = pose;
  reach_ = far_ ? kFar : kNear;
  turn_ = -reach_.turns;
  size_ = std::min(samples.size(), points_.size());
  for (std::size_t i = 0; i < size_; ++i) {
    points_[i] = {static_cast<std::int16_t>(samples[i].x_um / 1000),
                  static_cast<std::int16_t>(samples[i].y_um / 1000)};
  }
  best_ = {pose, 0};
  second_ = {};
}

// Where the robot is if its start was turned and shifted: counts for each shift by whole cells how
// many samples lie on or beside obstacles.
void StartAlignment::try_turn(const ExplorationMap& map, std::int32_t turn) {
  const BinaryAngle heading = turned(start_.heading, turn * reach_.turn_degrees * kDegree);
  const Pose guess = compose({start_.position, heading}, relative_pose(start_, seen_from_));
  const GridFrame& frame = map.frame();
  const std::int32_t reach = reach_.cells, side = 2 * reach + 1;
  Band hits;
  for (std::int32_t first = -reach; first <= reach; first += kBandRows) {
    const std::int32_t rows = std::min(kBandRows, reach - first + 1);
    hits.fill(0);
    for (const SeenPoint& point : points()) {
      count_hits(map, frame.cell_at(transform(guess, point.x_mm * 1000, point.y_mm * 1000)), first,
                 rows, hits);
    }
    for (std::int32_t i = 0; i < rows * side; ++i) {
      const std::int32_t score = hits[static_cast<std::size_t>(i)];
      if (score < second_.score) continue;
      const std::int32_t x = i % side - reach, y = first + i / side;
      const bool at_rim =
          std::max({std::abs(x), std::abs(y)}) == reach || std::abs(turn) == reach_.turns;
      Candidate candidate{guess, score, at_rim};
      candidate.pose.position.x_um += x * frame.cell_um();
      candidate.pose.position.y_um += y * frame.cell_um();
      note(candidate);
    }
  }
}

// Of a sample that lies in `middle`, unless it is shifted.
void StartAlignment::count_hits(const ExplorationMap& map, Cell middle, std::int32_t first_row,
                                std::int32_t rows, Band& hits) const {
  static_assert(ScanSurfaces::kMaxSamples <= 255 && 2 * kFar.cells + 3 <= 64);
  const std::int32_t reach = reach_.cells, side = 2 * reach + 1;
  std::uint64_t below = 0, here = 0;  // rows, grown by a cell to both sides
  for (std::int32_t i = -1; i <= rows; ++i) {
    const std::uint64_t row = row_of(map, {middle.x, middle.y + first_row + i}, reach + 1);
    const std::uint64_t above = row | row << 1 | row >> 1;
    std::uint64_t near = i > 0 ? ((below | here | above) >> 1) & ((1ull << side) - 1) : 0;
    for (; near != 0; near &= near - 1) {
      ++hits[static_cast<std::size_t>((i - 1) * side + std::countr_zero(near))];
    }
    below = here;
    here = above;
  }
}

void StartAlignment::note(const Candidate& candidate) {
  const bool elsewhere = !is_near(candidate.pose, best_.pose, kSamePlaceUm, kSameTurn);
  const bool better = candidate.score > best_.score ||
                      (candidate.score == best_.score && best_.at_rim && !candidate.at_rim);
  if (better) {
    if (elsewhere) second_ = best_;
    best_ = candidate;
  } else if (elsewhere && candidate.score > second_.score) {
    second_ = candidate;
  }
}

bool StartAlignment::is_clear() const {
  const auto count = static_cast<std::int32_t>(size_);
  const bool other = !is_near(best_.pose, second_.pose, kSamePlaceUm, kSameTurn);
  return size_ >= kMinSamples && !best_.at_rim && best_.score * 100 >= count * kMinPercent &&
         (!other || second_.score * 100 < best_.score * kSecondPercent);
}

// The mean of the best poses around, by steps of half a cell and half a degree, counting only
// samples that lie on obstacles.
void StartAlignment::refine(const ExplorationMap& map) {
  const GridFrame& frame = map.frame();
  const Pose middle = best_.pose;
  const std::int32_t step_um = frame.cell_um() / 2, step_turn = kDegree / 2;
  std::int32_t most = 0;
  std::int64_t x = 0, y = 0, turn = 0, weights = 0;
  for (const bool summing : {false, true}) {
    for (std::int32_t i = 0; i < 5 * 5 * 5; ++i) {
      const std::int32_t dx = i % 5 - 2, dy = i / 5 % 5 - 2, dt = i / 25 - 2;
      const Pose pose{{middle.position.x_um + dx * step_um, middle.position.y_um + dy * step_um},
                      turned(middle.heading, dt * step_turn)};
      std::int32_t count = 0;
      for (const SeenPoint& point : points()) {
        const Cell cell = frame.cell_at(transform(pose, point.x_mm * 1000, point.y_mm * 1000));
        count += static_cast<std::int32_t>(row_of(map, cell, 0));
      }
      const std::int32_t weight = summing ? std::max<std::int32_t>(0, count - most * 9 / 10) : 0;
      most = std::max(most, count);
      x += std::int64_t{weight} * dx;
      y += std::int64_t{weight} * dy;
      turn += std::int64_t{weight} * dt;
      weights += weight;
    }
  }
  if (weights == 0) return;
  best_.pose.position.x_um += static_cast<std::int32_t>(x * step_um / weights);
  best_.pose.position.y_um += static_cast<std::int32_t>(y * step_um / weights);
  best_.pose.heading =
      turned(middle.heading, static_cast<std::int32_t>(turn * step_turn / weights));
}

}  // namespace ivfm
