#include "firmware/mapping/exploration_map.h"

#include <algorithm>
#include <cassert>
#include <cstdlib>
#include <cstring>

namespace ivfm {

namespace {

template <typename T>
bool all_clear(std::span<const T> cells) {
  T all{};
  for (const T cell : cells) all = static_cast<T>(all | cell);  // many at once: no early way out
  return all == T{};
}

// Writes only where it has to: memory that the operating system gives out when it is first written
// to (a robot's map of an unknown world) stays free until the robot gets there.
template <typename T>
void clear_cells(std::span<T> cells) {
  constexpr std::size_t kAtOnce = 1024;
  for (; !cells.empty(); cells = cells.subspan(std::min(kAtOnce, cells.size()))) {
    const std::span<T> part = cells.first(std::min(kAtOnce, cells.size()));
    if (!all_clear(std::span<const T>(part))) std::ranges::fill(part, T{});
  }
}

// Moves the contents of a row-major layer by (dx, dy) cells and fills what enters with zeros.
template <typename T>
void scroll(std::span<T> layer, const CellRect& from, const CellRect& to) {
  const CellRect kept = from.intersection(to);
  const auto row_of = [&](const CellRect& w, std::int32_t y) {
    return layer.data() + static_cast<std::size_t>(y - w.y) * static_cast<std::size_t>(w.width);
  };
  const auto move_row = [&](std::int32_t y) {
    T* target = row_of(to, y);
    const auto width = static_cast<std::size_t>(kept.width);
    const T* source = row_of(from, y) + (kept.x - from.x);
    const auto row_width = static_cast<std::size_t>(to.width);
    if (all_clear(std::span(source, width)) && all_clear(std::span<const T>(target, row_width))) {
      return;
    }
    const std::size_t left = static_cast<std::size_t>(kept.x - to.x);
    std::memmove(target + left, source, width * sizeof(T));
    std::fill(target, target + left, T{});
    std::fill(target + left + width, target + to.width, T{});
  };
  if (to.y >= from.y) {  // contents move down in memory: lowest rows first
    for (std::int32_t y = kept.y; y < kept.top(); ++y) move_row(y);
  } else {
    for (std::int32_t y = kept.top() - 1; y >= kept.y; --y) move_row(y);
  }
  for (std::int32_t y = to.y; y < to.top(); ++y) {
    if (y < kept.y || y >= kept.top()) {
      clear_cells(std::span(row_of(to, y), static_cast<std::size_t>(to.width)));
    }
  }
}

std::uint8_t saturating_add(std::uint8_t a, std::uint8_t b) {
  const unsigned sum = static_cast<unsigned>(a) + b;
  return static_cast<std::uint8_t>(std::min(sum, 255u));
}

// Goes from `a` to before `b` cell by cell (Bresenham 1965), and tells at each of them along which
// axes the next one lies. Sums instead of branches: those are hard to predict.
template <typename Leave>
void walk_line(Cell a, Cell b, Leave leave) {
  const std::int32_t dx = std::abs(b.x - a.x), dy = -std::abs(b.y - a.y);
  std::int32_t error = dx + dy;
  for (std::int32_t left = std::max(dx, -dy); left > 0; --left) {
    const bool along_x = 2 * error >= dy, along_y = 2 * error <= dx;
    error += (along_x ? dy : 0) + (along_y ? dx : 0);
    leave(along_x, along_y);
  }
}

// A rectangle of cells that holds `rect` moved by `moved`.
CellRect moved_rect(const GridFrame& frame, const CellRect& rect, const Pose& moved) {
  CellRect box{};
  for (const Cell corner : {Cell{rect.x, rect.y}, Cell{rect.right(), rect.y},
                            Cell{rect.x, rect.top()}, Cell{rect.right(), rect.top()}}) {
    const Point p = frame.center_of(corner);
    box = box.united(frame.cell_at(transform(moved, p.x_um, p.y_um)));
  }
  return box.grown(1);
}

}  // namespace

ExplorationMap::ExplorationMap(const MapLayers& layers, std::int32_t cell_um,
                               std::int32_t window_cells, std::int32_t robot_radius_um)
    : layers_(layers),
      frame_(cell_um, {-window_cells / 2, -window_cells / 2, window_cells, window_cells}),
      robot_radius_um_(robot_radius_um) {
  disc_radius_cells_ = std::min<std::int32_t>(8, robot_radius_um / cell_um + 1);
  const std::int64_t radius2 = std::int64_t{robot_radius_um} * robot_radius_um;
  for (std::int32_t dy = -disc_radius_cells_; dy <= disc_radius_cells_; ++dy) {
    std::int32_t half = -1;  // an obstacle counts when its centre is inside the disc
    while (half < disc_radius_cells_) {
      const std::int64_t dx = half + 1;
      if ((dx * dx + std::int64_t{dy} * dy) * cell_um * cell_um > radius2) break;
      ++half;
    }
    disc_half_width_[static_cast<std::size_t>(dy + disc_radius_cells_)] =
        static_cast<std::int8_t>(half);
  }
  clear({0, 0});
}

void ExplorationMap::clear(Cell center) {
  const std::int32_t side = frame_.width();
  frame_ = GridFrame(frame_.cell_um(), {center.x - side / 2, center.y - side / 2, side, side});
  static_assert(occupancy::kUnknown == 0);
  clear_cells(layers_.occupancy);
  for (const auto& layer :
       {layers_.own_visits, layers_.peer_visits, layers_.flags, layers_.inflation}) {
    clear_cells(layer);
  }
  changes_ = {};
  known_ = robots_ = {};
}

bool ExplorationMap::roll_to(Cell robot) {
  const CellRect& w = frame_.window();
  const std::int32_t margin = w.width / 4;
  const auto shift = [&](std::int32_t position, std::int32_t low) -> std::int32_t {
    if (position < low + margin || position >= low + w.width - margin) {
      return position - w.width / 2 - low;
    }
    return 0;
  };
  const std::int32_t dx = shift(robot.x, w.x), dy = shift(robot.y, w.y);
  if (dx == 0 && dy == 0) return false;
  const CellRect moved{w.x + dx, w.y + dy, w.width, w.height};
  if (moved.intersection(w).empty()) {
    clear(robot);
    return true;
  }
  scroll(layers_.occupancy, w, moved);
  scroll(layers_.own_visits, w, moved);
  scroll(layers_.peer_visits, w, moved);
  scroll(layers_.flags, w, moved);
  scroll(layers_.inflation, w, moved);
  frame_ = GridFrame(frame_.cell_um(), moved);
  for (CellRect& change : changes_) change = change.intersection(moved);
  known_ = known_.intersection(moved);
  return true;
}

bool ExplorationMap::is_known_free(Cell c) const {
  if (!frame_.contains(c)) return false;
  const std::size_t i = frame_.index_of(c);
  if (layers_.flags[i] & cell_flag::kObstacle) return false;
  return layers_.occupancy[i] < 0 || layers_.own_visits[i] != 0 || layers_.peer_visits[i] != 0;
}

unsigned ExplorationMap::visits(Cell c) const {
  if (!frame_.contains(c)) return 0;
  const std::size_t i = frame_.index_of(c);
  return saturating_add(layers_.own_visits[i], layers_.peer_visits[i]);
}

bool ExplorationMap::obstacle_within(Cell c, std::int32_t radius_um) const {
  const std::int32_t reach = radius_um / frame_.cell_um();
  const std::int64_t radius2 = std::int64_t{radius_um} * radius_um;
  for (std::int32_t dy = -reach; dy <= reach; ++dy) {
    for (std::int32_t dx = -reach; dx <= reach; ++dx) {
      const std::int64_t square =
          std::int64_t{dx * dx + dy * dy} * frame_.cell_um() * frame_.cell_um();
      if (square <= radius2 && is_obstacle({c.x + dx, c.y + dy})) return true;
    }
  }
  return false;
}

void ExplorationMap::add_evidence(Cell c, int evidence) {
  if (!frame_.contains(c)) return;
  std::int8_t& cell = layers_.occupancy[frame_.index_of(c)];
  cell = static_cast<std::int8_t>(std::clamp(cell + evidence, occupancy::kMin, occupancy::kMax));
  update_obstacle(c, cell_flag::kOwnObstacle, cell > 0);
  if (cell == occupancy::kMin) update_obstacle(c, cell_flag::kPeerObstacle, false);
  known_ = known_.united(c);
}

void ExplorationMap::doubt(Cell c) {
  if (frame_.contains(c)) layers_.occupancy[frame_.index_of(c)] = occupancy::kDoubted;
}

// Each cell takes over what the cell held from where its middle came: so there are no holes.
void ExplorationMap::re_express(const Pose& moved) {
  if (known_.empty()) return;
  forget_robots();
  const Pose back = relative_pose(moved, {});
  const CellRect region =
      known_.united(moved_rect(frame_, known_, moved)).intersection(frame_.window());
  const auto for_each_cell = [&region](auto&& visit) {
    for (std::int32_t y = region.y; y < region.top(); ++y) {
      for (std::int32_t x = region.x; x < region.right(); ++x) visit(Cell{x, y});
    }
  };
  for_each_cell([&](Cell c) {
    const Point p = frame_.center_of(c);
    const Cell from = frame_.cell_at(transform(back, p.x_um, p.y_um));
    std::uint16_t packed = 0;
    if (frame_.contains(from)) {
      const std::size_t i = frame_.index_of(from);
      const auto evidence = static_cast<std::uint8_t>(layers_.occupancy[i]);
      packed = static_cast<std::uint16_t>(unsigned{layers_.own_visits[i]} << 8 | evidence);
    }
    layers_.path_cost[frame_.index_of(c)] = packed;
  });
  for_each_cell([&](Cell c) {
    const std::size_t i = frame_.index_of(c);
    layers_.own_visits[i] = static_cast<std::uint8_t>(layers_.path_cost[i] >> 8);
    layers_.occupancy[i] = static_cast<std::int8_t>(layers_.path_cost[i] & 0xff);
    set_flag_at(i, cell_flag::kGivenUp, false);
    update_obstacle(c, cell_flag::kOwnObstacle, layers_.occupancy[i] > 0);
    believe_peers(c);
  });
  known_ = region;
  for (CellRect& change : changes_) change = region;  // all of it is to be told anew
}

void ExplorationMap::re_express_alone(const Pose& moved) {
  forget_robots();
  const CellRect before = frame_.window();
  const Cell middle{before.x + before.width / 2, before.y + before.height / 2};
  const Point p = frame_.center_of(middle);
  const Cell to = frame_.cell_at(transform(moved, p.x_um, p.y_um));
  const Cell by{to.x - middle.x, to.y - middle.y};
  const auto shifted = [by](CellRect rect) {
    return rect.empty() ? rect : CellRect{rect.x + by.x, rect.y + by.y, rect.width, rect.height};
  };
  frame_ = GridFrame(frame_.cell_um(), shifted(before));  // the cells stay, and get other numbers
  known_ = shifted(known_);
  const std::int32_t cell_um = frame_.cell_um();
  re_express(compose(moved, {{-by.x * cell_um, -by.y * cell_um}, {}}));
}

void ExplorationMap::put_robot(Cell c) {
  if (!frame_.contains(c)) return;
  update_obstacle(c, cell_flag::kRobot, true);
  robots_ = robots_.united(c);
}

void ExplorationMap::forget_robots() {
  const CellRect rect = robots_.intersection(frame_.window());
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    for (std::int32_t x = rect.x; x < rect.right(); ++x) {
      update_obstacle({x, y}, cell_flag::kRobot, false);
    }
  }
  robots_ = {};
}

