#include "host/environment/exploration_environment.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "host/environment/arena_worlds.h"
#include "host/environment/reachable_area.h"

namespace ivfm::host {

namespace {

// New ways an action may take around what it sees, before it gives up.
constexpr int kMaxDetours = 8;
constexpr std::int32_t kToldWithinUm = 14'000'000;  // as the map server tells of others
constexpr std::int32_t kStepUm = 1'000;             // forward, a simulation step
constexpr std::int32_t kTurnStep = 546;             // 3 degrees in binary angle units
constexpr std::int32_t kContactGapUm = 2'000;       // robots come to rest this short of an obstacle
constexpr std::int32_t kSafetyGapUm = 20'000;       // and this short where the lidar stops them
constexpr double kIdleUm = 5'000;                   // method.md, "Reward"
constexpr double kIdleRad = 0.017453292519943295;
constexpr std::int32_t kExtentMarginCells = 3;  // walls are seen just outside the world
constexpr std::int32_t kMostWindowCells = 1536;

// How far the trapezoid's edge is along `bearing`; 0 when the bearing misses it.
std::int32_t trapezoid_reach_um(const VisitFootprint& f, BinaryAngle bearing) {
  const double c = cos_q30(bearing) * 0x1p-30, s = std::abs(sin_q30(bearing) * 0x1p-30);
  if (c <= 0) return 0;
  const double slope = f.slope_q16 / 65536.0;
  double reach = f.far_um / c;
  if (s > slope * c) reach = std::min(reach, f.offset_um / (s - slope * c));
  return reach * c < f.near_um ? 0 : static_cast<std::int32_t>(reach);
}

bool trapezoid_contains(const VisitFootprint& f, std::int64_t ahead_um, std::int64_t left_um) {
  if (ahead_um < f.near_um || ahead_um > f.far_um) return false;
  return std::abs(left_um) <= ((f.slope_q16 * ahead_um) >> 16) + f.offset_um;
}

// The camera as a fan of beams, half a degree wider than its footprint is seen.
std::vector<ScanPoint> camera_fan(const EnvironmentConfig& config) {
  constexpr std::int32_t kHalfFan = 12'000, kStep = 128;
  std::vector<ScanPoint> beams;
  for (std::int32_t raw = -kHalfFan; raw <= kHalfFan; raw += kStep) {
    const BinaryAngle bearing(static_cast<std::uint16_t>(raw & 0xffff));
    const std::int32_t reach = trapezoid_reach_um(config.explorer.fusion.footprint, bearing);
    // Rounded up, so that a beam never ends before the footprint does.
    if (reach > 0) beams.push_back({bearing, static_cast<std::uint16_t>(reach / 1000 + 2)});
  }
  return beams;
}

std::vector<ScanPoint> lidar_fan(const EnvironmentConfig& config) {
  // Beams at most 0.8 cell apart at full range, as far as VisibilityProfile resolves them.
  const double arc_cells = 6.283185307 * config.sensor_range_um / config.cell_um;
  std::int32_t beams = 256;
  while (beams < 1024 && arc_cells > 0.8 * beams) beams *= 2;
  std::vector<ScanPoint> fan;
  for (std::int32_t i = 0; i < beams; ++i) {
    const BinaryAngle bearing(static_cast<std::uint16_t>(i * (65536 / beams)));
    if (std::abs(int{bearing.signed_raw()}) > config.sensor_half_angle) continue;
    fan.push_back({bearing, static_cast<std::uint16_t>(config.sensor_range_um / 1000)});
  }
  return fan;
}

Point between(Point from, Point to, double share) {
  const auto along = [share](std::int32_t a, std::int32_t b) {
    return static_cast<std::int32_t>(std::floor(a + (static_cast<double>(b) - a) * share + 0.5));
  };
  return {along(from.x_um, to.x_um), along(from.y_um, to.y_um)};
}

double distance_um(Point a, Point b) {
  return std::sqrt(static_cast<double>(squared_distance_um2(a, b)));
}

// Whether no known obstacle lies within half the released robot's width of the line of cells.
bool is_clear_line(const ExplorationMap& map, Cell from, Cell to) {
  constexpr std::int32_t kHalfWidthUm = 30'000;
  const int steps = std::max({std::abs(to.x - from.x), std::abs(to.y - from.y), 1});
  for (int i = 0; i <= steps; ++i) {
    const Cell c{from.x + (to.x - from.x) * i / steps, from.y + (to.y - from.y) * i / steps};
    if (map.obstacle_within(c, kHalfWidthUm)) return false;
  }
  return true;
}

// The reachable cell nearest to `target`; `here` when there is none. After compute_paths().
Cell nearest_reachable(const Explorer& explorer, Cell here, Point target) {
  const GridFrame& frame = explorer.map().frame();
  const CellRect region = explorer.paths().region();
  Cell best = here;
  std::int64_t best_distance = squared_distance_um2(frame.center_of(here), target);
  for (std::int32_t y = region.y; y < region.top(); ++y) {
    for (std::int32_t x = region.x; x < region.right(); ++x) {
      const std::int64_t distance = squared_distance_um2(frame.center_of({x, y}), target);
      if (distance >= best_distance) continue;
      if (explorer.paths().cost_at(explorer.map(), {x, y}) == path::kUnreachable) continue;
      best = {x, y};
      best_distance = distance;
    }
  }
  return best;
}

}  // namespace

EnvironmentConfig EnvironmentConfig::arena() {
  EnvironmentConfig c;
  c.explorer = ExplorerConfig::paper();
  c.cell_um = PaperProfile::kCellUm;
  c.window_cells = PaperProfile::kWindowCells;
  c.body_radius_um = arena::kRobotRadiusUm;
  c.explorer.robot_radius_um = arena::kRobotRadiusUm + c.cell_um;  // planned with a cell to spare
  c.explorer.paths.tight_radius_um = c.body_radius_um;  // a robot that is shut in does without
  c.sensor = SensorModel::kPaperCamera;
  c.max_sim_steps = 800;
  c.view_every_steps = 60;
  c.front_um = arena::kRobotRadiusUm;
  c.count_first_view = false;
  c.count_last_view = false;
  return c;
}

EnvironmentConfig EnvironmentConfig::building(std::int32_t sensor_range_um) {
  EnvironmentConfig c;
  c.cell_um = RobotProfile::kCellUm;
  c.explorer = ExplorerConfig::lidar(sensor_range_um, c.cell_um);
  c.explorer.fusion.mapping_range_um = sensor_range_um;
  c.explorer.min_frontier_size = 1;  // this lidar has no noise
  c.body_radius_um = c.explorer.robot_radius_um;
  // A robot may be 0.7 cell from the middle of its cell, and so may an obstacle's surface.
  c.explorer.robot_radius_um += c.cell_um * 7 / 5;
  c.explorer.paths.tight_radius_um = c.body_radius_um + c.cell_um;  // as on board
  c.sensor = SensorModel::kLidar;
  c.sensor_range_um = sensor_range_um;
  c.view_every_steps = 250;
  c.reroute_when_blocked = true;
  c.max_travel_um = sensor_range_um / 2;
  c.ends_when_goal_is_seen = true;
  c.stops_before_contact = true;
  c.explorable_by_disc = true;
  return c;
}

std::int32_t EpisodeTotals::total_actions() const {
  return std::accumulate(actions.begin(), actions.end(), 0);
}

double EpisodeTotals::total_distance_m() const {
  return std::accumulate(distance_m.begin(), distance_m.end(), 0.0);
}

struct HeapExplorer::Storage {
  Storage(const ExplorerConfig& config, std::int32_t cell_um_in, std::int32_t window_cells_in)
      : cell_um(cell_um_in),
        window_cells(window_cells_in),
        cells(static_cast<std::size_t>(window_cells_in) *
              static_cast<std::size_t>(window_cells_in)),
        occupancy(cells),
        own_visits(cells),
        peer_visits(cells),
        flags(cells),
        inflation(cells),
        path_cost(cells),
        buckets(32 * static_cast<std::size_t>(std::max(1024, window_cells_in * 5))),
        explorer(config,
                 {{occupancy, own_visits, peer_visits, flags, inflation, path_cost}, buckets},
                 cell_um_in, window_cells_in) {}

