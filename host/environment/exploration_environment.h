// Robots exploring a simulated world in turn, each with the firmware's own Explorer, in process.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "firmware/agent/profile.h"
#include "firmware/lidar/scan.h"
#include "firmware/planning/explorer.h"
#include "host/environment/scenario.h"

namespace ivfm::host {

enum class SensorModel : std::uint8_t {
  kPaperCamera,  // sees its floor trapezoid and the obstacles that stand in it
  kLidar,        // a fan of beams of limited range
};

// How robots sense, move and share. Start from arena() or building().
struct EnvironmentConfig {
  ExplorerConfig explorer;
  std::int32_t cell_um = 0;       // of the robots' maps
  std::int32_t window_cells = 0;  // side of the robots' maps; 0: as large as the world needs
  std::int32_t body_radius_um =
      0;  // what touches obstacles; explorer.robot_radius_um is planned with

  SensorModel sensor = SensorModel::kLidar;
  std::int32_t sensor_range_um = 0;          // lidar: beams end here
  std::uint16_t sensor_half_angle = 0x8000;  // lidar: half the field of view, 0x8000 = full circle
  std::uint16_t beam_step = 0;               // lidar: binary angle between beams

  // Motion, in simulation steps of 1/240 s: 1 mm forward (0.24 m/s) or 3 degrees of turn.
  std::int32_t max_sim_steps = 0;     // an action ends after so many; 0: no limit
  std::int32_t view_every_steps = 0;  // a view is taken after so many steps, and at the end
  std::int32_t front_um = 0;          // the robot's front, not its middle, goes to the goal
  bool count_last_view = true;        // whether an action's last view counts as a visit
  bool count_first_view = true;       // whether the view before the first action counts
  bool reroute_when_blocked = false;  // an action goes on around what a view shows in its way
  // As on board (Agent): an action ends after so much driving (0: no limit), and when a view has
  // shown the frontier that it was for.
  std::int32_t max_travel_um = 0;
  bool ends_when_goal_is_seen = false;
  // The lidar that looks all the time stops the robot before it touches anything: the action is
  // blocked, not a collision.
  bool stops_before_contact = false;
  // A robot that collides feels where: the contact becomes an obstacle on its map. Without it a
  // robot that touches what its camera cannot see would try the same way for ever.
  bool feels_contact = true;
  bool walls_known = false;  // the world's border is on the maps from the start

  std::int32_t max_actions_per_agent = 800;
  // Without a target the episode ends when this share of the explorable area is seen.
  double until_coverage = 0.99;
  // Explorable is what a disc that the planner lets through can sweep; else all connected free
  // area.
  bool explorable_by_disc = false;

  // The paper's arenas, with the accounting of its released code (method.md).
  static EnvironmentConfig arena();
  // Buildings: a 360 degree lidar of limited range, RobotProfile's cells.
  static EnvironmentConfig building(std::int32_t sensor_range_um = 3'000'000);
};

// What one action did.
struct StepResult {
  std::uint32_t newly_seen_cells = 0;  // no robot had seen them before
  std::uint32_t re_seen_cells = 0;     // seen before this action
  double re_seen_penalty_cells = 0;    // sum of 2 sigma(count) - 1 over the re-seen cells
  std::int32_t places = 0;             // of Scenario::places that no view had contained before
  double distance_m = 0;               // driven
  double turned_rad = 0;
  std::int32_t sim_steps = 0;
  std::int32_t views = 0;
  bool collided = false;  // the action ended by contact
  bool blocked = false;   // the action ended because its path turned out to be blocked
  bool idle = false;      // moved less than 5 mm and turned less than 1 degree
  bool found = false;     // a view contained the target
  bool done = false;      // the episode is over: found, explored enough, or out of actions
};

// What an episode amounts to so far; the raw material of the metrics in method.md.
struct EpisodeTotals {
  std::vector<std::int32_t> actions;  // by agent
  std::vector<double> distance_m;     // by agent
  std::int64_t explored_cells = 0;    // seen by anybody
  std::int64_t visits = 0;            // sum over cells and agents
  std::int64_t shared_cells = 0;      // seen by two agents or more
  std::int64_t explorable_cells = 0;
  std::int64_t explorable_seen_cells = 0;
  std::int64_t sim_steps = 0;  // summed over agents
  std::int64_t collisions = 0;
  std::int64_t visit_mbr_cells = 0;     // area of MBR(delta S), summed over actions
  std::int64_t obstacle_mbr_cells = 0;  // area of MBR(delta O), summed over actions
  bool found = false;

