#include "host/trainer/exploration_slot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>

#include "host/environment/arena_worlds.h"
#include "host/environment/building_worlds.h"

namespace ivfm::host {
namespace {

// Seeds of training worlds; evaluation uses others (docs/training.md).
constexpr std::uint64_t kTrainingSeeds = 900'000;
// The shares of worlds: arenas first, in the order of ArenaKind's use below.
constexpr std::size_t kBuilding = 4, kCorridor = 5;
// How the paper's last experiment is played with a lidar (docs/training.md): what counts as seen,
// what is mapped, and the share of the place that is explored.
constexpr std::int32_t kCorridorVisitUm = 1'200'000, kCorridorRangeUm = 3'000'000;
constexpr double kCorridorVisitFovDeg = 150, kCorridorCoverage = 0.6;
constexpr double kDiscountCells = 8;  // the distance's discount counts for so many policy cells

// Whether the network decides alone, in whole actions: as in arenas.
bool network_decides(const EnvironmentConfig& config) { return config.explorer.view_reach_um == 0; }

EnvironmentConfig corridor_config() {
  EnvironmentConfig config = EnvironmentConfig::building(kCorridorVisitUm);
  config.sensor_range_um = config.explorer.fusion.mapping_range_um = kCorridorRangeUm;
  config.explorer.fusion.footprint.half_angle =
      BinaryAngle::from_degrees(kCorridorVisitFovDeg / 2).raw();
  config.explorer.let_network_decide();
  config.max_travel_um = 0;
  return config;
}

double policy_cell_m(const ExplorationEnvironment& environment) {
  return environment.config().cell_um * 1e-6 * environment.config().explorer.pool;
}

// Answers the one goal that the trainer chose as the best.
class ChosenGoal final : public QFunction {
 public:
  explicit ChosenGoal(int policy_cell) : policy_cell_(policy_cell) {}
  Status evaluate(const LocalState&, std::span<std::int32_t> q_values) override {
    std::fill(q_values.begin(), q_values.end(), 0);
    if (policy_cell_ >= 0) q_values[static_cast<std::size_t>(policy_cell_)] = 1;
    return Status::kOk;
  }

 private:
  int policy_cell_;
};

double between(double low, double high, ResumableRandom& random) {
  return low + (high - low) * random.uniform();
}

}  // namespace

Observation observation_of(StateKind kind, const ExplorationEnvironment& environment, int agent) {
  static_assert(kActions == kPolicyGridSize);
  Observation out;
  const auto size = static_cast<std::size_t>(channels_of(kind)) * kActions;
  encode_network_state(kind, environment.explorer(agent), environment.pose(agent),
                       std::span(out.state).first(size));
  const Explorer::Mask& mask = environment.goal_mask(agent);
  for (int i = 0; i < kActions; ++i)
    if (mask[static_cast<std::size_t>(i)] != 0) out.reachable.set(i);
  return out;
}

Earning earning_of(const StepResult& result, const ExplorationEnvironment& environment,
                   const TrainerConfig& config) {
  const RewardConfig& r = config.reward;
  const double pool = environment.config().explorer.pool;
  const double newly_seen = result.newly_seen_cells / (pool * pool);
  const double penalty = result.re_seen_penalty_cells / (pool * pool);
  const double driven_cells = result.distance_m / policy_cell_m(environment);
  const bool is_arena = environment.config().sensor == SensorModel::kPaperCamera;
  const bool is_corridor = !is_arena && network_decides(environment.config());
  const double re_seen = is_arena      ? r.re_seen
                         : is_corridor ? r.corridor_re_seen
                                       : r.building_re_seen;
  Earning out;
  out.reward = (newly_seen - re_seen * penalty) / r.unit_cells - r.per_action -
               r.per_cell * driven_cells - (result.collided ? r.collision : 0) -
               (result.idle ? r.idle : 0);
  const DiscountConfig& discount =
      is_arena || is_corridor ? config.arena_discount : config.building_discount;
  out.discount = discount.action * std::pow(discount.distance, driven_cells / kDiscountCells);
  return out;
}

StepResult step_as_explorer(ExplorationEnvironment& environment, int agent, int policy_cell,
                            bool& is_local) {
  ChosenGoal goal(policy_cell);
  const Decision decision = environment.decide(agent, goal);
  is_local = decision.kind == Decision::Kind::kLocalGoal;
  return environment.step_decision(agent, decision);
}

ExplorationSlot::ExplorationSlot(const TrainerConfig& config, double share) : config_(config) {
  const WorldMix& mix = config.worlds;
  const double shares[] = {mix.arena_1x,         mix.arena_2x, mix.divider,
                           mix.divider_released, mix.building, mix.corridor};
  double rest = share * std::accumulate(std::begin(shares), std::end(shares), 0.0);
  while (kind_ + 1 < std::size(shares) && rest >= shares[kind_]) rest -= shares[kind_++];
}

void ExplorationSlot::begin(ResumableRandom& random) {
  const auto agents =
      static_cast<int>(1 + random.below(static_cast<std::uint64_t>(config_.worlds.max_agents)));
  cut_off_coverage_ = between(0.3, 1.1, random);
  if (kind_ == kCorridor) cut_off_coverage_ *= kCorridorCoverage;
  return kind_ < kBuilding ? begin_arena(agents, random) : begin_building(agents, random);
}

void ExplorationSlot::begin_arena(int agents, ResumableRandom& random) {
  if (!environment_) {
    EnvironmentConfig arena = EnvironmentConfig::arena();
    arena.max_actions_per_agent = 150;
    arena.window_cells = 0;  // no larger than the world: copies are cheaper
    environment_ = std::make_unique<ExplorationEnvironment>(arena);
  }
  const ArenaKind kinds[] = {ArenaKind::k1x, ArenaKind::k2x, ArenaKind::kDivider,
                             ArenaKind::kDividerReleased};
  Scenario scenario = random_arena(kinds[kind_], agents, random.below(kTrainingSeeds));
  scenario.target.reset();
  environment_->reset(scenario);
}

EnvironmentConfig ExplorationSlot::building_config(ResumableRandom& random) const {
  if (kind_ == kCorridor) return corridor_config();
  const WorldMix& mix = config_.worlds;
  const double range_m = between(mix.building_min_range_m, mix.building_max_range_m, random);
  return EnvironmentConfig::building(static_cast<std::int32_t>(range_m * 1e6));
}

void ExplorationSlot::begin_building(int agents, ResumableRandom& random) {
  EnvironmentConfig config = building_config(random);
  config.max_actions_per_agent = 400;
  config.view_every_steps *= 2;  // the lidar's views overlap by far: half of them will do
  config.window_cells = 0;       // no larger than the world: copies are cheaper
  environment_ = std::make_unique<ExplorationEnvironment>(config);
  const WorldMix& mix = config_.worlds;
  BuildingConfig building;
  building.min_side_um = static_cast<std::int32_t>(mix.building_min_side_m * 1e6);
  building.max_side_um = static_cast<std::int32_t>(mix.building_max_side_m * 1e6);
  environment_->reset(random_building(building, agents, random.below(kTrainingSeeds)));
}

}  // namespace ivfm::host
