#include "firmware/planning/explorer.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <utility>

namespace ivfm {

namespace {

// What an action has to show for the local map to be worth another one. A lidar sees thousands of
// cells at a glance: less than a 64th of its footprint are crumbs, which the nearest frontiers
// collect with less driving.
std::uint32_t worthwhile_cells(const ExplorerConfig& config, std::int32_t cell_um) {
  const VisitFootprint& f = config.fusion.footprint;
  if (f.kind != VisitFootprint::Kind::kSector) return config.min_gain_cells;
  const std::int64_t reach = f.far_um / cell_um;
  return static_cast<std::uint32_t>(3 * reach * reach / 64);
}

}  // namespace

Explorer::Explorer(const ExplorerConfig& config, const Memory& memory, std::int32_t cell_um,
                   std::int32_t window_cells)
    : config_(config),
      map_(memory.layers, cell_um, window_cells, config.robot_radius_um),
      fusion_(config.fusion),
      paths_(config.paths, memory.bucket_entries) {}

void Explorer::start(const Pose& pose, Point window_center) {
  map_.clear(map_.frame().cell_at(window_center));
  paths_.forget();
  path_.clear();
  start_ = pose;
  action_ = {};
  last_ = {};
  idle_actions_ = 0;
  tries_at_frontier_ = 0;
  teammates_ = {};
  fusion_.begin_action(map_);
}

void Explorer::re_express(const Pose& moved, bool alone) {
  begin_action();
  start_ = compose(moved, start_);
  if (alone) {
    map_.re_express_alone(moved);
  } else {
    map_.re_express(moved);
  }
  paths_.forget();
  last_ = {};
}

void Explorer::set_teammates(std::span<const Point> positions) {
  std::array<Cell, Teammates::kMost> places;
  const std::size_t count = std::min(positions.size(), places.size());
  std::transform(positions.begin(), positions.begin() + static_cast<std::ptrdiff_t>(count),
                 places.begin(), [&](Point p) { return map_.frame().cell_at(p); });
  teammates_.set(std::span(places).first(count));
}

void Explorer::begin_action() {
  fusion_.begin_action(map_);
  action_ = {};
}

ViewStatistics Explorer::fuse(const Pose& pose, const Scan& scan, bool count_visits) {
  const ViewStatistics seen = fusion_.fuse(map_, pose, scan, count_visits);
  action_.add(seen);
  return seen;
}

std::int32_t Explorer::stand_off_cells() const {
  return config_.robot_radius_um / map_.frame().cell_um() + 2;
}

void Explorer::observe(const Pose& pose) {
  const Cell robot = robot_cell(pose);
  if (config_.rolling_window && map_.roll_to(robot)) paths_.forget();
  const GridFrame& frame = map_.frame();
  state_.grid = PolicyGrid::centred_on(robot, config_.pool);
  paths_.compute(map_, robot, state_.grid.window());
  clearance_ = Clearance::kPreferred;
  const MapLayers& layers = map_.layers();
  // The arguments are this object's own spans and a validated pool: the encoders cannot refuse.
  (void)encode_ivfm(
      {frame, layers.own_visits, layers.peer_visits, layers.flags, cell_flag::kObstacle},
      state_.grid, pose.position, config_.robot_radius_um, state_.ivfm());
  (void)encode_path({frame, layers.path_cost, path::kStraight, path::kUnreachable}, state_.grid,
                    state_.path());
  const std::int64_t policy_cell_um = std::int64_t{frame.cell_um()} * config_.pool;
  const std::int64_t nearest = std::int64_t{config_.min_goal_distance_um} * 256 / policy_cell_um;
  const LocalState::ConstChannel distance = std::as_const(state_).path();
  for (std::size_t i = 0; i < mask_.size(); ++i) {
    mask_[i] = distance[i] != kPathUnreachable && distance[i] >= nearest;
  }
}

bool Explorer::local_map_is_worth_visiting() const {
  // Nobody has seen the very place where the robot stands (the first action of a robot whose
  // first view does not count): all around it is new.
  constexpr int kMiddle = kPolicyCells / 2;
  const Cell robot{state_.grid.origin.x + kMiddle * state_.grid.pool,
                   state_.grid.origin.y + kMiddle * state_.grid.pool};
  if (!map_.is_seen(robot)) return true;
  if (config_.min_local_unseen > 0) {
    return count_reachable_unseen(map_, paths_, state_.grid.window()) >= config_.min_local_unseen;
  }
  return has_reachable_frontier(map_, paths_, state_.grid.window(), stand_off_cells(),
                                config_.min_local_frontier);
}

Decision Explorer::decide(const Pose& pose, QFunction& q) {
  review_last_goal(pose);
  observe(pose);
  const bool asks = idle_actions_ < config_.max_idle_actions && local_map_is_worth_visiting();
  const std::int32_t favourite =
      asks && ok(q.evaluate(state_, q_values_)) ? best_policy_cell() : -1;
  if (config_.view_reach_um == 0) {
    if (is_worth_an_action(favourite, q.unit())) return follow_policy(favourite);
    return select_global_goal(pose);
  }
  const CellRect known = explored_region(pose).intersection(map_.frame().window().grown(-1));
  if (!paths_.region().contains(known)) plan_everywhere(pose, Clearance::kPreferred);
  const auto frontier = best_view(config_.wide_frontier_size);
  if (favourite >= 0 && !(frontier && frontier->value.is_better_than(view_from(favourite)))) {
    return follow_policy(favourite);
  }
  if (frontier && worth_trying(frontier->goal)) return drive_to(frontier->goal);
  if (const auto other = choose_frontier(FrontierRule::kBestView)) return drive_to(*other);
  return select_frontier(pose, FrontierRule::kBestView);
}

// The reachable policy cell with the largest Q value, the first of several; -1 without any.
std::int32_t Explorer::best_policy_cell() const {
  std::int32_t best = -1, best_q = std::numeric_limits<std::int32_t>::min();
  for (std::size_t i = 0; i < q_values_.size(); ++i) {
    if (!mask_[i] || (best >= 0 && q_values_[i] <= best_q)) continue;
    best = static_cast<std::int32_t>(i);
    best_q = q_values_[i];
  }
  return best;
}

bool Explorer::is_worth_an_action(std::int32_t favourite, std::int32_t unit) const {
  if (favourite < 0) return false;
  const std::int64_t value = q_values_[static_cast<std::size_t>(favourite)];
  return value * 256 >= std::int64_t{unit} * config_.min_local_value_q8;
}

// `favourite`: a cell of the goal mask.
Decision Explorer::follow_policy(std::int32_t favourite) {
  Decision decision;
  (void)select_local_goal(favourite, decision);  // the mask holds only what can be reached
  decision.q_value = q_values_[static_cast<std::size_t>(favourite)];
  last_ = decision;
  return decision;
}

// What the view from the policy's favourite is worth.
ViewValue Explorer::view_from(std::int32_t favourite) const {
  const Cell goal = goal_in_block(favourite);
  return value_of_view(map_, goal, paths_.cost_at(map_, goal), view_reach_cells(), 0);
}

Status Explorer::select_local_goal(std::int32_t policy_cell, Decision& out) {
  if (policy_cell < 0 || policy_cell >= kPolicyGridSize) return Status::kInvalidArgument;
  if (state_.path()[static_cast<std::size_t>(policy_cell)] == kPathUnreachable) {
    return Status::kUnavailable;
  }
  Decision decision;
  decision.kind = Decision::Kind::kLocalGoal;
  decision.policy_cell = policy_cell;
  decision.goal = goal_in_block(policy_cell);
  out = planned(decision);
  return Status::kOk;
}

// The reachable cell of the block that lies nearest to the block's middle.
Cell Explorer::goal_in_block(std::int32_t policy_cell) const {
  const CellRect block = state_.grid.block(policy_cell);
  Cell best{block.x, block.y};
  std::int32_t best_distance = std::numeric_limits<std::int32_t>::max();
  for (std::int32_t y = block.y; y < block.top(); ++y) {
    for (std::int32_t x = block.x; x < block.right(); ++x) {
      if (paths_.cost_at(map_, {x, y}) == path::kUnreachable) continue;
      const std::int32_t dx = 2 * (x - block.x) + 1 - block.width;
      const std::int32_t dy = 2 * (y - block.y) + 1 - block.height;
      if (dx * dx + dy * dy >= best_distance) continue;
      best_distance = dx * dx + dy * dy;
      best = {x, y};
    }
  }
  return best;
}

// Everything known, with room to walk around what is known.
CellRect Explorer::explored_region(const Pose& pose) const {
  return map_.known_rect().united(robot_cell(pose)).grown(16);
}

Decision Explorer::select_global_goal(const Pose& pose) {
  return select_frontier(pose, FrontierRule::kNearest);
}

Decision Explorer::select_frontier(const Pose& pose, FrontierRule rule) {
  // Only when nothing is left with room to spare the robot squeezes through narrow places: first
  // through those that it surely fits through, last through any that could have let it in.
  for (const Clearance clearance : clearances()) {
    plan_everywhere(pose, clearance);
    if (const auto frontier = choose_frontier(rule)) return drive_to(*frontier);
  }
  return config_.return_to_start ? select_return(pose) : stay();
}

// Those that differ, the most room first.
std::span<const Clearance> Explorer::clearances() const {
  static constexpr Clearance kAll[] = {Clearance::kPreferred, Clearance::kTight,
                                       Clearance::kEscape};
  return std::span(kAll).first(config_.paths.tight_radius_um == 0 ? 1 : std::size(kAll));
}

void Explorer::plan_everywhere(const Pose& pose, Clearance clearance) {
  paths_.compute(map_, robot_cell(pose), explored_region(pose), clearance);
  clearance_ = clearance;
}

std::optional<FrontierGoal> Explorer::choose_frontier(FrontierRule rule) {
  // Frontiers that were tried in vain several times are given up, so this loop ends.
  while (const auto frontier = next_frontier(rule)) {
    if (worth_trying(*frontier)) return frontier;
  }
  return std::nullopt;
}

// Notes one more try at a frontier; gives it up, and answers false, when several were in vain.
bool Explorer::worth_trying(const FrontierGoal& frontier) {
  // A try that brought the robot nearer was not in vain, whatever cut it short, nor does it make up
  // for those that were: a robot may go to and fro for ever before what only looks open from afar.
  const Cell at = frontier.frontier;
  const bool again = std::max(std::abs(at.x - last_frontier_.x),
                              std::abs(at.y - last_frontier_.y)) <= stand_off_cells();
  const bool nearer = frontier.path_cost + path::kStraight <= last_frontier_cost_;
  const bool saw_new = action_.newly_seen_cells >= config_.min_gain_cells;
  if (!again || saw_new) {
    tries_at_frontier_ = 0;
  } else if (!nearer) {
    ++tries_at_frontier_;
  }
  last_frontier_ = frontier.frontier;
  last_frontier_cost_ = frontier.path_cost;
  if (tries_at_frontier_ <= 3) return true;
  give_up_frontier();
  return false;
}

Decision Explorer::drive_to(const FrontierGoal& frontier) {
  Decision decision;
  decision.kind = Decision::Kind::kGlobalGoal;
  decision.goal = frontier.stand;
  return planned(decision);
}

std::optional<FrontierGoal> Explorer::next_frontier(FrontierRule rule) const {
  if (config_.region_cells > 0) {
    // Less than a sixteenth of a region is crumbs: those are collected last, nearest first.
    const std::int32_t least = config_.region_cells * config_.region_cells / 16;
    const auto rich = richest_region(map_, paths_, teammates_, rich_area(), config_.region_cells,
                                     config_.region_way_cells, least);
    if (rich) return rich;
  }
  // Slits along walls are collected last: they cost as much driving as doorways do.
  const auto wide = find_frontier(rule, config_.wide_frontier_size);
  // None is worth squeezing out for.
  const bool looked_at_all =
      config_.wide_frontier_size <= config_.min_frontier_size || clearance_ == Clearance::kEscape;
  return wide || looked_at_all ? wide : find_frontier(rule, config_.min_frontier_size);
}

// Where regions are looked for. Where robots drive into the unknown, what lies beyond everything
// that was ever seen is most likely the far side of a wall: little of it counts.
CellRect Explorer::rich_area() const {
  if (!config_.paths.unknown_is_traversable) return paths_.region();
  return map_.known_rect().grown(config_.region_cells / 8);
}

std::optional<FrontierGoal> Explorer::find_frontier(FrontierRule rule, int min_size) const {
  if (rule == FrontierRule::kNearest) {
    return nearest_frontier(map_, paths_, paths_.region(), stand_off_cells(), min_size);
  }
  const auto best = best_view(min_size);
  return best ? std::optional(best->goal) : std::nullopt;
}

std::optional<FrontierView> Explorer::best_view(int min_size) const {
  const CellRect where = paths_.region().intersection(map_.known_rect().grown(1));
  return best_frontier_view(map_, paths_, teammates_, where, view_reach_cells(), stand_off_cells(),
                            min_size);
}

// Whether there is still something to see at what was chosen to be looked at.
bool Explorer::is_open(Cell c) const {
  if (config_.region_cells == 0) return is_frontier(map_, c);
  return !map_.is_seen(c) && !map_.is_obstacle(c) && !map_.is_given_up(c);
}

Decision Explorer::select_return(const Pose& pose) {
  const Cell home = map_.frame().cell_at(start_.position);
  for (const Clearance clearance : clearances()) {
    plan_everywhere(pose, clearance);
    if (paths_.cost_at(map_, home) != path::kUnreachable) break;
  }
  return return_or_stay(pose);
}

Decision Explorer::return_or_stay(const Pose& pose) {
  Decision decision;
  decision.kind = Decision::Kind::kReturn;
  decision.goal = map_.frame().cell_at(start_.position);
  const bool away = !(decision.goal == robot_cell(pose));
  const bool in_reach = paths_.cost_at(map_, decision.goal) != path::kUnreachable;
  return away && in_reach ? planned(decision) : stay();
}

Decision Explorer::stay() {
  path_.clear();
  last_ = {};
  return last_;
}

Status Explorer::select_cell(const Pose& pose, Cell goal, Decision& out) {
  plan_everywhere(pose, Clearance::kPreferred);
  if (paths_.cost_at(map_, goal) == path::kUnreachable) return Status::kUnavailable;
  Decision decision;
  decision.kind = Decision::Kind::kGlobalGoal;
  decision.goal = goal;
  out = planned(decision);
  return Status::kOk;
}

Decision Explorer::planned(Decision decision) {
  (void)plan_path(map_, paths_, decision.goal, path_);  // callers checked that it can be reached
  last_ = decision;
  return decision;
}

// Judges the action that has just ended: idle local actions and frontiers that showed nothing.
void Explorer::review_last_goal(const Pose& pose) {
  const std::uint32_t seen = action_.newly_seen_cells;
  const std::uint32_t worthwhile = worthwhile_cells(config_, map_.frame().cell_um());
  const bool crumbs = seen < worthwhile && worthwhile > config_.min_gain_cells;
  if (last_.kind == Decision::Kind::kLocalGoal) {
    idle_actions_ = seen < config_.min_gain_cells ? idle_actions_ + 1 : 0;
    if (crumbs) idle_actions_ = config_.max_idle_actions;
    return;
  }
  if (!crumbs) idle_actions_ = 0;  // there is something to see again: back to the policy
  if (last_.kind != Decision::Kind::kGlobalGoal || seen >= config_.min_gain_cells) return;
  const Cell robot = robot_cell(pose);
  const std::int32_t distance =
      std::max(std::abs(robot.x - last_.goal.x), std::abs(robot.y - last_.goal.y));
  if (distance <= stand_off_cells()) give_up_frontier();
}

Status Explorer::replan(const Pose& pose) {
  if (last_.kind == Decision::Kind::kExplored) return Status::kEmpty;
  const bool local = last_.kind == Decision::Kind::kLocalGoal;
  const CellRect region = local ? state_.grid.window() : explored_region(pose);
  paths_.compute(map_, robot_cell(pose), region, clearance_);
  return plan_path(map_, paths_, last_.goal, path_);
}

bool Explorer::goal_is_still_good(const Pose& pose, std::size_t next_waypoint) const {
  if (goal_has_been_seen()) return false;
  if (clearance_ != Clearance::kPreferred)
    return true;  // nearer to obstacles than the inflation allows
  const std::span<const Point> waypoints = path_.points();
  Cell from = robot_cell(pose);
  const std::int32_t leave = stand_off_cells();  // the robot may stand near an obstacle already
  for (std::size_t i = next_waypoint; i < waypoints.size(); ++i) {
    const Cell to = map_.frame().cell_at(waypoints[i]);
    if (line_is_blocked(map_, from, to, i == next_waypoint ? leave : 0)) return false;
    from = to;
  }
  return true;
}

void Explorer::abandon_goal() {
  if (last_.kind == Decision::Kind::kGlobalGoal) give_up_frontier();
  if (last_.kind == Decision::Kind::kLocalGoal) idle_actions_ = config_.max_idle_actions;
}

void Explorer::give_up_frontier() {
  const CellRect around =
      CellRect{last_frontier_.x, last_frontier_.y, 1, 1}.grown(stand_off_cells());
  for (std::int32_t y = around.y; y < around.top(); ++y) {
    for (std::int32_t x = around.x; x < around.right(); ++x) {
      if (is_open({x, y})) map_.set_flag({x, y}, cell_flag::kGivenUp);
    }
  }
}

void Explorer::copy_from(const Explorer& other) {
  config_ = other.config_;
  map_.copy_from(other.map_);
  fusion_ = other.fusion_;
  paths_.set_region(other.paths_.region());
  state_ = other.state_;
  mask_ = other.mask_;
  path_ = other.path_;
  start_ = other.start_;
  action_ = other.action_;
  last_ = other.last_;
  last_frontier_ = other.last_frontier_;
  idle_actions_ = other.idle_actions_;
  last_frontier_cost_ = other.last_frontier_cost_;
  tries_at_frontier_ = other.tries_at_frontier_;
  clearance_ = other.clearance_;
  teammates_ = other.teammates_;
  q_values_ = other.q_values_;
}

}  // namespace ivfm