  std::int32_t total_actions() const;
  double total_distance_m() const;
  double coverage() const {
    return explorable_cells == 0
               ? 0
               : static_cast<double>(explorable_seen_cells) / static_cast<double>(explorable_cells);
  }
};

// An Explorer whose memory is sized at run time. Copyable.
class HeapExplorer {
 public:
  HeapExplorer(const ExplorerConfig& config, std::int32_t cell_um, std::int32_t window_cells);
  HeapExplorer(const HeapExplorer& other);
  HeapExplorer& operator=(const HeapExplorer& other);
  HeapExplorer(HeapExplorer&&) noexcept;
  HeapExplorer& operator=(HeapExplorer&&) noexcept;
  ~HeapExplorer();

  std::int32_t window_cells() const;

  Explorer& get();
  const Explorer& get() const;

 private:
  struct Storage;
  std::unique_ptr<Storage> storage_;
};

// What the environment asks of an agent's explorer besides deciding; for recorders.
enum class ExplorerCall : std::uint8_t { kStart, kBeginAction, kFuse, kAbandonGoal };

// Told before each call. `center`: of the window, for kStart; `scan`: for kFuse, else null.
using ExplorerObserver = std::function<void(int agent, ExplorerCall call, const Pose& pose,
                                            Point center, const Scan* scan, bool count_visits)>;

// Robots act in turn, one whole action each, and share visits and obstacles after every action as
// the link would. Copies are independent: planners may look ahead in them.
//
//   ExplorationEnvironment env(EnvironmentConfig::arena());
//   env.reset(random_arena(ArenaKind::k1x, 1, seed));
//   while (!env.is_done()) {
//     const int agent = env.next_agent();
//     env.observe(agent);  // -> env.state(agent), env.goal_mask(agent)
//     const StepResult result = env.step(agent, policy_cell);
//   }
class ExplorationEnvironment {
 public:
  explicit ExplorationEnvironment(const EnvironmentConfig& config);

  // Told what an agent would put on the radio: its own cells in the rectangle have changed.
  using ShareObserver = std::function<void(int agent, Layer layer, const CellRect& rect)>;
  // Copies of the environment tell nobody.
  void set_share_observer(ShareObserver observer) {
    share_observer_.observer = std::move(observer);
  }
  // Copies of the environment tell the same observer.
  void set_observer(ExplorerObserver observer) { observer_ = std::move(observer); }

  // Starts an episode with one agent for each of the scenario's starts, and takes the first view.
  // Throws std::invalid_argument when there is no agent.
  void reset(const Scenario& scenario);

  int agents() const { return static_cast<int>(agents_.size()); }
  int next_agent() const { return next_agent_; }
  bool is_done() const { return done_; }

  // Computes the agent's state and goal mask. Both stay valid until the agent's next action.
  void observe(int agent) { explorer(agent).observe(pose(agent)); }
  const LocalState& state(int agent) const { return explorer(agent).state(); }
  const Explorer::Mask& goal_mask(int agent) const { return explorer(agent).goal_mask(); }
  // False: the local map holds nothing worth visiting; call step_global(). After observe().
  bool local_map_is_worth_visiting(int agent) const {
    return explorer(agent).local_map_is_worth_visiting();
  }

  // One action: drives to policy cell 0 .. kPolicyGridSize - 1. After observe(). A cell out of
  // reach is an action that does nothing.
  StepResult step(int agent, int policy_cell);
  // One action: drives to the nearest frontier of the whole map. Ends the episode when there is
  // none: everything that can be reached is explored.
  StepResult step_global(int agent);
  // One action: drives to a map cell anywhere. A cell out of reach is an action that does nothing.
  StepResult step_to(int agent, Cell goal);
  // One action as in the paper's released code: straight to `target` when no known obstacle lies
  // within half the robot's width of the line, else along the shortest path to the reachable cell
  // nearest to it and from there straight on, into whatever is there.
  StepResult step_towards(int agent, Point target);
  // What the agent's explorer decides (Explorer::decide); it knows where the others stand as far as
  // the map server would tell it: the nearest ones within 14 m.
  Decision decide(int agent, QFunction& q);
  // One action: drives what the agent's explorer decided.
  StepResult step_decision(int agent, const Decision& decision);

