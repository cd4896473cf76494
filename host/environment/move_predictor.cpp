#include "host/environment/move_predictor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <unordered_map>

#include "firmware/mapping/visit_value.h"

namespace ivfm::host {

namespace {

constexpr std::int32_t kTurnStep = 546;  // 3 degrees a simulation step
constexpr std::size_t kCameraHeadings = 128;

bool contains(const VisitFootprint& f, double ahead, double left) {
  if (f.kind == VisitFootprint::Kind::kTrapezoid) {
    if (ahead < f.near_um || ahead > f.far_um) return false;
    return std::abs(left) <= f.slope_q16 / 65536.0 * ahead + f.offset_um;
  }
  if (ahead * ahead + left * left > static_cast<double>(f.far_um) * f.far_um) return false;
  const BinaryAngle bearing =
      atan2_binary(static_cast<std::int64_t>(left), static_cast<std::int64_t>(ahead));
  return std::abs(int{bearing.signed_raw()}) <= f.half_angle;
}

bool is_full_circle(const VisitFootprint& f) {
  return f.kind == VisitFootprint::Kind::kSector && f.half_angle >= 0x8000;
}

// The cell before (dx, dy) on the straight way to the origin.
Cell towards_origin(std::int32_t dx, std::int32_t dy) {
  const std::int32_t longest = std::max(std::abs(dx), std::abs(dy));
  const auto shrunk = [longest](std::int32_t v) {
    const double scaled = static_cast<double>(v) * (longest - 1) / longest;
    return static_cast<std::int32_t>(std::floor(scaled + 0.5));
  };
  return {shrunk(dx), shrunk(dy)};
}

// The footprint's cells and those on the way to them, parents before children.
std::vector<ViewTemplate::Node> make_tree(const VisitFootprint& f, std::int32_t cell_um,
                                          BinaryAngle heading) {
  const double c = cos_q30(heading) * 0x1p-30, s = sin_q30(heading) * 0x1p-30;
  const std::int32_t reach = f.far_um * 2 / cell_um + 1;
  std::vector<Cell> shown;
  for (std::int32_t dy = -reach; dy <= reach; ++dy) {
    for (std::int32_t dx = -reach; dx <= reach; ++dx) {
      const double x = static_cast<double>(dx) * cell_um, y = static_cast<double>(dy) * cell_um;
      if (contains(f, x * c + y * s, y * c - x * s)) shown.push_back({dx, dy});
    }
  }
  std::unordered_map<std::int64_t, bool> cells;  // key -> in footprint
  const auto key = [](Cell cell) { return (std::int64_t{cell.x} << 32) ^ (cell.y & 0xffffffff); };
  cells[key({0, 0})] = false;
  for (const Cell& cell : shown) cells[key(cell)] = true;
  std::vector<Cell> all = shown;
  for (std::size_t i = 0; i < all.size(); ++i) {  // ways to the origin
    if (all[i] == Cell{0, 0}) continue;
    const Cell parent = towards_origin(all[i].x, all[i].y);
    if (cells.emplace(key(parent), false).second) all.push_back(parent);
  }
  if (std::ranges::find(all, Cell{0, 0}) == all.end()) all.push_back({0, 0});
  std::ranges::sort(all, [](const Cell& a, const Cell& b) {
    const auto rank = [](const Cell& v) { return std::max(std::abs(v.x), std::abs(v.y)); };
    return std::array{rank(a), a.y, a.x} < std::array{rank(b), b.y, b.x};
  });
  std::unordered_map<std::int64_t, std::int32_t> index;
  std::vector<ViewTemplate::Node> nodes;
  for (const Cell& cell : all) {
    ViewTemplate::Node node{static_cast<std::int16_t>(cell.x), static_cast<std::int16_t>(cell.y), 0,
                            cells[key(cell)]};
    if (!(cell == Cell{0, 0})) node.parent = index.at(key(towards_origin(cell.x, cell.y)));
    index[key(cell)] = static_cast<std::int32_t>(nodes.size());
    nodes.push_back(node);
  }
  return nodes;
}

}  // namespace

ViewTemplate::ViewTemplate(const VisitFootprint& footprint, std::int32_t cell_um) {
  const std::size_t headings = is_full_circle(footprint) ? 1 : kCameraHeadings;
  for (std::size_t i = 0; i < headings; ++i) {
    const BinaryAngle heading(static_cast<std::uint16_t>(i * 65536 / headings));
    trees_.push_back(make_tree(footprint, cell_um, heading));
  }
}

const std::vector<ViewTemplate::Node>& ViewTemplate::nodes(BinaryAngle heading) const {
  const std::size_t turns = trees_.size();
  return trees_[((heading.raw() * turns + 32768) >> 16) % turns];
}

MovePredictor::MovePredictor(const EnvironmentConfig& config)
    : config_(config), template_(config.explorer.fusion.footprint, config.cell_um) {
  for (std::size_t i = 0; i < template_.headings(); ++i) {
    const auto& nodes =
        template_.nodes(BinaryAngle(static_cast<std::uint16_t>(i * 65536 / template_.headings())));
    const auto shown =
        std::ranges::count_if(nodes, [](const ViewTemplate::Node& n) { return n.in_footprint; });
    most_cells_ = std::max(most_cells_, static_cast<std::int32_t>(shown));
  }
}

void MovePredictor::begin(const Explorer& explorer) {
  const std::size_t cells = explorer.map().frame().size();
  if (marked_.size() != cells || ++prediction_ == 0) {
    marked_.assign(cells, 0);
    prediction_ = 1;
  }
}

// Walks the tree from the robot outwards; what stands behind an obstacle is not seen.
void MovePredictor::view(const Explorer& explorer, Cell cell, BinaryAngle heading,
                         PredictedMove& move) {
  const std::vector<ViewTemplate::Node>& nodes = template_.nodes(heading);
  const GridFrame& frame = explorer.map().frame();
  const MapLayers& layers = explorer.map().layers();
  visible_.resize(nodes.size());
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    const ViewTemplate::Node& node = nodes[n];
    const bool is_lit = n == 0 || visible_[static_cast<std::size_t>(node.parent)] != 0;
    visible_[n] = 0;
    const Cell at{cell.x + node.dx, cell.y + node.dy};
    if (!is_lit || !frame.contains(at)) continue;
    const std::size_t i = frame.index_of(at);
    if (layers.flags[i] & cell_flag::kObstacle) continue;
    visible_[n] = 1;
    if (!node.in_footprint || marked_[i] == prediction_) continue;
    marked_[i] = prediction_;
    const unsigned visits = layers.own_visits[i] + layers.peer_visits[i];
    if (visits == 0) {
      ++move.new_cells;
    } else {
      ++move.re_seen_cells;
      move.re_seen_penalty += visit_penalty_q12(visits) / 4096.0;
    }
  }
}

