// The explorer: map, state, Q values and goal choice of one robot, without any input or output.
// The agent, the evaluator and the trainer's environment all run this very code.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "firmware/lidar/scan.h"
#include "firmware/mapping/exploration_map.h"
#include "firmware/mapping/scan_fusion.h"
#include "firmware/mapping/shortest_path_map.h"
#include "firmware/nn/q_function.h"
#include "firmware/planning/frontier.h"
#include "firmware/planning/path_planner.h"
#include "firmware/planning/teammates.h"
#include "firmware/planning/view_planner.h"

namespace ivfm {

struct ExplorerConfig {
  FusionConfig fusion;
  PathConfig paths;
  std::int32_t robot_radius_um = 105'000;  // TurtleBot3 Burger
  std::int32_t pool = 8;                   // map cells along a policy cell's side
  // Fewer reachable frontier cells than this in the local map: nothing worth visiting there.
  std::int32_t min_local_frontier = 6;
  // Frontiers are weighed by what the view from there would show (see view_planner.h), up to so
  // far, and the policy's choice is weighed against them; 0: the policy decides alone while the
  // local map is worth visiting, then the nearest frontier is next.
  std::int32_t view_reach_um = 0;
  // Where robots may drive into the unknown: so many unseen cells must be in reach instead.
  std::int32_t min_local_unseen = 0;
  // Goals below this value, in 256ths of QFunction::unit(), are not worth an action either while
  // there is more to see elsewhere; 0: all are.
  std::int32_t min_local_value_q8 = 0;
  // Side of the regions of the whole map that such robots compare when the local map is not worth
  // visiting; 0: they go to the nearest frontier.
  std::int32_t region_cells = 0;
  // Added to the way to each of them: the more, the further a robot goes for a richer one.
  std::int32_t region_way_cells = 0;
  // Smaller frontiers of the whole map are taken for noise.
  std::int32_t min_frontier_size = 1;
  // Frontiers of at least this size come first, however far away they are.
  std::int32_t wide_frontier_size = 1;
  // Goals nearer than this are no moves.
  std::int32_t min_goal_distance_um = 105'000;
  // After so many local actions in a row that saw fewer than `min_gain_cells` new cells, the next
  // goal is the nearest frontier of the whole map.
  std::int32_t max_idle_actions = 2;
  std::uint32_t min_gain_cells = 4;
  bool return_to_start = false;
  // False: the window stays where start() put it (worlds that fit into it, the paper's arenas).
  bool rolling_window = true;

  // The paper's arenas (method.md): camera footprint, 1 m local map, robot radius 0.064 m.
  static constexpr ExplorerConfig paper() {
    ExplorerConfig c;
    c.fusion.footprint = VisitFootprint::paper_camera();
    c.robot_radius_um = 64'000;
    c.min_goal_distance_um = 70'000;
    c.pool = 2;
    c.rolling_window = false;
    c.min_local_unseen = 400;        // of the local map's 4,096
    c.min_local_value_q8 = 11 * 64;  // 2.75; on untouched ground the best goal has 4.3
    c.region_cells = 32;
    c.region_way_cells = 48;
    return c;
  }
  // A robot with a lidar: visits count within `visit_range_um`; the local map is about four visit
  // ranges across, as in the paper.
  static constexpr ExplorerConfig lidar(std::int32_t visit_range_um, std::int32_t cell_um) {
    ExplorerConfig c;
    c.fusion.footprint = VisitFootprint::sector(visit_range_um, BinaryAngle(std::uint16_t{0x8000}));
    c.paths.unknown_is_traversable = false;
    c.min_frontier_size = 3;
    c.min_local_frontier = 100;
    c.view_reach_um = visit_range_um;
    c.wide_frontier_size = 5;  // a straight one across the 5 x 5 cells that are looked at
    const std::int32_t pool = (visit_range_um * 4 / cell_um + 31) / 32;
    c.pool = pool < 1 ? 1 : (pool > kMaxPool ? kMaxPool : pool);
    return c;
  }
  // Side of the local map.
  constexpr std::int32_t local_map_um(std::int32_t cell_um) const {
    return kPolicyCells * pool * cell_um;
  }
  // The network decides alone while the local map is worth visiting, else the richest region of
  // the whole map is next: as in the paper's arenas.
  constexpr void let_network_decide() {
    view_reach_um = 0;
    region_cells = 16 * pool;
    region_way_cells = 8 * pool;
  }
};

// What the robot should do next.
struct Decision {
  enum class Kind : std::uint8_t {
    kLocalGoal,   // the policy's choice in the local map
    kGlobalGoal,  // a frontier, wherever in the whole map
    kReturn,      // explored: back to the start
    kExplored,    // nothing left to explore; stay
  };
  Kind kind = Kind::kExplored;
  Cell goal;
  std::int32_t policy_cell = -1;  // index in the policy grid, for local goals
  std::int32_t q_value = 0;
};

class Explorer {
 public:
  using Mask = std::array<std::uint8_t, kPolicyGridSize>;