  std::int32_t cell_um, window_cells;
  std::size_t cells;
  std::vector<std::int8_t> occupancy;
  std::vector<std::uint8_t> own_visits, peer_visits, flags, inflation;
  std::vector<std::uint16_t> path_cost;
  std::vector<std::uint32_t> buckets;
  Explorer explorer;
};

HeapExplorer::HeapExplorer(const ExplorerConfig& config, std::int32_t cell_um,
                           std::int32_t window_cells)
    : storage_(std::make_unique<Storage>(config, cell_um, window_cells)) {}

HeapExplorer::HeapExplorer(const HeapExplorer& other)
    : HeapExplorer(other.get().config(), other.storage_->cell_um, other.storage_->window_cells) {
  get().copy_from(other.get());
}

HeapExplorer& HeapExplorer::operator=(const HeapExplorer& other) {
  if (this == &other) return *this;
  if (!storage_ || storage_->window_cells != other.storage_->window_cells ||
      storage_->cell_um != other.storage_->cell_um) {
    storage_ = std::make_unique<Storage>(other.get().config(), other.storage_->cell_um,
                                         other.storage_->window_cells);
  }
  get().copy_from(other.get());
  return *this;
}

HeapExplorer::HeapExplorer(HeapExplorer&&) noexcept = default;
HeapExplorer& HeapExplorer::operator=(HeapExplorer&&) noexcept = default;
HeapExplorer::~HeapExplorer() = default;

std::int32_t HeapExplorer::window_cells() const { return storage_->window_cells; }
Explorer& HeapExplorer::get() { return storage_->explorer; }
const Explorer& HeapExplorer::get() const { return storage_->explorer; }

// An action being driven.
struct ExplorationEnvironment::Motion {
  Agent& agent;
  StepResult& result;
  std::vector<Point> waypoints;
  std::size_t next = 0;  // the waypoint being driven to
  double budget_um = 0;  // left to drive: the front, not the middle, goes to the goal
  std::int32_t steps_to_view = 0;
  bool rerouted = false;  // the path must be planned again
  bool ended = false;

