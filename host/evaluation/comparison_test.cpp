#include "host/evaluation/comparison.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace ivfm::host {
namespace {

std::vector<EpisodeMetrics> with_steps(const std::vector<int>& steps) {
  std::vector<EpisodeMetrics> episodes(steps.size());
  for (std::size_t i = 0; i < steps.size(); ++i) {
    episodes[i].seed = i;
    episodes[i].found = true;
    episodes[i].steps = steps[i];
  }
  return episodes;
}

TEST(PairedDifference, ComesFromTheDifferencesEpisodeByEpisode) {
  // Widely spread costs, but always 2 to 4 apart: 3 ± sqrt(2 / 3) / sqrt(2).
  const auto ours = with_steps({10, 100, 1000}), theirs = with_steps({12, 103, 1004});
  const PairedDifference d = paired_difference(ours, theirs, steps_of);
  EXPECT_DOUBLE_EQ(d.mean, 3);
  EXPECT_NEAR(d.standard_error, std::sqrt(1.0 / 3), 1e-12);
  EXPECT_NEAR(d.in_standard_errors(), 3 * std::sqrt(3.0), 1e-12);
}

TEST(PairedDifference, RefusesDifferentEpisodes) {
  auto theirs = with_steps({1, 2});
  theirs[1].seed = 99;
  EXPECT_THROW(paired_difference(with_steps({1, 2}), theirs, steps_of), std::invalid_argument);
  EXPECT_THROW(paired_difference(with_steps({1}), with_steps({1, 2}), steps_of),
               std::invalid_argument);
}

TEST(ComparisonTable, MarksOnlyWhatIsBetterByTwoStandardErrors) {
  const Outcome ours{{"ours", "qnet", {}, "ivfm"}, {with_steps({10, 20, 30}), 0, 0}};
  const Outcome slower{{"slower", "random", {}, "ivfm"}, {with_steps({20, 31, 39}), 0, 0}};
  const Outcome alike{{"alike", "random", {}, "ivfm"}, {with_steps({5, 40, 20}), 0, 0}};
  TextTable table = comparison_table();
  add_comparison(table, "1x", ours, std::vector{slower, alike});
  ASSERT_EQ(table.rows.size(), 2u);
  EXPECT_EQ(table.rows[0].size(), table.header.size());
  EXPECT_EQ(table.rows[0][5].text, "10.00 ± 0.58");
  EXPECT_TRUE(table.rows[0][5].is_better);
  EXPECT_FALSE(table.rows[1][5].is_better);
}

TEST(TextTable, AlignsAndMarks) {
  const TextTable table{{"policy", "m"},
                        {{{"a ± b"}, {"1.5", true}}, {{"c"}, {"10.5", false, true}}}};
  EXPECT_EQ(table.to_text(),
            "policy      m \n"
            "a ± b     1.5*\n"
            "c        10.5+\n");
  EXPECT_EQ(table.to_markdown(),
            "| policy | m |\n| --- | ---: |\n| a ± b | _1.5_ |\n| c | **10.5** |\n");
}

}  // namespace
}  // namespace ivfm::host
