#include "firmware/planning/explorer.h"

#include <gtest/gtest.h>

#include <memory>

namespace ivfm {
namespace {

struct SmallProfile {
  static constexpr std::int32_t kCellUm = 50'000;
  static constexpr std::int32_t kWindowCells = 160;
  static constexpr std::size_t kBucketCapacity = 128;
};

// Likes the policy cells to the east.
class EastIsBest final : public QFunction {
 public:
  Status evaluate(const LocalState&, std::span<std::int32_t> q_values) override {
    for (std::size_t i = 0; i < q_values.size(); ++i) {
      q_values[i] = static_cast<std::int32_t>(i % kPolicyCells);
    }
    return Status::kOk;
  }
};

class NoModel final : public QFunction {
 public:
  Status evaluate(const LocalState&, std::span<std::int32_t>) override {
    return Status::kUnavailable;
  }
};

// What a lidar of 2 m range sees in the middle of a square room of half width `wall_mm`.
Scan room_scan(int wall_mm, int range_mm) {
  Scan scan;
  for (int i = 0; i < 720; ++i) {
    const BinaryAngle bearing(static_cast<std::uint16_t>(i * 65536 / 720));
    const std::int64_t c = std::abs(cos_q30(bearing)), s = std::abs(sin_q30(bearing));
    const std::int64_t range = (std::int64_t{wall_mm} << 30) / std::max(c, s);
    const bool hit = range < range_mm;
    scan.push({bearing, static_cast<std::uint16_t>(hit ? range : range_mm),
               hit ? Echo::kHit : Echo::kClear, 40});
  }
  return scan;
}

class ExplorerTest : public ::testing::Test {
 protected:
  static ExplorerConfig config() {
    ExplorerConfig c = ExplorerConfig::lidar(2'000'000, SmallProfile::kCellUm);
    c.robot_radius_um = 105'000;
    return c;
  }
  // The policy decides alone; views are not weighed.
  static ExplorerConfig policy_only() {
    ExplorerConfig c = config();
    c.view_reach_um = 0;
    return c;
  }
  std::unique_ptr<ExplorerFor<SmallProfile>> explorer_ =
      std::make_unique<ExplorerFor<SmallProfile>>(config());
  std::unique_ptr<ExplorerFor<SmallProfile>> policy_led_ =
      std::make_unique<ExplorerFor<SmallProfile>>(policy_only());
  const Pose home_{{25'000, 25'000}, {}};
};

TEST_F(ExplorerTest, TheBestReachableCellOfTheNetworkBecomesTheGoal) {
  policy_led_->start(home_);
  (void)policy_led_->fuse(home_, room_scan(3000, 2000));
  EastIsBest q;
  const Decision decision = policy_led_->decide(home_, q);
  EXPECT_EQ(decision.kind, Decision::Kind::kLocalGoal);
  EXPECT_NE(policy_led_->paths().cost_at(policy_led_->map(), decision.goal), path::kUnreachable);
  EXPECT_GT(decision.goal.x, 30) << "far to the east, but within the 2 m seen";
  EXPECT_LE(decision.goal.x, 40);
  EXPECT_FALSE(policy_led_->path().empty());
}

// The same, and says what its values mean.
class Modest final : public QFunction {
 public:
  explicit Modest(std::int32_t unit) : unit_(unit) {}
  Status evaluate(const LocalState& state, std::span<std::int32_t> q_values) override {
    return EastIsBest().evaluate(state, q_values);
  }
  std::int32_t unit() const override { return unit_; }