  bool goes_on() const { return !ended && !rerouted; }
};

ExplorationEnvironment::ExplorationEnvironment(const EnvironmentConfig& config) : config_(config) {
  beams_ = config.sensor == SensorModel::kPaperCamera ? camera_fan(config) : lidar_fan(config);
}

void ExplorationEnvironment::reset(const Scenario& scenario) {
  if (scenario.starts.empty()) throw std::invalid_argument("a scenario needs at least one robot");
  scenario_ = scenario;
  extent_ = extent_of(*scenario.world, config_.cell_um).grown(kExtentMarginCells);
  extent_frame_ = GridFrame(config_.cell_um, extent_);
  seen_by_.assign(extent_frame_.size(), 0);
  unseen_places_.clear();
  totals_ = {};
  find_explorable_cells();
  known_walls_.clear();
  if (config_.walls_known) {
    known_walls_.assign(extent_frame_.size(), 1);
    const CellRect inside = extent_of(*scenario.world, config_.cell_um);
    for (std::int32_t y = inside.y; y < inside.top(); ++y) {
      const auto row =
          known_walls_.begin() + static_cast<std::ptrdiff_t>(extent_frame_.index_of({inside.x, y}));
      std::fill(row, row + inside.width, std::uint8_t{0});
    }
  }
  const std::int32_t needed = std::max(extent_.width, extent_.height) + 2;
  while (agents_.size() > scenario.starts.size()) agents_.pop_back();
  for (std::size_t i = 0; i < scenario.starts.size(); ++i) {
    add_agent(i, scenario.starts[i],
              config_.window_cells > 0 ? config_.window_cells : std::min(needed, kMostWindowCells));
  }
  totals_.actions.assign(agents_.size(), 0);
  totals_.distance_m.assign(agents_.size(), 0);
  next_agent_ = 0;
  done_ = false;
  for (int i = 0; i < agents(); ++i) {
    if (!known_walls_.empty() || agents() > 1) tell_obstacles(i, extent_);
    StepResult ignored;
    take_view(agents_[static_cast<std::size_t>(i)], config_.count_first_view, ignored);
    share(i);
  }
  totals_.visit_mbr_cells = totals_.obstacle_mbr_cells = 0;  // counted by action
  unseen_places_ = scenario.places;                          // only actions find targets
}

void ExplorationEnvironment::add_agent(std::size_t index, const Pose& start,
                                       std::int32_t window_cells) {
  const bool fits = extent_.width < window_cells && extent_.height < window_cells;
  ExplorerConfig explorer = config_.explorer;
  explorer.rolling_window = !fits;
  if (index == agents_.size()) {
    agents_.push_back({HeapExplorer(explorer, config_.cell_um, window_cells), {}, {}, {}, {}});
  }
  Agent& agent = agents_[index];
  const bool is_same = agent.explorer.window_cells() == window_cells &&
                       agent.explorer.get().config().rolling_window == !fits;
  if (!is_same) agent.explorer = HeapExplorer(explorer, config_.cell_um, window_cells);
  agent.pose = start;
  agent.visits.assign(extent_frame_.size(), 0);
  agent.obstacles.assign(extent_frame_.size(), 0);
  agent.body = body_rect(start);
  agent.has_nothing_to_do = false;
  const Cell middle{extent_.x + extent_.width / 2, extent_.y + extent_.height / 2};
  const Point center = fits ? extent_frame_.center_of(middle) : start.position;
  announce(agent, ExplorerCall::kStart, center);
  agent.explorer.get().start(start, center);
}

void ExplorationEnvironment::announce(const Agent& agent, ExplorerCall call, Point center,
                                      const Scan* scan, bool count_visits) const {
  if (!observer_) return;
  observer_(static_cast<int>(&agent - agents_.data()), call, agent.pose, center, scan,
            count_visits);
}

void ExplorationEnvironment::find_explorable_cells() {
  const std::int32_t reach =
      config_.explorable_by_disc ? config_.explorer.robot_radius_um + config_.cell_um : 0;
  const Cell start = extent_frame_.cell_at(scenario_.starts.front().position);
  explorable_ = reachable_centers(*scenario_.rays, extent_frame_, start, reach);
  if (reach > 0) explorable_ = dilated(explorable_, extent_frame_, reach);
  totals_.explorable_cells = std::count(explorable_.begin(), explorable_.end(), std::uint8_t{1});
}

// --- Actions -------------------------------------------------------------------------------------

StepResult ExplorationEnvironment::step(int agent, int policy_cell) {
  Decision decision;
  const Status status = explorer(agent).select_local_goal(policy_cell, decision);
  return ok(status) ? act(agent) : stay(agent);
}

StepResult ExplorationEnvironment::step_global(int agent) {
  return step_decision(agent, explorer(agent).select_global_goal(pose(agent)));
}

StepResult ExplorationEnvironment::step_to(int agent, Cell goal) {
  Decision decision;
  const Status status = explorer(agent).select_cell(pose(agent), goal, decision);
  return ok(status) ? act(agent) : stay(agent);
}

Decision ExplorationEnvironment::decide(int agent, QFunction& q) {
  explorer(agent).set_teammates(others_near(agent));
  return explorer(agent).decide(pose(agent), q);
}

std::vector<Point> ExplorationEnvironment::others_near(int agent) const {
  const Point here = pose(agent).position;
  std::vector<Point> near;
  for (int other = 0; other < agents(); ++other) {
    const Point there = pose(other).position;
    const std::int32_t away =
        std::max(std::abs(there.x_um - here.x_um), std::abs(there.y_um - here.y_um));
    if (other != agent && away <= kToldWithinUm) near.push_back(there);
  }
  std::ranges::stable_sort(near, {}, [&](Point p) { return squared_distance_um2(p, here); });
  return near;
}

StepResult ExplorationEnvironment::step_decision(int agent, const Decision& decision) {
  if (decision.kind != Decision::Kind::kExplored) return act(agent);
  agents_[static_cast<std::size_t>(agent)].has_nothing_to_do = true;
  next_agent_ = (agent + 1) % agents();
  const bool all = std::all_of(agents_.begin(), agents_.end(),
                               [](const Agent& a) { return a.has_nothing_to_do; });
  done_ = done_ || all;
  StepResult result;
  result.idle = true;
  result.done = done_;
  return result;
}

StepResult ExplorationEnvironment::step_towards(int agent, Point target) {
  Explorer& explorer = agents_[static_cast<std::size_t>(agent)].explorer.get();
  const GridFrame& frame = explorer.map().frame();
  const Cell here = frame.cell_at(pose(agent).position), wanted = frame.cell_at(target);
  if (is_clear_line(explorer.map(), here, wanted)) return act_along(agent, {{target}});
  explorer.compute_paths(pose(agent));
  Decision decision;
  const Cell nearest = nearest_reachable(explorer, here, target);
  if (!ok(explorer.select_cell(pose(agent), nearest, decision))) return stay(agent);
  const std::span<const Point> path = explorer.path().points();
  std::vector<Point> waypoints(path.begin(), path.end());
  waypoints.empty() ? waypoints.push_back(target) : void(waypoints.back() = target);
  return act_along(agent, waypoints);
}

StepResult ExplorationEnvironment::act(int agent) {
  return act_along(agent, explorer(agent).path().points());
}

StepResult ExplorationEnvironment::act_along(int agent, std::span<const Point> waypoints) {
  Agent& a = agents_[static_cast<std::size_t>(agent)];
  StepResult result;
  announce(a, ExplorerCall::kBeginAction);
  a.explorer.get().begin_action();
  drive(a, waypoints, result);
  finish_action(agent, result);
  return result;
}

StepResult ExplorationEnvironment::stay(int agent) {
  StepResult result;
  Agent& a = agents_[static_cast<std::size_t>(agent)];
  announce(a, ExplorerCall::kBeginAction);
  a.explorer.get().begin_action();
  finish_action(agent, result);
  return result;
}

void ExplorationEnvironment::finish_action(int agent, StepResult& result) {
  const auto index = static_cast<std::size_t>(agent);
  Agent& a = agents_[index];
  const ViewStatistics& seen = a.explorer.get().action_statistics();
  result.newly_seen_cells = seen.newly_seen_cells;
  result.re_seen_cells = seen.re_seen_cells;
  result.re_seen_penalty_cells = static_cast<double>(seen.re_seen_penalty_q12) / 4096.0;
  result.idle = result.distance_m * 1e6 < kIdleUm && result.turned_rad < kIdleRad;
  share(agent);
  if (result.collided || (result.blocked && result.idle)) {
    announce(a, ExplorerCall::kAbandonGoal);
    a.explorer.get().abandon_goal();
  }
  ++totals_.actions[index];
  totals_.distance_m[index] += result.distance_m;
  totals_.sim_steps += result.sim_steps;
  totals_.collisions += result.collided ? 1 : 0;
  totals_.found = totals_.found || result.found;
  for (Agent& other : agents_) other.has_nothing_to_do = false;
  const bool tired = *std::min_element(totals_.actions.begin(), totals_.actions.end()) >=
                     config_.max_actions_per_agent;
  const bool explored = scenario_.places.empty()
                            ? !scenario_.target && totals_.coverage() >= config_.until_coverage
                            : unseen_places_.empty();
  done_ = done_ || totals_.found || tired || explored;
  result.done = done_;
  next_agent_ = (agent + 1) % agents();
}

// --- Motion --------------------------------------------------------------------------------------

void ExplorationEnvironment::drive(Agent& agent, std::span<const Point> waypoints,
                                   StepResult& result) {
  Motion motion{agent, result, {}};
  motion.steps_to_view = config_.view_every_steps;
  take_path(motion, waypoints);
  follow(motion);
  for (int detours = 0; motion.rerouted && detours < kMaxDetours && reroute(motion); ++detours) {
    follow(motion);
  }
  result.blocked = result.blocked || motion.rerouted;
  take_view(agent, config_.count_last_view, result);
}

void ExplorationEnvironment::take_path(Motion& motion, std::span<const Point> waypoints) const {
  motion.waypoints.assign(waypoints.begin(), waypoints.end());
  motion.next = 0;
  motion.budget_um = -config_.front_um;
  Point from = motion.agent.pose.position;
  for (const Point& to : waypoints) motion.budget_um += distance_um(std::exchange(from, to), to);
}

bool ExplorationEnvironment::reroute(Motion& motion) {
  if (!ok(motion.agent.explorer.get().replan(motion.agent.pose))) return false;
  motion.rerouted = false;
  take_path(motion, motion.agent.explorer.get().path().points());
  return true;
}

void ExplorationEnvironment::follow(Motion& motion) {
  for (; motion.next < motion.waypoints.size() && motion.goes_on(); ++motion.next) {
    const Point goal = motion.waypoints[motion.next];
    if (goal == motion.agent.pose.position) continue;
    turn_towards(motion, goal);
    if (!motion.goes_on() || motion.budget_um <= 0) break;
    const double before_m = motion.result.distance_m;
    drive_towards(motion, goal);
    motion.budget_um -= (motion.result.distance_m - before_m) * 1e6;
  }
}

void ExplorationEnvironment::turn_towards(Motion& motion, Point goal) {
  Pose& pose = motion.agent.pose;
  const BinaryAngle wanted = atan2_binary(std::int64_t{goal.y_um} - pose.position.y_um,
                                          std::int64_t{goal.x_um} - pose.position.x_um);
  while (motion.goes_on() && !(pose.heading == wanted)) {
    const std::int32_t rest = (wanted - pose.heading).signed_raw();
    const std::int32_t needed = (std::abs(rest) + kTurnStep - 1) / kTurnStep;
    std::int32_t steps = std::min(needed, motion.steps_to_view);
    if (config_.max_sim_steps > 0) {
      steps = std::min(steps, config_.max_sim_steps - motion.result.sim_steps);
    }
    const std::int32_t turned = std::min(std::abs(rest), steps * kTurnStep);
    const std::int32_t raw = pose.heading.raw() + (rest < 0 ? -turned : turned);
    pose.heading = BinaryAngle(static_cast<std::uint16_t>(raw & 0xffff));
    motion.result.turned_rad += turned * (6.283185307179586 / 65536.0);
    spend_steps(motion, steps);
  }
}

void ExplorationEnvironment::drive_towards(Motion& motion, Point goal) {
  Pose& pose = motion.agent.pose;
  const Point from = pose.position;
  const double length = distance_um(from, goal);
  const double wanted = std::min(length, motion.budget_um);
  const double free = free_travel_um(motion.agent, goal);
  const bool is_free = free >= wanted;
  const std::int32_t gap_um = config_.stops_before_contact ? kSafetyGapUm : kContactGapUm;
  const double limit = is_free ? wanted : std::max(0.0, free - gap_um);
  double driven = 0;
  while (motion.goes_on() && driven < limit) {
    auto steps = static_cast<std::int32_t>(std::ceil((limit - driven) / kStepUm));
    steps = std::min(steps, motion.steps_to_view);
    if (config_.max_sim_steps > 0) {
      steps = std::min(steps, config_.max_sim_steps - motion.result.sim_steps);
    }
    const double next = std::min(limit, driven + static_cast<double>(steps) * kStepUm);
    motion.result.distance_m += (next - driven) * 1e-6;
    driven = next;
    pose.position = between(from, goal, driven / length);
    if (driven >= limit && !is_free) {  // contact
      motion.result.sim_steps += steps;
      break;
    }
    spend_steps(motion, steps);
  }
  if (is_free || driven < limit) return;
  motion.ended = true;
  (config_.stops_before_contact ? motion.result.blocked : motion.result.collided) = true;
}

// Lets time pass; takes the views that are due. The one at an action's very end is drive()'s.
void ExplorationEnvironment::spend_steps(Motion& motion, std::int32_t steps) {
  motion.result.sim_steps += steps;
  motion.steps_to_view -= steps;
  if (config_.max_sim_steps > 0 && motion.result.sim_steps >= config_.max_sim_steps) {
    motion.ended = true;
    return;
  }
  if (motion.steps_to_view > 0) return;
  motion.steps_to_view = config_.view_every_steps;
  take_view(motion.agent, true, motion.result);
  const bool is_far =
      config_.max_travel_um > 0 && motion.result.distance_m * 1e6 >= config_.max_travel_um;
  if (is_far ||
      (config_.ends_when_goal_is_seen && motion.agent.explorer.get().goal_has_been_seen())) {
    motion.ended = true;
  } else if (config_.reroute_when_blocked) {
    motion.rerouted = path_is_blocked(motion);
  }
}

double ExplorationEnvironment::free_travel_um(const Agent& agent, Point to) const {
  const Point from = agent.pose.position;
  double travel = scenario_.rays->free_travel_um(from, to, config_.body_radius_um);
  for (const Agent& other : agents_) {
    if (&other == &agent) continue;
    const double x = other.pose.position.x_um, y = other.pose.position.y_um;
    travel =
        std::min(travel, travel_until_box_um(from, to, 2 * config_.body_radius_um, x, y, x, y));
  }
  return travel;
}

bool ExplorationEnvironment::path_is_blocked(const Motion& motion) const {
  const Explorer& explorer = motion.agent.explorer.get();
  const GridFrame& frame = explorer.map().frame();
  const double step = frame.cell_um();
  // Close to the robot the planner allows what it must to get away.
  double skip = explorer.config().robot_radius_um + 2 * step;
  Point from = motion.agent.pose.position;
  for (std::size_t i = motion.next; i < motion.waypoints.size(); ++i) {
    const Point to = motion.waypoints[i];
    const double length = distance_um(from, to);
    for (double t = skip; t <= length; t += step) {
      if (explorer.map().is_blocked(frame.cell_at(between(from, to, t / length)))) return true;
    }
    skip = std::max(0.0, skip - length);
    from = to;
  }
  return false;
}

// --- Sensing -------------------------------------------------------------------------------------

void ExplorationEnvironment::take_view(Agent& agent, bool count_visits, StepResult& result) {
  scan_.clear();
  for (const ScanPoint& beam : beams_) {
    const std::int32_t limit_um = std::int32_t{beam.range_mm} * 1000;
    const std::int32_t range_um =
        scenario_.rays->cast_um(agent.pose.position, agent.pose.heading + beam.bearing, limit_um);
    ScanPoint point = beam;
    point.echo = range_um < limit_um ? Echo::kHit : Echo::kClear;
    point.range_mm = static_cast<std::uint16_t>((range_um + 999) / 1000);
    scan_.push(point);
  }
  if (result.collided && config_.feels_contact) feel_contact(agent);
  announce(agent, ExplorerCall::kFuse, {}, &scan_, count_visits);
  agent.explorer.get().fuse(agent.pose, scan_, count_visits);
  ++result.views;
  const auto& target = scenario_.target;
  result.found = result.found || (target && target_in_view(agent.pose, *target));
  result.places += strike_places(agent.pose);
}

// Adds the touched point to the scan as one more beam.
void ExplorationEnvironment::feel_contact(const Agent& agent) {
  const Point here = agent.pose.position;
  const auto touched =
      scenario_.rays->nearest_obstacle(here, config_.body_radius_um + 2 * kContactGapUm);
  if (!touched) return;  // another robot
  const BinaryAngle direction = atan2_binary(std::int64_t{touched->y_um} - here.y_um,
                                             std::int64_t{touched->x_um} - here.x_um);
  const auto range_mm = static_cast<std::uint16_t>(std::ceil(distance_um(here, *touched) / 1000));
  scan_.push({direction - agent.pose.heading, range_mm, Echo::kHit});
}

bool ExplorationEnvironment::target_in_view(const Pose& pose, Point target) const {
  const std::int64_t c = cos_q30(pose.heading), s = sin_q30(pose.heading);
  constexpr std::int32_t kHalf = arena::kTargetUm / 2;
  for (int k = 0; k < 9; ++k) {
    const Point p{target.x_um + (k % 3 - 1) * kHalf, target.y_um + (k / 3 - 1) * kHalf};
    const std::int64_t dx = std::int64_t{p.x_um} - pose.position.x_um;
    const std::int64_t dy = std::int64_t{p.y_um} - pose.position.y_um;
    const std::int64_t ahead = (dx * c + dy * s) >> 30, left = (dy * c - dx * s) >> 30;
    if (!trapezoid_contains(config_.explorer.fusion.footprint, ahead, left)) continue;
    if (scenario_.rays->line_of_sight(pose.position, p)) return true;
  }
  return false;
}

// Removes the places in view; answers how many.
std::int32_t ExplorationEnvironment::strike_places(const Pose& pose) {
  const std::int64_t reach = 2 * std::int64_t{config_.explorer.fusion.footprint.far_um};
  return static_cast<std::int32_t>(std::erase_if(unseen_places_, [&](Point place) {
    return squared_distance_um2(pose.position, place) < reach * reach &&
           target_in_view(pose, place);
  }));
}

// --- Sharing -------------------------------------------------------------------------------------

// What the link does after an action: own changes to the server, the sum of the others' to each.
void ExplorationEnvironment::share(int agent) {
  Agent& speaker = agents_[static_cast<std::size_t>(agent)];
  const CellRect visits = count_visits(speaker);
  const CellRect obstacles = collect_obstacles(speaker);
  totals_.visit_mbr_cells += visits.area();
  totals_.obstacle_mbr_cells += obstacles.area();
  if (share_observer_.observer) {
    share_observer_.observer(agent, Layer::kVisits, visits);
    share_observer_.observer(agent, Layer::kObstacles, obstacles);
  }
  const CellRect old_body = std::exchange(speaker.body, body_rect(speaker.pose));
  if (agents() == 1) return;
  for (int listener = 0; listener < agents(); ++listener) {
    if (listener == agent) continue;
    tell_visits(listener, visits);
    tell_obstacles(listener, obstacles);
    tell_obstacles(listener, old_body);
    tell_obstacles(listener, speaker.body);
  }
}

// Takes over the agent's new counts and keeps the totals. Returns MBR(delta S).
CellRect ExplorationEnvironment::count_visits(Agent& agent) {
  ExplorationMap& map = agent.explorer.get().map();
  const CellRect rect = map.take_changes(Layer::kVisits).intersection(extent_);
  if (rect.empty()) return {};
  scratch_.resize(static_cast<std::size_t>(rect.area()));
  if (!ok(map.read_own(Layer::kVisits, rect, scratch_))) return {};
  const std::uint8_t* count = scratch_.data();
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    for (std::size_t i = extent_frame_.index_of({rect.x, y}), end = i + rect.width; i < end; ++i) {
      const std::uint8_t now = *count++, before = agent.visits[i];
      if (now <= before) continue;  // a window that rolled away and back counts from zero
      totals_.visits += now - before;
      agent.visits[i] = now;
      if (before != 0) continue;
      if (++seen_by_[i] == 1) {
        ++totals_.explored_cells;
        totals_.explorable_seen_cells += explorable_[i];
      } else if (seen_by_[i] == 2) {
        ++totals_.shared_cells;
      }
    }
  }
  return rect;
}