inline void ExplorationMap::add_misses_at(std::size_t index, int times) {
  if (layers_.flags[index] & cell_flag::kHitThisScan) return;
  std::int8_t& cell = layers_.occupancy[index];
  const int before = cell;
  if (before <= occupancy::kMin) return;
  const int now = std::max(occupancy::kMin, before + times * occupancy::kMiss);
  cell = static_cast<std::int8_t>(now);
  if (before > 0 && now <= 0) {
    update_obstacle(frame_.cell_of_index(index), cell_flag::kOwnObstacle, false);
  }
  if (now == occupancy::kMin && (layers_.flags[index] & cell_flag::kPeerObstacle) != 0) {
    update_obstacle(frame_.cell_of_index(index), cell_flag::kPeerObstacle, false);
  }
}

void ExplorationMap::add_misses_on_line(Cell a, Cell b, int times) {
  known_ = known_.united(CellRect{a.x, a.y, 1, 1}.united(b).intersection(frame_.window()));
  // Compiled twice: most of a lidar's beams end where no other does.
  if (times == 1) return for_each_on_line(a, b, [this](std::size_t i) { add_misses_at(i, 1); });
  for_each_on_line(a, b, [this, times](std::size_t i) { add_misses_at(i, times); });
}

// Calls visit(index) for the window's cells on the line from `a` to before `b`.
template <typename Visit>
void ExplorationMap::for_each_on_line(Cell a, Cell b, Visit visit) {
  const std::int32_t sx = a.x < b.x ? 1 : -1, sy = a.y < b.y ? 1 : -1;
  if (frame_.contains(a) && frame_.contains(b)) {  // then so is the whole line
    auto index = static_cast<std::ptrdiff_t>(frame_.index_of(a));
    const std::int32_t stride = sy * frame_.width();
    return walk_line(a, b, [&](bool along_x, bool along_y) {
      visit(static_cast<std::size_t>(index));
      index += (along_x ? sx : 0) + (along_y ? stride : 0);
    });
  }
  walk_line(a, b, [&](bool along_x, bool along_y) {
    if (frame_.contains(a)) visit(frame_.index_of(a));
    a.x += along_x ? sx : 0;
    a.y += along_y ? sy : 0;
  });
}