PredictedMove MovePredictor::predict_path(const Explorer& explorer, const Pose& pose,
                                          std::span<const Point> waypoints,
                                          std::int32_t spacing_um) {
  begin(explorer);
  const GridFrame& frame = explorer.map().frame();
  const double spacing = spacing_um > 0 ? spacing_um : config_.view_every_steps * 1000.0;
  double length = 0;
  Point from = pose.position;
  for (const Point& p : waypoints) {
    length += std::sqrt(static_cast<double>(squared_distance_um2(from, p)));
    from = p;
  }
  PredictedMove move;
  move.is_reachable = true;
  double budget = length - config_.front_um, until_view = spacing;
  BinaryAngle heading = pose.heading;
  from = pose.position;
  for (const Point& to : waypoints) {
    const double leg = std::sqrt(static_cast<double>(squared_distance_um2(from, to)));
    if (leg == 0) continue;
    const BinaryAngle wanted =
        atan2_binary(std::int64_t{to.y_um} - from.y_um, std::int64_t{to.x_um} - from.x_um);
    const std::int32_t turn = std::abs(int{(wanted - heading).signed_raw()});
    heading = wanted;
    move.turn_rad += turn * (6.283185307179586 / 65536);
    until_view -= (turn + kTurnStep - 1) / kTurnStep * 1000.0;
    const double drive = std::min(leg, budget);
    if (drive <= 0) break;
    double at = 0;
    const auto cell_after = [&](double distance) {
      const double share = distance / leg;
      return frame.cell_at({from.x_um + static_cast<std::int32_t>((to.x_um - from.x_um) * share),
                            from.y_um + static_cast<std::int32_t>((to.y_um - from.y_um) * share)});
    };
    if (until_view <= 0) {  // due during the turn
      view(explorer, cell_after(0), heading, move);
      until_view += spacing;
    }
    while (at + until_view <= drive) {
      at += until_view;
      until_view = spacing;
      view(explorer, cell_after(at), heading, move);
    }
    until_view -= drive - at;
    move.travel_m += drive * 1e-6;
    for (double driven = 0; driven < drive; driven += config_.cell_um) {
      const Cell cell = cell_after(driven);
      if (!explorer.map().is_seen(cell)) move.unseen_m += config_.cell_um * 1e-6;
    }
    budget -= leg;
    if (budget <= 0 || &to == &waypoints.back()) {
      if (config_.count_last_view) view(explorer, cell_after(drive), heading, move);
      break;
    }
    from = to;
  }
  return move;
}

void MovePredictor::predict(const Explorer& explorer, const Pose& pose,
                            std::span<PredictedMove> out, int stride) {
  WaypointPath path;
  const std::int32_t spacing =
      config_.sensor == SensorModel::kLidar ? config_.sensor_range_um / 3 : 0;
  for (int i = 0; i < kPolicyGridSize; ++i) {
    const auto index = static_cast<std::size_t>(i);
    out[index] = {};
    const bool is_chosen = i % kPolicyCells % stride == 0 && i / kPolicyCells % stride == 0;
    if (!is_chosen || !explorer.goal_mask()[index]) continue;
    const Cell goal = explorer.goal_in_block(i);
    if (!ok(plan_path(explorer.map(), explorer.paths(), goal, path))) continue;
    out[index] = predict_path(explorer, pose, path.points(), spacing);
  }
}

std::int32_t MovePredictor::new_cells_from(const Explorer& explorer, Cell cell,
                                           BinaryAngle heading) {
  begin(explorer);
  PredictedMove move;
  view(explorer, cell, heading, move);
  return move.new_cells;
}

}  // namespace ivfm::host
