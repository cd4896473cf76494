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

}  // namespace
}  // namespace ivfm::host