 private:
  std::int32_t unit_;
};

TEST_F(ExplorerTest, GoalsThatAreHardlyWorthAnActionWaitForTheWholeMaps) {
  ExplorerConfig c = policy_only();
  c.min_local_value_q8 = 256;
  const auto kind_at = [&](std::int32_t unit) {
    ExplorerFor<SmallProfile> explorer(c);
    explorer.start(home_);
    (void)explorer.fuse(home_, room_scan(3000, 2000));
    Modest q(unit);
    return explorer.decide(home_, q).kind;
  };
  EXPECT_EQ(kind_at(10), Decision::Kind::kLocalGoal) << "the best value is some 25";
  EXPECT_EQ(kind_at(1000), Decision::Kind::kGlobalGoal);
  EXPECT_EQ(kind_at(0), Decision::Kind::kLocalGoal) << "values that mean nothing are not judged";
}

TEST_F(ExplorerTest, WithoutAModelItGoesToTheNearestFrontier) {
  explorer_->start(home_);
  (void)explorer_->fuse(home_, room_scan(3000, 2000));
  NoModel q;
  EXPECT_EQ(explorer_->decide(home_, q).kind, Decision::Kind::kGlobalGoal);
}

TEST_F(ExplorerTest, AClosedRoomThatWasSeenWholeIsExplored) {
  explorer_->start(home_);
  (void)explorer_->fuse(home_, room_scan(1000, 2000));
  EastIsBest q;
  EXPECT_EQ(explorer_->decide(home_, q).kind, Decision::Kind::kExplored);
  EXPECT_TRUE(explorer_->path().empty());
}

TEST_F(ExplorerTest, ReturnsToTheStartWhenAskedTo) {
  ExplorerConfig c = config();
  c.return_to_start = true;
  auto explorer = std::make_unique<ExplorerFor<SmallProfile>>(c);
  explorer->start(home_);
  (void)explorer->fuse(home_, room_scan(1000, 2000));
  EastIsBest q;
  const Pose elsewhere{{525'000, 25'000}, {}};
  const Decision decision = explorer->decide(elsewhere, q);
  EXPECT_EQ(decision.kind, Decision::Kind::kReturn);
  EXPECT_EQ(decision.goal, (Cell{0, 0}));
}

TEST_F(ExplorerTest, IdleLocalActionsEndInAGlobalGoalAndHopelessFrontiersAreGivenUp) {
  policy_led_->start(home_);
  (void)policy_led_->fuse(home_, room_scan(3000, 2000));
  EastIsBest q;
  int local = 0, rounds = 0;
  Decision decision = policy_led_->decide(home_, q);
  // A robot that never sees anything new, whatever it does, must come to an end.
  for (; decision.kind != Decision::Kind::kExplored && rounds < 2000; ++rounds) {
    local += decision.kind == Decision::Kind::kLocalGoal ? 1 : 0;
    policy_led_->begin_action();
    const Pose there{policy_led_->map().frame().center_of(decision.goal), {}};
    decision = policy_led_->decide(there, q);
  }
  EXPECT_EQ(decision.kind, Decision::Kind::kExplored);
  EXPECT_GT(local, 0);
  EXPECT_LT(rounds, 2000);
}

TEST_F(ExplorerTest, InterruptedWaysThatCameNearerAreNotInVain) {
  policy_led_->start(home_);
  (void)policy_led_->fuse(home_, room_scan(3000, 2000));
  NoModel q;
  const Cell goal = policy_led_->decide(home_, q).goal;
  const Point end = policy_led_->map().frame().center_of(goal);
  // Something stops every action after a tenth of the way: more often than tries are granted.
  for (int tenth = 1; tenth <= 8; ++tenth) {
    policy_led_->begin_action();
    const Pose here{{home_.position.x_um + (end.x_um - home_.position.x_um) / 10 * tenth,
                     home_.position.y_um + (end.y_um - home_.position.y_um) / 10 * tenth},
                    {}};
    EXPECT_EQ(policy_led_->decide(here, q).goal, goal) << "after " << tenth << " tenths";
  }
}

TEST_F(ExplorerTest, AFrontierThatTheRobotGoesToAndFroBeforeIsGivenUp) {
  policy_led_->start(home_);
  (void)policy_led_->fuse(home_, room_scan(3000, 2000));
  NoModel q;
  const Cell goal = policy_led_->decide(home_, q).goal;
  const Point end = policy_led_->map().frame().center_of(goal);
  int rounds = 0;
  for (Cell next = goal; next == goal && rounds < 50; ++rounds) {
    policy_led_->begin_action();
    const int tenth = 1 + rounds % 4;  // nearer, nearer, nearer, and back
    const Pose here{{home_.position.x_um + (end.x_um - home_.position.x_um) / 10 * tenth,
                     home_.position.y_um + (end.y_um - home_.position.y_um) / 10 * tenth},
                    {}};
    next = policy_led_->decide(here, q).goal;
  }
  EXPECT_GT(rounds, 8);
  EXPECT_LT(rounds, 20);
}

TEST_F(ExplorerTest, TheMostRewardingViewComesBeforeThePolicysCrumbs) {
  explorer_->start(home_);
  (void)explorer_->fuse(home_, room_scan(3000, 2000));
  EastIsBest q;
  // From here the policy's favourite shows a strip of the unseen, the edge as much for less
  // driving.
  const Pose near_the_edge{{-1'425'000, 25'000}, {}};
  const Decision decision = explorer_->decide(near_the_edge, q);
  EXPECT_EQ(decision.kind, Decision::Kind::kGlobalGoal);
  EXPECT_LT(decision.goal.x, -28);
}

TEST_F(ExplorerTest, ThePolicysGoalIsFollowedWhereItShowsMoreForTheWay) {
  explorer_->start(home_);
  (void)explorer_->fuse(home_, room_scan(3000, 2000));
  // The frontiers of the eastern half are given up; what lies behind them is still unseen.
  for (std::int32_t y = -60; y <= 60; ++y) {
    for (std::int32_t x = 0; x <= 60; ++x) {
      if (is_frontier(explorer_->map(), {x, y})) {
        explorer_->map().set_flag({x, y}, cell_flag::kGivenUp);
      }
    }
  }
  EastIsBest q;
  const Pose in_the_east{{1'025'000, 25'000}, {}};
  const Decision decision = explorer_->decide(in_the_east, q);
  EXPECT_EQ(decision.kind, Decision::Kind::kLocalGoal);
  EXPECT_GT(decision.goal.x, 30);
}

TEST_F(ExplorerTest, WeighingViewsComesToAnEndThoughNothingNewIsEverSeen) {
  explorer_->start(home_);
  (void)explorer_->fuse(home_, room_scan(3000, 2000));
  EastIsBest q;
  int rounds = 0;
  Decision decision = explorer_->decide(home_, q);
  for (; decision.kind != Decision::Kind::kExplored && rounds < 2000; ++rounds) {
    explorer_->begin_action();
    decision = explorer_->decide({explorer_->map().frame().center_of(decision.goal), {}}, q);
  }
  EXPECT_EQ(decision.kind, Decision::Kind::kExplored);
  EXPECT_LT(rounds, 2000);
}

TEST_F(ExplorerTest, ACopyDecidesTheSameAndIsIndependent) {
  explorer_->start(home_);
  (void)explorer_->fuse(home_, room_scan(3000, 2000));
  auto copy = std::make_unique<ExplorerFor<SmallProfile>>(*explorer_);
  EastIsBest q;
  EXPECT_EQ(copy->decide(home_, q).goal, explorer_->decide(home_, q).goal);
  copy->map().count_visit({50, 50});
  EXPECT_EQ(explorer_->map().visits({50, 50}), 0u);
}

TEST_F(ExplorerTest, OnlyCellsInReachAreInTheGoalMask) {
  explorer_->start(home_);
  (void)explorer_->fuse(home_, room_scan(1500, 2000));
  explorer_->observe(home_);
  const CellRect room{-29, -29, 59, 59};
  for (int i = 0; i < kPolicyGridSize; ++i) {
    if (!explorer_->goal_mask()[static_cast<std::size_t>(i)]) continue;
    EXPECT_FALSE(room.intersection(explorer_->state().grid.block(i)).empty()) << i;
  }
  Decision decision;
  EXPECT_EQ(explorer_->select_local_goal(0, decision), Status::kUnavailable);
  EXPECT_EQ(explorer_->select_local_goal(1024, decision), Status::kInvalidArgument);
}

}  // namespace
}  // namespace ivfm