void ExplorationMap::count_visit(Cell c) {
  assert(frame_.contains(c));
  count_visit_at(frame_.index_of(c));
  note_visits({c.x, c.y, 1, 1});
}

void ExplorationMap::note_visits(const CellRect& rect) {
  CellRect& change = changes_[static_cast<std::size_t>(Layer::kVisits)];
  change = change.united(rect);
  known_ = known_.united(rect);
}

void ExplorationMap::set_flag(Cell c, std::uint8_t flag) {
  if (!frame_.contains(c)) return;
  std::uint8_t& flags = layers_.flags[frame_.index_of(c)];
  flags = static_cast<std::uint8_t>(flags | flag);
}

void ExplorationMap::clear_flag(const CellRect& rect, std::uint8_t flag) {
  const CellRect inside = rect.intersection(frame_.window());
  const auto keep = static_cast<std::uint8_t>(~flag);
  for (std::int32_t y = inside.y; y < inside.top(); ++y) {
    std::uint8_t* row = &layers_.flags[frame_.index_of({inside.x, y})];
    for (std::int32_t i = 0; i < inside.width; ++i) row[i] = row[i] & keep;
  }
}

CellRect ExplorationMap::take_changes(Layer layer) {
  CellRect& change = changes_[static_cast<std::size_t>(layer)];
  const CellRect taken = change;
  change = {};
  return taken;
}