  // The memory that an Explorer works in; see ExplorerFor.
  struct Memory {
    MapLayers layers;
    std::span<std::uint32_t> bucket_entries;
  };

  Explorer(const ExplorerConfig& config, const Memory& memory, std::int32_t cell_um,
           std::int32_t window_cells);

  // Empties everything. The map's window is centred on `window_center`.
  void start(const Pose& pose, Point window_center);
  void start(const Pose& pose) { start(pose, pose.position); }

  // The robot stands elsewhere than start() was told; what the others saw stays.
  void correct_start(const Pose& pose) { start_ = pose; }
  // The same once it has seen something, which moves along by `moved` (T_new_old of the map frame).
  void re_express(const Pose& moved, bool alone);  // see ExplorationMap

  // Where other robots are now, in the map frame: far goals that they are nearer to count less.
  // Until told otherwise; at first there are none. Of more than Teammates::kMost the first count.
  void set_teammates(std::span<const Point> positions);
  const Teammates& teammates() const { return teammates_; }

  // Begins an action: visits count once per action on the union of its views.
  void begin_action();
  // Fuses a scan taken at `pose`. `count_visits` false: occupancy only.
  ViewStatistics fuse(const Pose& pose, const Scan& scan, bool count_visits = true);

  // Rolls the window, computes the shortest path map of the local map and the state.
  void observe(const Pose& pose);
  const LocalState& state() const { return state_; }
  // Which policy cells can be goals: reachable and far enough. After observe().
  const Mask& goal_mask() const { return mask_; }
  // Whether the local map holds anything worth visiting. After observe().
  bool local_map_is_worth_visiting() const;

  // The whole decision: observe; evaluate, masked argmax; else a frontier of the whole map; else
  // explored. With config().view_reach_um the frontier comes first when the view from there is
  // worth more. The path to the goal is planned. A failing `q` counts as "no local goal".
  Decision decide(const Pose& pose, QFunction& q);
  // A goal chosen by somebody else (baselines, trainer). After observe(). kUnavailable: out of
  // reach; kInvalidArgument: no such policy cell. Plans the path.
  Status select_local_goal(std::int32_t policy_cell, Decision& out);
  // The map cell that stands for a reachable policy cell as a goal. After observe().
  Cell goal_in_block(std::int32_t policy_cell) const;
  // The nearest frontier of the whole map, or return, or explored. Plans the path.
  Decision select_global_goal(const Pose& pose);
  // Back to where start() was, or kExplored when it is there or cannot get there. Plans the path.
  Decision select_return(const Pose& pose);
  // Computes the shortest path map of everything that is known: for planners that weigh goals.
  void compute_paths(const Pose& pose) {
    paths_.compute(map_, robot_cell(pose), explored_region(pose));
  }
  // Any map cell as a goal; computes the shortest path map of the whole map. kUnavailable as above.
  Status select_cell(const Pose& pose, Cell goal, Decision& out);
  // Plans the way to the last decision's goal again, from `pose` and around what has been seen
  // since. kUnavailable: the goal is out of reach now; kEmpty: there is no goal.
  Status replan(const Pose& pose);
  // Whether the last decision still makes sense: its way is not blocked by what has been seen
  // since, counted from waypoint `next_waypoint` on, and a frontier it was made for is still one.
  bool goal_is_still_good(const Pose& pose, std::size_t next_waypoint) const;
  // Whether the last decision was for the view of a frontier that has been seen since: nothing is
  // left to go there for.
  bool goal_has_been_seen() const {
    return config_.view_reach_um > 0 && last_.kind == Decision::Kind::kGlobalGoal &&
           !is_open(last_frontier_);
  }
  // The last goal could not be reached (blocked, stuck): global goals near it are given up.
  void abandon_goal();

