#include "host/environment/building_worlds.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "host/environment/random.h"
#include "host/environment/reachable_area.h"

namespace ivfm::host {

namespace {

constexpr int kMaxAttempts = 50;
constexpr std::int64_t kLeastAreaMm2 =
    12'000'000;  // a plan that a robot can hardly enter is redrawn

// A plan being drawn, in cells; rectangles are clipped.
class Canvas {
 public:
  Canvas(const BuildingConfig& config, Random& random) : random_(random), cell_um_(config.cell_um) {
    const auto side = [&] {
      return random.between(config.min_side_um, config.max_side_um) / cell_um_;
    };
    world_.cell_um = cell_um_;
    world_.width = side();
    world_.height = side();
    world_.origin = {-world_.width / 2 * cell_um_, -world_.height / 2 * cell_um_};
    world_.occupied.assign(static_cast<std::size_t>(world_.width) * world_.height, 0);
  }

  Random& random() { return random_; }
  CellRect all() const { return {0, 0, world_.width, world_.height}; }
  World take() { return std::move(world_); }
  // Cells in `mm`, at least one.
  std::int32_t cells(std::int32_t mm) const { return std::max(1, mm * 1000 / cell_um_); }
  // A random length in cells.
  std::int32_t cells(std::int32_t low_mm, std::int32_t high_mm) {
    return cells(random_.between(low_mm, high_mm));
  }
  void fill(const CellRect& rect, bool occupied) {
    const CellRect inside = rect.intersection(all());
    for (std::int32_t y = inside.y; y < inside.top(); ++y) {
      for (std::int32_t x = inside.x; x < inside.right(); ++x) set(x, y, occupied);
    }
  }
  void fill_disc(Cell center, std::int32_t radius) {
    for (std::int32_t dy = -radius; dy <= radius; ++dy) {
      for (std::int32_t dx = -radius; dx <= radius; ++dx) {
        if (dx * dx + dy * dy > radius * radius) continue;
        if (all().contains(Cell{center.x + dx, center.y + dy}))
          set(center.x + dx, center.y + dy, true);
      }
    }
  }
  // The walls of `rect`, inside it.
  void outline(const CellRect& rect, std::int32_t wall) {
    fill({rect.x, rect.y, rect.width, wall}, true);
    fill({rect.x, rect.top() - wall, rect.width, wall}, true);
    fill({rect.x, rect.y, wall, rect.height}, true);
    fill({rect.right() - wall, rect.y, wall, rect.height}, true);
  }
  Cell random_cell(const CellRect& rect) {
    return {
        rect.x + static_cast<std::int32_t>(random_.below(static_cast<std::uint32_t>(rect.width))),
        rect.y + static_cast<std::int32_t>(random_.below(static_cast<std::uint32_t>(rect.height)))};
  }

 private:
  void set(std::int32_t x, std::int32_t y, bool occupied) {
    world_.occupied[static_cast<std::size_t>(y) * static_cast<std::size_t>(world_.width) +
                    static_cast<std::size_t>(x)] = occupied ? 1 : 0;
  }