Status ExplorationMap::read_own(Layer layer, const CellRect& rect,
                                std::span<std::uint8_t> out) const {
  if (!frame_.window().contains(rect)) return Status::kOutOfRange;
  if (static_cast<std::int64_t>(out.size()) != rect.area()) return Status::kInvalidArgument;
  std::size_t next = 0;
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    const std::size_t row = rect.empty() ? 0 : frame_.index_of({rect.x, y});
    for (std::size_t i = row; i < row + static_cast<std::size_t>(rect.width); ++i) {
      out[next++] = layer == Layer::kVisits ? layers_.own_visits[i]
                                            : (layers_.flags[i] & cell_flag::kOwnObstacle ? 1 : 0);
    }
  }
  return Status::kOk;
}

Status ExplorationMap::write_peers(Layer layer, const CellRect& rect,
                                   std::span<const std::uint8_t> cells) {
  if (static_cast<std::int64_t>(cells.size()) != rect.area()) return Status::kInvalidArgument;
  const CellRect inside = rect.intersection(frame_.window());
  known_ = known_.united(inside);
  for (std::int32_t y = inside.y; y < inside.top(); ++y) {
    for (std::int32_t x = inside.x; x < inside.right(); ++x) {
      const std::uint8_t value =
          cells[static_cast<std::size_t>(y - rect.y) * static_cast<std::size_t>(rect.width) +
                static_cast<std::size_t>(x - rect.x)];
      const std::size_t i = frame_.index_of({x, y});
      if (layer == Layer::kVisits) {
        layers_.peer_visits[i] = value;
      } else {
        set_flag_at(i, cell_flag::kPeerTold, value != 0);
        believe_peers({x, y});
      }
    }
  }
  return Status::kOk;
}