// Takes over the agent's obstacles. Returns MBR(delta O).
CellRect ExplorationEnvironment::collect_obstacles(Agent& agent) {
  ExplorationMap& map = agent.explorer.get().map();
  const CellRect rect = map.take_changes(Layer::kObstacles).intersection(extent_);
  if (rect.empty()) return {};
  scratch_.resize(static_cast<std::size_t>(rect.area()));
  if (!ok(map.read_own(Layer::kObstacles, rect, scratch_))) return {};
  const std::uint8_t* cell = scratch_.data();
  for (std::int32_t y = rect.y; y < rect.top(); ++y) {
    std::uint8_t* const row = &agent.obstacles[extent_frame_.index_of({rect.x, y})];
    std::copy(cell, cell + rect.width, row);
    cell += rect.width;
  }
  return rect;
}

void ExplorationEnvironment::tell_visits(int listener, const CellRect& rect) {
  if (rect.empty()) return;
  scratch_.assign(static_cast<std::size_t>(rect.area()), 0);
  for (int other = 0; other < agents(); ++other) {
    if (other == listener) continue;
    std::uint8_t* sum = scratch_.data();
    for (std::int32_t y = rect.y; y < rect.top(); ++y) {
      const std::uint8_t* const row = &visits(other)[extent_frame_.index_of({rect.x, y})];
      for (std::int32_t x = 0; x < rect.width; ++x, ++sum) {
        *sum = static_cast<std::uint8_t>(std::min(255, *sum + row[x]));
      }
    }
  }
  (void)explorer(listener).map().write_peers(Layer::kVisits, rect, scratch_);  // sizes match
}