  Random& random_;
  std::int32_t cell_um_;
  World world_;
};

// Measures of one plan, in cells.
struct Style {
  std::int32_t wall = 0;
  std::int32_t smallest_room = 0;
  std::int32_t door = 0;
  std::uint32_t second_door_percent = 0;
};

Style random_style(Canvas& canvas) {
  Style style;
  style.wall = canvas.cells(100, 250);
  style.smallest_room = canvas.cells(1'800, 4'500);
  style.door = canvas.cells(700, 1'300);
  style.second_door_percent = canvas.random().below(60);
  return style;
}

// Cuts a door of the style's width into a wall at `middle`, through anything within its depth.
CellRect door_at(const Style& style, Cell middle, bool in_vertical_wall) {
  const std::int32_t depth = 2 * style.wall + style.door;
  return in_vertical_wall
             ? CellRect{middle.x - depth / 2, middle.y - style.door / 2, depth, style.door}
             : CellRect{middle.x - style.door / 2, middle.y - depth / 2, style.door, depth};
}

// Splits `room` by walls until rooms are small; doors are collected to be cut when all walls stand.
void split_room(Canvas& canvas, const Style& style, const CellRect& room,
                std::vector<CellRect>& doors) {
  Random& random = canvas.random();
  const std::int32_t needed = 2 * style.smallest_room + style.wall;
  const bool can_split_x = room.width >= needed, can_split_y = room.height >= needed;
  if (!can_split_x && !can_split_y) return;
  const bool is_small = room.width < 2 * needed && room.height < 2 * needed;
  if (is_small && random.chance(25)) return;
  const bool vertical = can_split_x && (!can_split_y || room.width > room.height);
  const std::int32_t length = vertical ? room.width : room.height;
  const std::int32_t at =
      random.between(style.smallest_room, length - style.smallest_room - style.wall);
  CellRect wall = room, first = room, second = room;
  if (vertical) {
    wall.x += at, wall.width = style.wall;
    first.width = at;
    second.x += at + style.wall, second.width -= at + style.wall;
  } else {
    wall.y += at, wall.height = style.wall;
    first.height = at;
    second.y += at + style.wall, second.height -= at + style.wall;
  }
  canvas.fill(wall, true);
  const int count = random.chance(style.second_door_percent) ? 2 : 1;
  for (int i = 0; i < count; ++i)
    doors.push_back(door_at(style, canvas.random_cell(wall), vertical));
  split_room(canvas, style, first, doors);
  split_room(canvas, style, second, doors);
}

// A block of rooms with a wall around it and doors outwards.
void add_block(Canvas& canvas, const Style& style, const CellRect& block,
               std::vector<CellRect>& doors) {
  if (block.width < style.smallest_room || block.height < style.smallest_room) {
    canvas.fill(block, true);
    return;
  }
  canvas.outline(block, style.wall);
  split_room(canvas, style, block.grown(-style.wall), doors);
  const auto side_doors = [&](std::int32_t length) {
    return 1 + length / (4 * style.smallest_room);
  };
  for (std::int32_t i = side_doors(block.width); i > 0; --i) {
    const std::int32_t x = canvas.random_cell(block.grown(-style.wall)).x;
    doors.push_back(
        door_at(style, {x, canvas.random().chance(50) ? block.y : block.top() - 1}, false));
  }
  for (std::int32_t i = side_doors(block.height); i > 0; --i) {
    const std::int32_t y = canvas.random_cell(block.grown(-style.wall)).y;
    doors.push_back(
        door_at(style, {canvas.random().chance(50) ? block.x : block.right() - 1, y}, true));
  }
}

void cut_doors(Canvas& canvas, const std::vector<CellRect>& doors) {
  for (const CellRect& door : doors) canvas.fill(door, false);
}

void draw_rooms(Canvas& canvas) {
  std::vector<CellRect> doors;
  split_room(canvas, random_style(canvas), canvas.all(), doors);
  cut_doors(canvas, doors);
}

// The spans between bands of `width` at random places along `length`.
std::vector<std::pair<std::int32_t, std::int32_t>> spans_between_bands(Canvas& canvas,
                                                                       std::int32_t length,
                                                                       std::int32_t width,
                                                                       std::int32_t least_span) {
  std::vector<std::pair<std::int32_t, std::int32_t>> spans;
  std::int32_t from = 0;
  while (length - from > 2 * least_span + width) {
    const std::int32_t widest = std::min(3 * least_span, length - from - least_span - width);
    const std::int32_t to =
        from + canvas.random().between(least_span, std::max(least_span, widest));
    spans.emplace_back(from, to);
    from = to + width;
  }
  spans.emplace_back(from, length);
  return spans;
}

void draw_corridors(Canvas& canvas) {
  const Style style = random_style(canvas);
  const std::int32_t corridor = canvas.cells(1'200, 3'000);
  const std::int32_t block = canvas.cells(4'000, 10'000);
  std::vector<CellRect> doors;
  const auto columns = spans_between_bands(canvas, canvas.all().width, corridor, block);
  const auto rows = spans_between_bands(canvas, canvas.all().height, corridor, block);
  for (const auto& [x0, x1] : columns) {
    for (const auto& [y0, y1] : rows) {
      add_block(canvas, style, {x0, y0, x1 - x0, y1 - y0}, doors);
    }
  }
  cut_doors(canvas, doors);
}

void draw_ring(Canvas& canvas) {
  const Style style = random_style(canvas);
  const CellRect all = canvas.all();
  const std::int32_t corridor = canvas.cells(1'300, 3'000);
  const std::int32_t most = std::min(all.width, all.height) / 2 - corridor - canvas.cells(600);
  const std::int32_t depth = std::clamp(canvas.cells(2'500, 7'000), 1, std::max(1, most));
  std::vector<CellRect> doors;
  add_block(canvas, style, {0, 0, all.width, depth}, doors);
  add_block(canvas, style, {0, all.height - depth, all.width, depth}, doors);
  add_block(canvas, style, {0, depth, depth, all.height - 2 * depth}, doors);
  add_block(canvas, style, {all.width - depth, depth, depth, all.height - 2 * depth}, doors);
  const CellRect core = all.grown(-(depth + corridor));
  if (canvas.random().chance(40)) {
    canvas.fill(core, true);
  } else if (!core.empty()) {
    add_block(canvas, style, core, doors);
  }
  cut_doors(canvas, doors);
}

void draw_hall(Canvas& canvas) {
  Random& random = canvas.random();
  const std::int32_t spacing = canvas.cells(2'500, 6'000);
  const std::int32_t pillar = canvas.cells(200, 700);
  const std::uint32_t pillar_percent = random.below(100);
  for (std::int32_t y = spacing / 2; y < canvas.all().height; y += spacing) {
    for (std::int32_t x = spacing / 2; x < canvas.all().width; x += spacing) {
      if (random.chance(pillar_percent)) canvas.fill({x, y, pillar, pillar}, true);
    }
  }
  const std::int32_t wall = canvas.cells(100, 250);
  const auto partitions = static_cast<std::int32_t>(random.below(12));
  for (std::int32_t i = 0; i < partitions; ++i) {
    const Cell at = canvas.random_cell(canvas.all());
    const std::int32_t length = canvas.cells(1'000, 8'000);
    canvas.fill(
        random.chance(50) ? CellRect{at.x, at.y, length, wall} : CellRect{at.x, at.y, wall, length},
        true);
  }
}

// Cellular automaton on blocks (the well-known 4-5 rule), drawn as overlapping discs.
void draw_cave(Canvas& canvas) {
  Random& random = canvas.random();
  const std::int32_t block = canvas.cells(350, 700);
  const std::int32_t w = canvas.all().width / block + 1, h = canvas.all().height / block + 1;
  const std::uint32_t rock_percent = 40 + random.below(6);
  std::vector<std::uint8_t> rock(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
  for (auto& cell : rock) cell = random.chance(rock_percent) ? 1 : 0;
  const auto is_rock = [&](const std::vector<std::uint8_t>& map, std::int32_t x, std::int32_t y) {
    if (x < 0 || y < 0 || x >= w || y >= h) return 1;
    return int{map[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) +
                   static_cast<std::size_t>(x)]};
  };
  for (int round = 0; round < 4; ++round) {
    const std::vector<std::uint8_t> before = rock;
    for (std::int32_t y = 0; y < h; ++y) {
      for (std::int32_t x = 0; x < w; ++x) {
        int around = 0;
        for (int k = 0; k < 9; ++k) around += is_rock(before, x + k % 3 - 1, y + k / 3 - 1);
        rock[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) +
             static_cast<std::size_t>(x)] = around >= 5 ? 1 : 0;
      }
    }
  }
  for (std::int32_t y = 0; y < h; ++y) {
    for (std::int32_t x = 0; x < w; ++x) {
      if (is_rock(rock, x, y) == 0) continue;
      const std::int32_t wobble = canvas.random().between(block / 2, block * 4 / 5);
      canvas.fill_disc({x * block, y * block}, wobble);
    }
  }
}

void add_furniture(Canvas& canvas) {
  Random& random = canvas.random();
  const double area_m2 = static_cast<double>(canvas.all().area()) /
                         (static_cast<double>(canvas.cells(1'000)) * canvas.cells(1'000));
  const auto most = static_cast<std::uint32_t>(area_m2 / 6.0);
  const std::uint32_t pieces = random.chance(25) ? 0 : random.below(most + 1);
  for (std::uint32_t i = 0; i < pieces; ++i) {
    const Cell at = canvas.random_cell(canvas.all());
    if (random.chance(25)) {
      canvas.fill_disc(at, canvas.cells(100, 500));
    } else {
      canvas.fill({at.x, at.y, canvas.cells(150, 1'600), canvas.cells(150, 900)}, true);
    }
  }
}

void draw(Canvas& canvas, BuildingStyle style) {
  switch (style) {
    case BuildingStyle::kRooms: return draw_rooms(canvas);
    case BuildingStyle::kCorridors: return draw_corridors(canvas);
    case BuildingStyle::kHall: return draw_hall(canvas);
    case BuildingStyle::kCave: return draw_cave(canvas);
    case BuildingStyle::kRing: return draw_ring(canvas);
    case BuildingStyle::kMixed:
      return draw(canvas, static_cast<BuildingStyle>(canvas.random().below(5)));
  }
}

void check(const BuildingConfig& config, int agents) {
  const auto require = [](bool holds, const char* what) {
    if (!holds) throw std::invalid_argument(std::string("random building: ") + what);
  };
  require(agents >= 1 && agents <= 32, "it holds 1 to 32 agents");
  require(config.cell_um >= 10'000 && config.cell_um <= 200'000, "cells are 1 cm to 20 cm");
  require(config.min_side_um >= 4'000'000, "sides are at least 4 m");
  require(config.max_side_um >= config.min_side_um, "the longest side is below the shortest");
  require(config.max_side_um <= 200'000'000, "sides are at most 200 m");
  require(config.robot_radius_um > 0 && config.robot_radius_um <= 400'000,
          "the robot's radius is at most 0.4 m");
}

// The cells that robots can start on: the place that the first of several random cells reaches, if
// it is large enough; empty otherwise.
std::vector<std::size_t> start_cells(const RayCaster& rays, const GridFrame& frame,
                                     std::int32_t radius_um, Random& random) {
  const std::int64_t cell_mm = frame.cell_um() / 1000;
  const std::int64_t least = kLeastAreaMm2 / (cell_mm * cell_mm);
  for (int tries = 0; tries < 20; ++tries) {
    const Cell cell = frame.cell_of_index(random.below(static_cast<std::uint32_t>(frame.size())));
    if (!rays.disc_is_free(frame.center_of(cell), radius_um)) continue;
    const auto reached = reachable_centers(rays, frame, cell, radius_um);
    std::vector<std::size_t> cells;
    for (std::size_t i = 0; i < reached.size(); ++i) {
      if (reached[i] != 0) cells.push_back(i);
    }
    if (static_cast<std::int64_t>(cells.size()) >= least) return cells;
  }
  return {};
}

bool place_robots(const RayCaster& rays, std::int32_t radius_um, int agents, Random& random,
                  std::vector<Pose>& starts) {
  const World& world = rays.world();
  const GridFrame frame(world.cell_um, extent_of(world, world.cell_um));
  const auto cells = start_cells(rays, frame, radius_um + 20'000, random);
  if (cells.empty()) return false;
  const std::int64_t apart = 2 * std::int64_t{radius_um} + 50'000;
  for (int tries = 0; tries < 1000 && static_cast<int>(starts.size()) < agents; ++tries) {
    const std::size_t index = cells[random.below(static_cast<std::uint32_t>(cells.size()))];
    const Pose pose{frame.center_of(frame.cell_of_index(index)),
                    BinaryAngle(static_cast<std::uint16_t>(random.below(65536)))};
    const bool is_apart = std::ranges::all_of(starts, [&](const Pose& other) {
      return squared_distance_um2(other.position, pose.position) >= apart * apart;
    });
    if (is_apart) starts.push_back(pose);
  }
  return static_cast<int>(starts.size()) == agents;
}

}  // namespace

Scenario random_building(const BuildingConfig& config, int agents, std::uint64_t seed) {
  check(config, agents);
  for (std::uint64_t attempt = 0; attempt < kMaxAttempts; ++attempt) {
    Random random(seed, attempt);
    Canvas canvas(config, random);
    draw(canvas, config.style);
    add_furniture(canvas);
    Scenario scenario;
    World world = canvas.take();
    world.name = "building";
    scenario.world = std::make_shared<World>(std::move(world));
    scenario.rays = std::make_shared<RayCaster>(scenario.world);
    if (place_robots(*scenario.rays, config.robot_radius_um, agents, random, scenario.starts)) {
      return scenario;
    }
  }
  throw std::runtime_error("random building: no plan of these sides holds that many robots");
}

}  // namespace ivfm::host
