#include "host/environment/arena_worlds.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>
#include <utility>

namespace ivfm::host {

namespace {

constexpr std::array<std::string_view, 4> kNames = {"1x", "2x", "divider", "divider-released"};

// Streams of the seed: what one purpose draws does not shift what another one gets.
enum Stream : std::uint64_t { kObstacleStream, kStartStream, kTargetStream };

// The free width between two boxes along the axis that separates them more (negative: overlap).
std::int32_t gap_um(const Box& a, const Box& b) {
  const std::int32_t gap_x = std::max(a.x0_um - b.x1_um, b.x0_um - a.x1_um);
  const std::int32_t gap_y = std::max(a.y0_um - b.y1_um, b.y0_um - a.y1_um);
  return std::max(gap_x, gap_y);
}

// A multiple of the truth cell in [low, high]; both must be multiples themselves.
std::int32_t random_lattice_um(Random& random, std::int32_t low, std::int32_t high) {
  return random.between(low / arena::kCellUm, high / arena::kCellUm) * arena::kCellUm;
}

std::vector<Box> random_columns(std::int32_t arena_side_um, int most, Random& random) {
  const int wanted = random.between(1, most);
  const std::int32_t low = -arena_side_um / 2 + arena::kWallGapUm;
  const std::int32_t high = arena_side_um / 2 - arena::kWallGapUm - arena::kColumnUm;
  std::vector<Box> columns;
  for (int tries = 0; tries < 20'000 && static_cast<int>(columns.size()) < wanted; ++tries) {
    const std::int32_t x = random_lattice_um(random, low, high);
    const std::int32_t y = random_lattice_um(random, low, high);
    const Box box{x, y, x + arena::kColumnUm, y + arena::kColumnUm};
    const bool fits = std::ranges::all_of(
        columns, [&](const Box& other) { return gap_um(box, other) >= arena::kColumnGapUm; });
    if (fits) columns.push_back(box);
  }
  return columns;
}

// One strip along y, in the middle of the y axis, at a random x.
Box random_strip(std::int32_t arena_side_um, std::int32_t length_um, std::int32_t width_um,
                 Random& random) {
  const std::int32_t low = -arena_side_um / 2 + arena::kWallGapUm;
  const std::int32_t high = arena_side_um / 2 - arena::kWallGapUm - width_um;
  const std::int32_t x = random_lattice_um(random, low, high);
  return {x, -length_um / 2, x + width_um, length_um / 2};
}

World rasterized(ArenaKind kind, const std::vector<Box>& boxes) {
  World world;
  world.name = name_of(kind);
  world.cell_um = arena::kCellUm;
  world.width = world.height = side_um(kind) / arena::kCellUm;
  world.origin = {-side_um(kind) / 2, -side_um(kind) / 2};
  world.occupied.assign(static_cast<std::size_t>(world.width) * world.height, 0);
  for (const Box& box : boxes) {
    for (std::int32_t y = box.y0_um; y < box.y1_um; y += arena::kCellUm) {
      for (std::int32_t x = box.x0_um; x < box.x1_um; x += arena::kCellUm) {
        const auto row = static_cast<std::size_t>((y - world.origin.y_um) / arena::kCellUm);
        const auto column = static_cast<std::size_t>((x - world.origin.x_um) / arena::kCellUm);
        world.occupied[row * static_cast<std::size_t>(world.width) + column] = 1;
      }
    }
  }
  return world;
}

std::vector<Pose> random_starts(const RayCaster& rays, std::int32_t arena_side_um, int agents,
                                Random& random) {
  const std::int32_t reach = arena_side_um / 2 - arena::kRobotRadiusUm - 1'000;
  constexpr std::int64_t kApart = 2 * arena::kRobotRadiusUm + 10'000;
  std::vector<Pose> starts;
  while (static_cast<int>(starts.size()) < agents) {
    Pose pose;
    pose.position = {random.between(-reach, reach), random.between(-reach, reach)};
    pose.heading = BinaryAngle(static_cast<std::uint16_t>(random.below(65536)));
    const bool is_apart = std::ranges::all_of(starts, [&](const Pose& other) {
      return squared_distance_um2(other.position, pose.position) >= kApart * kApart;
    });
    if (is_apart && rays.disc_is_free(pose.position, arena::kRobotRadiusUm + 1'000)) {
      starts.push_back(pose);
    }
  }
  return starts;
}

Point random_target(const std::vector<Box>& boxes, std::int32_t arena_side_um, Random& random) {
  constexpr std::int32_t kHalf = arena::kTargetUm / 2;
  const std::int32_t reach = arena_side_um / 2 - kHalf;
  for (;;) {
    const Point p{random.between(-reach, reach), random.between(-reach, reach)};
    const Box cube{p.x_um - kHalf, p.y_um - kHalf, p.x_um + kHalf, p.y_um + kHalf};
    if (std::ranges::all_of(boxes, [&](const Box& box) { return gap_um(box, cube) >= 0; })) {
      return p;
    }
  }
}

}  // namespace

std::optional<ArenaKind> arena_from_name(std::string_view name) {
  const auto found = std::ranges::find(kNames, name);
  if (found == kNames.end()) return std::nullopt;
  return static_cast<ArenaKind>(found - kNames.begin());
}

std::string_view name_of(ArenaKind kind) { return kNames[static_cast<std::size_t>(kind)]; }

std::int32_t side_um(ArenaKind kind) { return kind == ArenaKind::k2x ? 4'200'000 : 3'000'000; }

std::vector<Box> random_obstacles(ArenaKind kind, Random& random) {
  const std::int32_t side = side_um(kind);
  switch (kind) {
    case ArenaKind::k1x: return random_columns(side, 25, random);
    case ArenaKind::k2x: return random_columns(side, 50, random);
    case ArenaKind::kDivider: return {random_strip(side, 800'000, 50'000, random)};
    case ArenaKind::kDividerReleased: return {random_strip(side, 1'800'000, 100'000, random)};
  }
  return {};
}

Scenario random_arena(ArenaKind kind, int agents, std::uint64_t seed) {
  if (agents < 1 || agents > 32) {
    throw std::invalid_argument("an arena holds 1 to 32 agents, not " + std::to_string(agents));
  }
  Random obstacle_random(seed, kObstacleStream);
  Random start_random(seed, kStartStream);
  Random target_random(seed, kTargetStream);
  const std::vector<Box> boxes = random_obstacles(kind, obstacle_random);
  Scenario scenario;
  scenario.world = std::make_shared<World>(rasterized(kind, boxes));
  scenario.rays = std::make_shared<RayCaster>(scenario.world);
  scenario.starts = random_starts(*scenario.rays, side_um(kind), agents, start_random);
  scenario.target = random_target(boxes, side_um(kind), target_random);
  return scenario;
}

Scenario with_target_everywhere(Scenario arena) {
  constexpr std::int32_t kApart = 50'000, kHalf = arena::kTargetUm / 2;
  const World& world = *arena.world;
  const auto is_free = [&world](Point p) {
    for (std::int32_t y = p.y_um - kHalf; y <= p.y_um + kHalf; y += arena::kTargetUm / 11) {
      for (std::int32_t x = p.x_um - kHalf; x <= p.x_um + kHalf; x += arena::kTargetUm / 11) {
        if (world.is_occupied({x, y})) return false;
      }
    }
    return true;
  };
  arena.target.reset();
  for (std::int32_t y = kApart / 2; y < world.height * world.cell_um; y += kApart) {
    for (std::int32_t x = kApart / 2; x < world.width * world.cell_um; x += kApart) {
      const Point place{world.origin.x_um + x, world.origin.y_um + y};
      if (is_free(place)) arena.places.push_back(place);
    }
  }
  return arena;
}

}  // namespace ivfm::host