// The others' obstacles, the walls that are known, and where the other robots stand.
void ExplorationEnvironment::tell_obstacles(int listener, const CellRect& wanted) {
  const CellRect rect = wanted.intersection(extent_);
  if (rect.empty()) return;
  scratch_.assign(static_cast<std::size_t>(rect.area()), 0);
  for (int other = 0; other < agents(); ++other) {
    if (other == listener) continue;
    const Agent& speaker = agents_[static_cast<std::size_t>(other)];
    const std::int64_t radius2 = std::int64_t{config_.body_radius_um} * config_.body_radius_um;
    std::uint8_t* cell = scratch_.data();
    for (std::int32_t y = rect.y; y < rect.top(); ++y) {
      const std::uint8_t* const row = &speaker.obstacles[extent_frame_.index_of({rect.x, y})];
      for (std::int32_t x = 0; x < rect.width; ++x, ++cell) {
        *cell = *cell | row[x];
        const Cell here{rect.x + x, y};
        if (!speaker.body.contains(here)) continue;
        const Point p = extent_frame_.center_of(here);
        if (squared_distance_um2(p, speaker.pose.position) <= radius2) *cell = 1;
      }
    }
  }
  if (!known_walls_.empty()) {
    std::uint8_t* cell = scratch_.data();
    for (std::int32_t y = rect.y; y < rect.top(); ++y) {
      const std::uint8_t* const row = &known_walls_[extent_frame_.index_of({rect.x, y})];
      for (std::int32_t x = 0; x < rect.width; ++x, ++cell) *cell = *cell | row[x];
    }
  }
  (void)explorer(listener).map().write_peers(Layer::kObstacles, rect, scratch_);  // sizes match
}

CellRect ExplorationEnvironment::body_rect(const Pose& pose) const {
  const Cell middle = extent_frame_.cell_at(pose.position);
  return CellRect{middle.x, middle.y, 1, 1}.grown(config_.body_radius_um / config_.cell_um + 1);
}

}  // namespace ivfm::host