Status ExplorationMap::restore_own(Layer layer, const CellRect& rect,
                                   std::span<const std::uint8_t> cells) {
  if (static_cast<std::int64_t>(cells.size()) != rect.area()) return Status::kInvalidArgument;
  const CellRect inside = rect.intersection(frame_.window());
  known_ = known_.united(inside);
  for (std::int32_t y = inside.y; y < inside.top(); ++y) {
    for (std::int32_t x = inside.x; x < inside.right(); ++x) {
      const std::size_t i =
          static_cast<std::size_t>(y - rect.y) * static_cast<std::size_t>(rect.width) +
          static_cast<std::size_t>(x - rect.x);
      restore_cell(layer, {x, y}, cells[i]);
    }
  }
  return Status::kOk;
}

void ExplorationMap::restore_cell(Layer layer, Cell c, std::uint8_t value) {
  const std::size_t i = frame_.index_of(c);
  if (layer == Layer::kVisits) {
    std::uint8_t& count = layers_.own_visits[i];
    if (count != 0 && value != 0) note_change(layer, c);
    count = saturating_add(count, value);
    return;
  }
  if (value != 0 && layers_.occupancy[i] == occupancy::kUnknown) add_evidence(c, occupancy::kHit);
  const bool is_obstacle_now = (layers_.flags[i] & cell_flag::kOwnObstacle) != 0;
  if (is_obstacle_now != (value != 0)) note_change(layer, c);
}

void ExplorationMap::copy_from(const ExplorationMap& other) {
  assert(frame_.width() == other.frame_.width());
  std::ranges::copy(other.layers_.occupancy, layers_.occupancy.begin());
  std::ranges::copy(other.layers_.own_visits, layers_.own_visits.begin());
  std::ranges::copy(other.layers_.peer_visits, layers_.peer_visits.begin());
  std::ranges::copy(other.layers_.flags, layers_.flags.begin());
  std::ranges::copy(other.layers_.inflation, layers_.inflation.begin());
  std::ranges::copy(other.layers_.path_cost, layers_.path_cost.begin());
  frame_ = other.frame_;
  robot_radius_um_ = other.robot_radius_um_;
  disc_half_width_ = other.disc_half_width_;
  disc_radius_cells_ = other.disc_radius_cells_;
  changes_ = other.changes_;
  known_ = other.known_;
  robots_ = other.robots_;
}

void ExplorationMap::update_obstacle(Cell c, std::uint8_t flag, bool occupied) {
  std::uint8_t& flags = layers_.flags[frame_.index_of(c)];
  const bool was_flagged = (flags & flag) != 0;
  if (was_flagged == occupied) return;
  const bool was_obstacle = (flags & cell_flag::kObstacle) != 0;
  flags = static_cast<std::uint8_t>(occupied ? flags | flag : flags & ~flag);
  const bool is_obstacle_now = (flags & cell_flag::kObstacle) != 0;
  if (was_obstacle != is_obstacle_now) stamp_inflation(c, is_obstacle_now ? 1 : -1);
  if (flag == cell_flag::kOwnObstacle) note_change(Layer::kObstacles, c);
}

// What they told counts where this robot has not seen for itself that it is free.
void ExplorationMap::believe_peers(Cell c) {
  const std::size_t i = frame_.index_of(c);
  const bool told = (layers_.flags[i] & cell_flag::kPeerTold) != 0;
  update_obstacle(c, cell_flag::kPeerObstacle, told && layers_.occupancy[i] != occupancy::kMin);
}

void ExplorationMap::stamp_inflation(Cell c, int step) {
  const CellRect& w = frame_.window();
  for (std::int32_t dy = -disc_radius_cells_; dy <= disc_radius_cells_; ++dy) {
    const std::int32_t half = disc_half_width_[static_cast<std::size_t>(dy + disc_radius_cells_)];
    const std::int32_t y = c.y + dy;
    if (half < 0 || y < w.y || y >= w.top()) continue;
    const std::int32_t x0 = std::max(c.x - half, w.x), x1 = std::min(c.x + half, w.right() - 1);
    for (std::int32_t x = x0; x <= x1; ++x) {
      std::uint8_t& count = layers_.inflation[frame_.index_of({x, y})];
      // Cells that entered the window after the stamp have not counted it: never below zero.
      if (step > 0 ? count < 255 : count > 0) count = static_cast<std::uint8_t>(count + step);
    }
  }
}

}  // namespace ivfm
