#include "host/log_analysis/findings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "host/log_analysis/synthetic_run.h"
#include "host/map_server/scratch_folder.h"

namespace ivfm::host {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::vector<Finding> reasons_of(SyntheticRun run) {
  const ScratchFolder folder;
  run.length_s = 200;
  write_synthetic_run(folder / "run.db", run);
  return find_reasons(load_run(folder / "run.db"));
}

TEST(Findings, SayNothingOfARunInWhichAllWentWell) { EXPECT_TRUE(reasons_of({}).empty()); }

TEST(Findings, NameARobotBeforeAnObstacle) {
  SyntheticRun run;
  run.blocked = true;
  const auto findings = reasons_of(run);
  ASSERT_FALSE(findings.empty());
  EXPECT_THAT(findings[0].headline,
              AllOf(HasSubstr("robot 1 was held by an obstacle"), HasSubstr("75 % of its time")));
  EXPECT_THAT(findings[0].detail, HasSubstr("50 s to 200 s"));
  EXPECT_EQ(findings.size(), 1u);
}

TEST(Findings, NameALossyRadio) {
  SyntheticRun run;
  run.lossy = true;
  const auto findings = reasons_of(run);
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_THAT(findings[0].headline,
              AllOf(HasSubstr("robot 1's radio lost 47 %"), HasSubstr("nothing was heard")));
  EXPECT_THAT(findings[0].detail, HasSubstr("sent again. When: "));
}

TEST(Findings, NameRobotsInEachOthersWay) {
  SyntheticRun run;
  run.in_each_others_way = true;
  const auto findings = reasons_of(run);
  ASSERT_EQ(findings.size(), 2u);
  EXPECT_THAT(findings[0].headline, HasSubstr("in each other's way"));
  EXPECT_THAT(findings[0].detail, HasSubstr("100 s to 1"));
}

TEST(Findings, NameFaultsWithTheirCause) {
  RunData run;
  run.time_s = 100;
  run.robots.resize(1);
  run.robots[0].name = "one";
  run.robots[0].spans = {{0, 60, Activity::kDriving, 0, {}}, {60, 100, Activity::kFault, 1, {}}};
  const auto findings = find_reasons(run);
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings[0].headline, "one was in fault (lidar silent) for 40 s, 40 % of its time.");
}

// Two robots; the first is done after 10 of 100 s. `later_m2` were found after that.
RunData run_with_an_early_end(double later_m2, std::optional<std::uint16_t> blocker) {
  RunData run;
  run.time_s = 100;
  run.explored_m2 = {{0, 0}, {10, 20}, {100, 20 + later_m2}};
  run.robots.resize(2);
  run.robots[0].name = "one";
  run.robots[0].driven = {{0, 0}, {10, 0.5}, {100, 0.5}};
  run.robots[0].spans = {{0, 10, Activity::kDriving, 0, {}},
                         {10, 100, Activity::kDone, 0, blocker}};
  run.robots[1].robot = 2;
  run.robots[1].name = "two";
  run.robots[1].spans = {{0, 100, Activity::kDriving, 0, {}}};
  return run;
}

TEST(Findings, TellARobotThatWasShutInFromOneThatWasDone) {
  const auto shut_in = find_reasons(run_with_an_early_end(30, {}));
  ASSERT_EQ(shut_in.size(), 1u);
  EXPECT_EQ(shut_in[0].headline,
            "one gave up after 10 s and 0.5 m driven and was idle for 1 min 30 s: it found no way "
            "on.");
  EXPECT_THAT(shut_in[0].detail, AllOf(HasSubstr("When: 10 s to 100 s. There was more: 30.0 m²"),
                                       HasSubstr("60 % of all"), HasSubstr("shut in")));
  const auto done = find_reasons(run_with_an_early_end(0.5, {}));
  ASSERT_EQ(done.size(), 1u);
  EXPECT_THAT(done[0].headline, HasSubstr("nothing left to explore"));
}

TEST(Findings, CountsHowLongARobotGaveUpUntilItWentOn) {
  RunData run = run_with_an_early_end(30, std::uint16_t{2});
  run.robots[0].spans = {{0, 10, Activity::kDriving, 0, {}},
                         {10, 18, Activity::kDone, 0, std::uint16_t{2}},
                         {18, 95, Activity::kDriving, 0, {}},
                         {95, 100, Activity::kDone, 0, {}}};  // all was seen by then
  const auto findings = find_reasons(run);
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_THAT(findings[0].headline, HasSubstr("was idle for 8 s: it found no way on, because two"));
}

TEST(Findings, NameTheRobotThatStoodInTheWayOfOneThatGaveUp) {
  const auto findings = find_reasons(run_with_an_early_end(30, std::uint16_t{2}));
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_THAT(findings[0].headline, HasSubstr("because two was in its way."));
}

}  // namespace
}  // namespace ivfm::host
