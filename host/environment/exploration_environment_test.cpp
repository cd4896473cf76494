#include "host/environment/exploration_environment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "host/environment/arena_worlds.h"
#include "host/environment/building_worlds.h"
#include "host/environment/random.h"

namespace ivfm::host {
namespace {

// An empty square room of `side_m`, cells of 5 mm, centred on the origin.
Scenario empty_room(int side_m, std::vector<Pose> starts) {
  auto world = std::make_shared<World>();
  world->cell_um = 5'000;
  world->width = world->height = side_m * 200;
  world->origin = {-side_m * 500'000, -side_m * 500'000};
  world->occupied.assign(static_cast<std::size_t>(world->width) * world->height, 0);
  Scenario scenario;
  scenario.rays = std::make_shared<RayCaster>(world);
  scenario.world = world;
  scenario.starts = std::move(starts);
  return scenario;
}

class NoModel final : public QFunction {
 public:
  Status evaluate(const LocalState&, std::span<std::int32_t>) override {
    return Status::kUnavailable;
  }
};

int index_of(int dx, int dy) { return (16 + dy) * kPolicyCells + 16 + dx; }

int random_goal(const ExplorationEnvironment& env, int agent, Random& random) {
  std::vector<int> goals;
  for (int i = 0; i < kPolicyGridSize; ++i) {
    if (env.goal_mask(agent)[static_cast<std::size_t>(i)]) goals.push_back(i);
  }
  return goals.empty() ? 0 : goals[random.below(static_cast<std::uint32_t>(goals.size()))];
}

TEST(ExplorationEnvironment, PlacesTheFrontOnTheGoalAtOneMillimetreAStep) {
  ExplorationEnvironment env(EnvironmentConfig::arena());
  env.reset(empty_room(3, {{{0, 0}, BinaryAngle()}}));
  env.observe(0);
  // 12 policy cells of 31.25 mm straight ahead; the goal is a map cell's middle.
  const StepResult result = env.step(0, index_of(12, 0));
  EXPECT_NEAR(result.distance_m, 12 * 0.03125 + 0.0078 - 0.064, 0.001);
  EXPECT_FALSE(result.collided);
  // 319 mm: 319 steps and the few that turn to the cell's middle; views every 60 and at the end.
  EXPECT_NEAR(result.sim_steps, 320, 2);
  EXPECT_EQ(result.views, 6);
  EXPECT_NEAR(env.pose(0).position.x_um, result.distance_m * 1e6, 400);
}

// A pen of 0.6 m whose gap lets the robot through, but not with a map cell to spare.
TEST(ExplorationEnvironment, ARobotThatIsShutInSqueezesOut) {
  Scenario pen = empty_room(3, {{{0, 0}, BinaryAngle()}});
  World world = *pen.world;
  const auto block = [&world](int x, int y) {  // in cells of 5 mm from the middle
    world.occupied[static_cast<std::size_t>((300 + y) * world.width + 300 + x)] = 1;
  };
  for (int along = -60; along <= 60; ++along) {
    block(-60, along);
    block(along, -60);
    block(along, 60);
    if (std::abs(along) > 17) block(60, along);
  }
  pen.world = std::make_shared<World>(world);
  pen.rays = std::make_shared<RayCaster>(pen.world);
  ExplorationEnvironment env(EnvironmentConfig::arena());
  env.reset(pen);
  NoModel nobody;
  for (int i = 0; i < 60 && !env.is_done(); ++i) {
    env.step_decision(0, env.explorer(0).decide(env.pose(0), nobody));
  }
  EXPECT_GT(env.totals().coverage(), 0.3);
}

TEST(ExplorationEnvironment, SweepsAStripAsWideAsTheCamerasFarEdge) {
  // 0.41 m: six counted views, 0.06 m apart. A view shows the trapezoid, 0.068 m2; each further one
  // adds the far edge's 0.507 m by 0.06 m, less two triangles of 0.06 m by 0.053 m at the slanted
  // sides.
  const double cell_m2 = 0.015625 * 0.015625, strip_m2 = 0.06 * 0.507 - 0.06 * 0.053;
  for (const bool count_first_view : {false, true}) {
    EnvironmentConfig config = EnvironmentConfig::arena();
    config.count_first_view = count_first_view;
    ExplorationEnvironment env(config);
    env.reset(empty_room(3, {{{-500'000, 0}, BinaryAngle()}}));
    env.observe(0);
    const StepResult result = env.step(0, index_of(15, 0));
    EXPECT_EQ(result.views, 7);
    const double first = count_first_view ? strip_m2 : 0.068;
    EXPECT_NEAR(result.newly_seen_cells * cell_m2, first + 5 * strip_m2, 0.004);
    EXPECT_NEAR(result.re_seen_cells * cell_m2, count_first_view ? 0.068 - strip_m2 : 0, 0.004);
  }
}

TEST(ExplorationEnvironment, StopsOnContactWithAWall) {
  ExplorationEnvironment env(EnvironmentConfig::arena());
  // 0.3 m from the wall at x = 1.5, which it has not seen: the camera reaches 0.245 m.
  env.reset(empty_room(3, {{{1'200'000, 0}, BinaryAngle()}}));
  env.observe(0);
  const StepResult result = env.step(0, index_of(15, 0));
  EXPECT_TRUE(result.collided);
  EXPECT_NEAR(result.distance_m, 0.3 - 0.064 - 0.002, 0.001);
}

TEST(ExplorationEnvironment, CutsAnArenaActionAfterEightHundredSteps) {
  EnvironmentConfig config = EnvironmentConfig::arena();
  config.explorer.pool = 8;
  ExplorationEnvironment env(config);
  env.reset(empty_room(4, {{{-1'000'000, 0}, BinaryAngle()}}));
  env.observe(0);
  const StepResult result = env.step(0, index_of(15, 0));  // 1.9 m away
  EXPECT_EQ(result.sim_steps, 800);
  EXPECT_NEAR(result.distance_m, 0.8, 0.005);
}

TEST(ExplorationEnvironment, FindsATargetThatAViewContains) {
  Scenario scenario = empty_room(3, {{{0, 0}, BinaryAngle()}});
  scenario.target = Point{600'000, 0};
  ExplorationEnvironment env(EnvironmentConfig::arena());
  env.reset(scenario);
  env.observe(0);
  EXPECT_FALSE(env.step(0, index_of(8, 0)).found);  // stands at 0.19, sees up to 0.44
  env.observe(0);
  const StepResult result = env.step(0, index_of(12, 0));  // 0.5: sees up to 0.75
  EXPECT_TRUE(result.found);
  EXPECT_TRUE(result.done);
  EXPECT_TRUE(env.is_done());
}

TEST(ExplorationEnvironment, RobotsStopAtEachOtherAndShareWhatTheySee) {
  ExplorationEnvironment env(EnvironmentConfig::arena());
  env.reset(empty_room(3, {{{0, 0}, BinaryAngle()}, {{300'000, 0}, BinaryAngle()}}));
  // The second robot stands on the first one's map, so a goal on it is not allowed.
  env.observe(0);
  EXPECT_FALSE(env.goal_mask(0)[static_cast<std::size_t>(index_of(9, 0))]);
  EXPECT_TRUE(env.goal_mask(0)[static_cast<std::size_t>(index_of(-9, 0))]);
  env.step(0, index_of(0, 12));
  const Cell seen = env.explorer(0).map().frame().cell_at({0, 400'000});
  EXPECT_GT(env.explorer(0).map().visits(seen), 0u);
  EXPECT_EQ(env.explorer(0).map().visits(seen), env.explorer(1).map().visits(seen));
  EXPECT_EQ(env.next_agent(), 1);
}

// In a corridor, a small unseen patch 4 m before the first robot, a large one 13 m; the second
// robot stands at `other`.
Cell goal_beside(Point other) {
  EnvironmentConfig config = EnvironmentConfig::arena();
  config.window_cells = 1'344;  // 21 m
  ExplorationEnvironment env(config);
  env.reset(empty_room(20, {{{-8'000'000, 0}, {}}, {other, {}}}));
  ExplorationMap& map = env.explorer(0).map();
  const GridFrame& frame = map.frame();
  const Cell small = frame.cell_at({-4'000'000, 0}), large = frame.cell_at({5'000'000, 0});
  const CellRect patches[] = {{small.x, small.y - 8, 16, 16}, {large.x, large.y - 32, 64, 64}};
  const CellRect window = frame.window().grown(-1);
  for (std::int32_t x = window.x; x < window.right(); ++x) {
    for (const std::int32_t wall : {-70, 70}) map.add_evidence({x, wall}, occupancy::kHit);
    for (std::int32_t y = -69; y < 70; ++y) {
      const Cell c{x, y};
      if (!patches[0].contains(c) && !patches[1].contains(c)) map.count_visit(c);
    }
  }
  NoModel nobody;
  return env.decide(0, nobody).goal;
}

TEST(ExplorationEnvironment, ARobotLeavesToTheOthersWhatTheyAreNearerToAsFarAsItIsTold) {
  EXPECT_GT(goal_beside({8'000'000, 0}).x, 0) << "16 m away: not told";
  EXPECT_LT(goal_beside({5'000'000, 0}).x, 0) << "13 m away, at the large patch";
  EXPECT_GT(goal_beside({-9'000'000, 0}).x, 0) << "behind it";
}

TEST(ExplorationEnvironment, TotalsAreTheSumOverTheRobotsVisitLayers) {
  ExplorationEnvironment env(EnvironmentConfig::arena());
  env.reset(random_arena(ArenaKind::k1x, 3, 5));
  Random random(1);
  for (int i = 0; i < 40 && !env.is_done(); ++i) {
    const int agent = env.next_agent();
    env.observe(agent);
    env.step(agent, random_goal(env, agent, random));
  }
  std::int64_t visits = 0, explored = 0, shared = 0;
  for (std::size_t i = 0; i < env.visits(0).size(); ++i) {
    int seen_by = 0;
    for (int a = 0; a < 3; ++a) {
      visits += env.visits(a)[i];
      seen_by += env.visits(a)[i] != 0 ? 1 : 0;
    }
    explored += seen_by > 0 ? 1 : 0;
    shared += seen_by > 1 ? 1 : 0;
  }
  EXPECT_EQ(env.totals().visits, visits);
  EXPECT_EQ(env.totals().explored_cells, explored);
  EXPECT_EQ(env.totals().shared_cells, shared);
  EXPECT_GT(explored, 1000);
}

TEST(ExplorationEnvironment, GoesTheSameWayForTheSameSeedAndInACopy) {
  const auto run = [](ExplorationEnvironment& env, std::uint64_t seed, int actions) {
    Random random(seed);
    for (int i = 0; i < actions && !env.is_done(); ++i) {
      const int agent = env.next_agent();
      env.observe(agent);
      env.step(agent, random_goal(env, agent, random));
    }
  };
  ExplorationEnvironment a(EnvironmentConfig::arena()), b(EnvironmentConfig::arena());
  a.reset(random_arena(ArenaKind::k1x, 2, 3));
  b.reset(random_arena(ArenaKind::k2x, 1, 4));
  run(b, 9, 5);
  b.reset(random_arena(ArenaKind::k1x, 2, 3));  // leaves nothing of the episode before
  run(a, 1, 10);
  run(b, 1, 10);
  EXPECT_EQ(a.pose(0), b.pose(0));
  EXPECT_EQ(a.visits(1), b.visits(1));
  ExplorationEnvironment copy = a;
  run(copy, 2, 10);
  EXPECT_EQ(a.totals().visits, b.totals().visits) << "a copy must not touch its original";
  run(a, 2, 10);
  EXPECT_EQ(a.pose(1), copy.pose(1));
  EXPECT_EQ(a.totals().visits, copy.totals().visits);
}

TEST(ExplorationEnvironment, ExploresABuildingByNearestFrontiersAlone) {
  BuildingConfig building;
  building.max_side_um = 10'000'000;
  ExplorationEnvironment env(EnvironmentConfig::building());
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    env.reset(random_building(building, 1, seed));
    int actions = 0;
    while (!env.is_done() && actions < 400) {
      env.step_global(0);
      ++actions;
    }
    EXPECT_GE(env.totals().coverage(), 0.99) << "seed " << seed << " after " << actions;
    EXPECT_EQ(env.totals().collisions, 0) << "seed " << seed;
  }
}

TEST(ExplorationEnvironment, ARobotGetsOutOfARoomWhoseGapTurnsOutNarrow) {
  // From a distance the gap looks wide enough; from inside it is too narrow to be planned through.
  EnvironmentConfig config = EnvironmentConfig::building();
  config.max_actions_per_agent = 1'000;
  ExplorationEnvironment env(config);
  env.reset(random_building({}, 1, 950'040));
  NoModel no_model;
  while (!env.is_done()) env.step_decision(0, env.explorer(0).decide(env.pose(0), no_model));
  EXPECT_GE(env.totals().coverage(), 0.99);
}

TEST(ExplorationEnvironment, NeedsARobot) {
  ExplorationEnvironment env(EnvironmentConfig::arena());
  EXPECT_THROW(env.reset(empty_room(3, {})), std::invalid_argument);
}

}  // namespace
}  // namespace ivfm::host