  Explorer& explorer(int agent) { return agents_[static_cast<std::size_t>(agent)].explorer.get(); }
  const Explorer& explorer(int agent) const {
    return agents_[static_cast<std::size_t>(agent)].explorer.get();
  }
  const Pose& pose(int agent) const { return agents_[static_cast<std::size_t>(agent)].pose; }
  const Scenario& scenario() const { return scenario_; }
  const EnvironmentConfig& config() const { return config_; }
  const EpisodeTotals& totals() const { return totals_; }
  // Visits of one agent over extent(), row by row from the lowest row, saturating at 255.
  const std::vector<std::uint8_t>& visits(int agent) const {
    return agents_[static_cast<std::size_t>(agent)].visits;
  }
  // The map cells that cover the world.
  const CellRect& extent() const { return extent_; }

 private:
  struct Agent {
    HeapExplorer explorer;
    Pose pose;
    std::vector<std::uint8_t> visits;     // own, over extent_
    std::vector<std::uint8_t> obstacles;  // own, over extent_
    CellRect body;                        // where the others hold this robot to be
    bool has_nothing_to_do = false;
  };
  struct Motion;

  void add_agent(std::size_t index, const Pose& start, std::int32_t window_cells);
  void find_explorable_cells();

  std::vector<Point> others_near(int agent) const;
  StepResult act(int agent);
  StepResult act_along(int agent, std::span<const Point> waypoints);
  StepResult stay(int agent);
  void finish_action(int agent, StepResult& result);

  void drive(Agent& agent, std::span<const Point> waypoints, StepResult& result);
  void follow(Motion& motion);
  void take_path(Motion& motion, std::span<const Point> waypoints) const;
  bool reroute(Motion& motion);
  void turn_towards(Motion& motion, Point goal);
  void drive_towards(Motion& motion, Point goal);
  void spend_steps(Motion& motion, std::int32_t steps);
  double free_travel_um(const Agent& agent, Point to) const;
  bool path_is_blocked(const Motion& motion) const;

  void take_view(Agent& agent, bool count_visits, StepResult& result);
  void feel_contact(const Agent& agent);
  bool target_in_view(const Pose& pose, Point target) const;
  std::int32_t strike_places(const Pose& pose);

  void share(int agent);
  CellRect count_visits(Agent& agent);
  CellRect collect_obstacles(Agent& agent);
  void tell_visits(int listener, const CellRect& rect);
  void tell_obstacles(int listener, const CellRect& rect);
  CellRect body_rect(const Pose& pose) const;

  // Tells the observer, if there is one.
  void announce(const Agent& agent, ExplorerCall call, Point center = {},
                const Scan* scan = nullptr, bool count_visits = false) const;

  EnvironmentConfig config_;
  ExplorerObserver observer_;
  // Planners look ahead in copies: nothing is sent there.
  struct Uncopied {
    Uncopied() = default;
    Uncopied(const Uncopied&) {}
    Uncopied& operator=(const Uncopied&) { return *this; }
    ShareObserver observer;
  } share_observer_;
  Scenario scenario_;
  CellRect extent_;
  GridFrame extent_frame_;
  std::vector<Agent> agents_;
  std::vector<std::uint8_t> explorable_;   // over extent_
  std::vector<std::uint8_t> known_walls_;  // over extent_; empty when walls are not known
  std::vector<std::uint8_t> seen_by_;      // over extent_: by how many agents
  std::vector<Point> unseen_places_;       // of scenario_.places
  std::vector<std::uint8_t> scratch_;
  std::vector<ScanPoint> beams_;  // the sensor's fan: bearing and longest range
  Scan scan_;
  EpisodeTotals totals_;
  int next_agent_ = 0;
  bool done_ = true;
};

}  // namespace ivfm::host