  // What the policy answered last, in the order of the policy grid.
  std::span<const std::int32_t> q_values() const { return q_values_; }

  // Waypoints of the last decision, in driving order.
  const WaypointPath& path() const { return path_; }

  ExplorationMap& map() { return map_; }
  const ExplorationMap& map() const { return map_; }
  ShortestPathMap& paths() { return paths_; }
  const ShortestPathMap& paths() const { return paths_; }
  const ExplorerConfig& config() const { return config_; }
  const ViewStatistics& action_statistics() const { return action_; }
  std::int32_t stand_off_cells() const;

  // Takes over another explorer's state; both must come from the same profile.
  void copy_from(const Explorer& other);

 private:
  Cell robot_cell(const Pose& pose) const { return map_.frame().cell_at(pose.position); }
  CellRect explored_region(const Pose& pose) const;
  Decision drive_to(const FrontierGoal& frontier);
  std::int32_t best_policy_cell() const;
  bool is_worth_an_action(std::int32_t favourite, std::int32_t unit) const;
  Decision follow_policy(std::int32_t favourite);
  ViewValue view_from(std::int32_t favourite) const;
  std::optional<FrontierView> best_view(int min_size) const;
  std::int32_t view_reach_cells() const { return config_.view_reach_um / map_.frame().cell_um(); }
  std::span<const Clearance> clearances() const;
  void plan_everywhere(const Pose& pose, Clearance clearance);
  bool worth_trying(const FrontierGoal& frontier);
  enum class FrontierRule : std::uint8_t { kNearest, kBestView };
  std::optional<FrontierGoal> choose_frontier(FrontierRule rule);
  std::optional<FrontierGoal> next_frontier(FrontierRule rule) const;
  CellRect rich_area() const;
  std::optional<FrontierGoal> find_frontier(FrontierRule rule, int min_size) const;
  Decision select_frontier(const Pose& pose, FrontierRule rule);
  bool is_open(Cell c) const;
  Decision return_or_stay(const Pose& pose);
  Decision stay();
  void give_up_frontier();
  void review_last_goal(const Pose& pose);
  Decision planned(Decision decision);

  ExplorerConfig config_;
  ExplorationMap map_;
  ScanFusion fusion_;
  ShortestPathMap paths_;
  LocalState state_{};
  Mask mask_{};
  WaypointPath path_;
  Pose start_{};
  ViewStatistics action_{};
  Decision last_{};
  Cell last_frontier_{};
  std::int32_t last_frontier_cost_ = 0;  // of the way there when it was chosen
  std::int32_t idle_actions_ = 0;
  std::int32_t tries_at_frontier_ = 0;  // in vain, since something new was seen
  Teammates teammates_;
  Clearance clearance_ = Clearance::kPreferred;  // of the way to the last goal
  std::array<std::int32_t, kPolicyGridSize> q_values_{};
};

// An Explorer with its memory: nothing is ever allocated. Copyable (planners look ahead in copies).
template <typename Profile>
class ExplorerFor : private MapStorage<Profile::kWindowCells>,
                    private BucketStorage<Profile::kBucketCapacity>,
                    public Explorer {
  using Cells = MapStorage<Profile::kWindowCells>;
  using Buckets = BucketStorage<Profile::kBucketCapacity>;

 public:
  explicit ExplorerFor(const ExplorerConfig& config, std::int32_t cell_um = Profile::kCellUm)
      : Explorer(config, {Cells::layers(), Buckets::entries}, cell_um, Profile::kWindowCells) {}
  ExplorerFor(const ExplorerFor& other)
      : ExplorerFor(other.config(), other.map().frame().cell_um()) {
    copy_from(other);
  }
  ExplorerFor& operator=(const ExplorerFor& other) {
    copy_from(other);
    return *this;
  }
};

}  // namespace ivfm
