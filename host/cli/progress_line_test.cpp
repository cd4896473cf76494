#include "host/cli/progress_line.h"

#include <gtest/gtest.h>

namespace ivfm::host {
namespace {

TEST(ProgressText, ShowsShareAndEstimate) {
  EXPECT_EQ(progress_text(0, 200, "episodes", 1),
            "[                              ] 0 of 200 episodes");
  EXPECT_EQ(progress_text(50, 200, "episodes", 30),
            "[#######                       ] 50 of 200 episodes, 1 min 30 s left");
  EXPECT_EQ(progress_text(7, 5, "rows", 9),
            "[##############################] 5 of 5 rows, 0 s left");
  EXPECT_EQ(progress_text(0, 0, "rows", 9), "[                              ] 0 of 1 rows");
}

TEST(DurationText, IsAsPeopleSayIt) {
  EXPECT_EQ(duration_text(0.4), "0 s");
  EXPECT_EQ(duration_text(59.4), "59 s");
  EXPECT_EQ(duration_text(59.6), "1 min 0 s");
  EXPECT_EQ(duration_text(7500), "2 h 5 min");
  EXPECT_EQ(duration_text(-1), "0 s");
}

TEST(ProgressLine, IsQuietWhereNobodyLooks) {
  testing::internal::CaptureStderr();  // a file, not a terminal
  {
    ProgressLine line(3, "things");
    for (int i = 0; i < 3; ++i) line(1);
    line.say("something");
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

}  // namespace
}  // namespace ivfm::host
